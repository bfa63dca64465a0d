//! Nonlinearities without branches or calls, so that loops over them become vector code.
//!
//! `FMA` says that the machine has fused multiply-add. Without it, `mul_add` is a call.

/// Logistic function.
#[inline(always)]
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// Hyperbolic tangent, with an absolute error of 2e-7.
#[inline(always)]
pub fn tanh_of(x: f32) -> f32 {
    2.0 / (1.0 + exp(-2.0 * x)) - 1.0
}

/// `sigmoid(forget) * cell + sigmoid(input) * tanh(candidate)`: the next cell of an LSTM, with a single division.
#[inline(always)]
pub fn next_cell<const FMA: bool>(cell: f32, forget: f32, input: f32, candidate: f32) -> f32 {
    let (forget, input) = (1.0 + scaled_exp::<FMA>(-1, forget), 1.0 + scaled_exp::<FMA>(-1, input));
    let candidate = scaled_exp::<FMA>(-2, candidate);
    let both = input * (1.0 + candidate);
    multiply_add::<FMA>(cell, both, (1.0 - candidate) * forget) / (forget * both)
}

/// `sigmoid(output) * tanh(cell)`: the state of an LSTM, with a single division.
#[inline(always)]
pub fn state<const FMA: bool>(output: f32, cell: f32) -> f32 {
    let cell = scaled_exp::<FMA>(-2, cell);
    (1.0 - cell) / ((1.0 + scaled_exp::<FMA>(-1, output)) * (1.0 + cell))
}

/// Gaussian error linear unit. The absolute error of the error function is 2e-7.
///
/// # Source
/// Abramowitz and Stegun, Handbook of Mathematical Functions, 7.1.26.
#[inline(always)]
pub fn gelu(x: f32) -> f32 {
    let z = x.abs() * std::f32::consts::FRAC_1_SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let series = 1.061_405_4;
    let series = series * t - 1.453_152;
    let series = series * t + 1.421_413_8;
    let series = series * t - 0.284_496_73;
    let series = series * t + 0.254_829_6;
    let tail = series * t * exp(-z * z); // 1 - erf(z)
    let share = if x < 0.0 { 0.5 * tail } else { 1.0 - 0.5 * tail };
    x * share
}

/// Exponential with a relative error of 2e-7. It has no branches or calls, so that loops over it become vector code.
///
/// Reduction by ln 2 in two parts (Cody and Waite), then the Taylor series on `[-ln2/2, ln2/2]` up to the 7th power.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    const BOUND: f32 = 87.0; // close to the exponents of the largest and the smallest number
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it leaves the nearest whole number in the low bits
    const LN2_HIGH: f32 = 0.693_359_4; // 355/512: exact in few bits, so its multiples are exact
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-BOUND, BOUND);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let power = shifted - ROUND;
    let r = (x - power * LN2_HIGH) - power * LN2_LOW;
    let series = 1.0 / 5040.0;
    let series = series * r + 1.0 / 720.0;
    let series = series * r + 1.0 / 120.0;
    let series = series * r + 1.0 / 24.0;
    let series = series * r + 1.0 / 6.0;
    let series = series * r + 0.5;
    let series = (series * r + 1.0) * r + 1.0;
    series * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
}

/// `exp(scale * x)`, limited to the range from 2^-40 to 2^40, because three of them are multiplied. Beyond it, a sigmoid
/// is 0 or 1 to within 1e-12.
///
/// Its relative error is 1e-7, and 1e-7 of `scale * x`: no more than if `x` had been rounded once more. It is a power of
/// two with a whole exponent, times one with an exponent of at most a half, a polynomial with a relative error of 3e-9
/// (minimax, fitted with 1 as its value at 0).
#[inline(always)]
fn scaled_exp<const FMA: bool>(scale: i8, x: f32) -> f32 {
    // 1.5 * 2^23: adding it leaves the nearest whole number in the low bits. 127 more, and it is the exponent of a number.
    const ROUND: f32 = 12_582_912.0 + 127.0;
    let per_unit = f32::from(scale) * std::f32::consts::LOG2_E;
    let bound = 40.0 / per_unit.abs();
    let x = x.clamp(-bound, bound);
    let shifted = multiply_add::<FMA>(x, per_unit, ROUND);
    let power = shifted - ROUND;
    let rest = multiply_add::<FMA>(x, per_unit, -power);
    let series = multiply_add::<FMA>(1.532_931e-4, rest, 1.339_097e-3);
    let series = multiply_add::<FMA>(series, rest, 9.618_499e-3);
    let series = multiply_add::<FMA>(series, rest, 5.550_359_6e-2);
    let series = multiply_add::<FMA>(series, rest, 2.402_264_8e-1);
    let series = multiply_add::<FMA>(series, rest, 6.931_472e-1);
    let series = multiply_add::<FMA>(series, rest, 1.0);
    series * f32::from_bits(shifted.to_bits() << 23)
}

/// `a * b + c`, with a single rounding if the machine does it in one instruction.
#[inline(always)]
fn multiply_add<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nonlinearities_match_float64() {
        for step in -4000..=4000 {
            let x = step as f32 * 0.01;
            let wide = f64::from(x);
            assert!((f64::from(sigmoid(x)) - 1.0 / (1.0 + (-wide).exp())).abs() < 2e-7, "sigmoid at {x}");
            assert!((f64::from(tanh_of(x)) - wide.tanh()).abs() < 3e-7, "tanh at {x}");
            let expected = wide * 0.5 * (1.0 + libm::erf(wide * std::f64::consts::FRAC_1_SQRT_2));
            // 1.5e-7 from the series, and the rounding of x itself.
            assert!((f64::from(gelu(x)) - expected).abs() < 3e-7 * (1.0 + wide.abs()), "gelu at {x}");
        }
    }

    #[test]
    fn the_steps_of_an_lstm_match_float64() {
        steps_match::<true>();
        steps_match::<false>();
    }

    fn steps_match<const FMA: bool>() {
        let wide = |x: f32| f64::from(x);
        let logistic = |x: f32| 1.0 / (1.0 + (-wide(x)).exp());
        let numbers = [-1e6, -90.0, -40.0, -7.3, -0.8, -1e-3, 0.0, 1e-3, 0.4, 3.1, 28.5, 90.0, 1e6];
        for cell in [-64.0, -2.1, -0.03, 0.0, 0.7, 64.0] {
            for gate in numbers {
                let expected = logistic(gate) * wide(cell).tanh();
                assert!((wide(state::<FMA>(gate, cell)) - expected).abs() < 4e-7, "state of {gate} and {cell}");
                for (input, candidate) in numbers.iter().flat_map(|a| numbers.map(|b| (*a, b))) {
                    let got = wide(next_cell::<FMA>(cell, gate, input, candidate));
                    let expected = logistic(gate) * wide(cell) + logistic(input) * wide(candidate).tanh();
                    // A few roundings of the cell, and those of the hyperbolic tangent.
                    let tolerance = 4e-7 * (1.0 + wide(cell).abs());
                    assert!((got - expected).abs() < tolerance, "{cell} {gate} {input} {candidate}: {got} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_state_of_zero_stays_zero() {
        assert_eq!((state::<true>(1.0, 0.0), state::<false>(1.0, 0.0)), (0.0, 0.0));
        assert_eq!((next_cell::<true>(0.0, 1.0, 1.0, 0.0), next_cell::<false>(0.0, 1.0, 1.0, 0.0)), (0.0, 0.0));
    }

    #[test]
    fn nan_stays_nan() {
        // All its bits matter: the exponential works on those of its argument.
        for nan in [f32::NAN, f32::from_bits(0x7fc0_0001), f32::from_bits(0xffff_ffff), f32::from_bits(0x7f80_01ff)] {
            for idx in 0..4 {
                let [cell, forget, input, candidate] = std::array::from_fn(|at| if at == idx { nan } else { 0.0 });
                assert!(next_cell::<true>(cell, forget, input, candidate).is_nan());
                assert!(next_cell::<false>(cell, forget, input, candidate).is_nan());
            }
            for (output, cell) in [(nan, 0.0), (0.0, nan)] {
                assert!(state::<true>(output, cell).is_nan() && state::<false>(output, cell).is_nan());
            }
        }
        assert!(sigmoid(f32::NAN).is_nan() && tanh_of(f32::NAN).is_nan() && gelu(f32::NAN).is_nan());
    }
}
