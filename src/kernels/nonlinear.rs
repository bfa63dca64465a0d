//! Nonlinearities without branches or calls, so that loops over them become vector code.

/// Logistic function.
#[cfg(any(test, feature = "train"))]
#[inline(always)]
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// Hyperbolic tangent, with an absolute error of 2e-7.
#[cfg(any(test, feature = "train"))]
#[inline(always)]
pub(crate) fn tanh_of(x: f32) -> f32 {
    2.0 / (1.0 + exp(-2.0 * x)) - 1.0
}

/// Bound on exponents, because three exponentials are multiplied. Beyond it, a sigmoid is 0 or 1 to within 1e-12.
const BOUND: f32 = 28.0; // exp(28)^3 is 3e36, of 3.4e38 that fit

/// `sigmoid(forget) * cell + sigmoid(input) * tanh(candidate)`: the next cell of an LSTM, with a single division.
#[inline(always)]
pub(crate) fn next_cell(cell: f32, forget: f32, input: f32, candidate: f32) -> f32 {
    let (forget, input) = (1.0 + exp_within(-forget, BOUND), 1.0 + exp_within(-input, BOUND));
    let candidate = exp_within(-2.0 * candidate, BOUND);
    let both = input * (1.0 + candidate);
    (cell * both + (1.0 - candidate) * forget) / (forget * both)
}

/// `sigmoid(output) * tanh(cell)`: the state of an LSTM, with a single division.
#[inline(always)]
pub(crate) fn state(output: f32, cell: f32) -> f32 {
    let cell = exp_within(-2.0 * cell, BOUND);
    (1.0 - cell) / ((1.0 + exp_within(-output, BOUND)) * (1.0 + cell))
}

/// Gaussian error linear unit. The absolute error of the error function is 2e-7.
///
/// # Source
/// Abramowitz and Stegun, Handbook of Mathematical Functions, 7.1.26.
#[inline(always)]
pub(crate) fn gelu(x: f32) -> f32 {
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
pub(crate) fn exp(x: f32) -> f32 {
    exp_within(x, 87.0) // close to the exponents of the largest and the smallest number
}

/// Exponential of `x`, limited to the range from `-bound` to `bound`.
#[inline(always)]
fn exp_within(x: f32, bound: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it leaves the nearest whole number in the low bits
    const LN2_HIGH: f32 = 0.693_359_4; // 355/512: exact in few bits, so its multiples are exact
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-bound, bound);
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
        let wide = |x: f32| f64::from(x);
        let logistic = |x: f32| 1.0 / (1.0 + (-wide(x)).exp());
        let numbers = [-1e6, -90.0, -40.0, -7.3, -0.8, -1e-3, 0.0, 1e-3, 0.4, 3.1, 28.5, 90.0, 1e6];
        for cell in [-64.0, -2.1, -0.03, 0.0, 0.7, 64.0] {
            for gate in numbers {
                let expected = logistic(gate) * wide(cell).tanh();
                assert!((wide(state(gate, cell)) - expected).abs() < 4e-7, "state of {gate} and {cell}");
                for (input, candidate) in numbers.iter().flat_map(|a| numbers.map(|b| (*a, b))) {
                    let got = wide(next_cell(cell, gate, input, candidate));
                    let expected = logistic(gate) * wide(cell) + logistic(input) * wide(candidate).tanh();
                    // A few roundings of the cell, and those of the hyperbolic tangent.
                    let tolerance = 4e-7 * (1.0 + wide(cell).abs());
                    assert!((got - expected).abs() < tolerance, "{cell} {gate} {input} {candidate}: {got} {expected}");
                }
            }
        }
    }

    #[test]
    fn nan_stays_nan() {
        assert!(
            [next_cell(f32::NAN, 0.0, 0.0, 0.0), next_cell(0.0, f32::NAN, 0.0, 0.0)].iter().all(|cell| cell.is_nan())
        );
        assert!(
            [next_cell(0.0, 0.0, f32::NAN, 0.0), next_cell(0.0, 0.0, 0.0, f32::NAN)].iter().all(|cell| cell.is_nan())
        );
        assert!(state(f32::NAN, 0.0).is_nan() && state(0.0, f32::NAN).is_nan());
        assert!(sigmoid(f32::NAN).is_nan() && tanh_of(f32::NAN).is_nan() && gelu(f32::NAN).is_nan());
    }
}
