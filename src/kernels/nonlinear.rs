//! Nonlinearities without branches or calls, so that loops over them become vector code.

/// Logistic function.
#[inline(always)]
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// Hyperbolic tangent to 2e-7 absolute.
#[inline(always)]
pub(crate) fn tanh_of(x: f32) -> f32 {
    2.0 / (1.0 + exp(-2.0 * x)) - 1.0
}

/// Gaussian error linear unit, by the error function to 2e-7 absolute.
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

/// Exponential to 2e-7 relative, without branches or calls so that loops over it become vector code.
///
/// Cody and Waite's reduction by ln 2 in two parts, then the Taylor series on `[-ln2/2, ln2/2]` to its 7th power.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it leaves the nearest whole number in the low bits
    const LN2_HIGH: f32 = 0.693_359_4; // 355/512: exact in few bits, so its multiples are exact
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87.0, 87.0);
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
            // 1.5e-7 of the series and the rounding of x itself.
            assert!((f64::from(gelu(x)) - expected).abs() < 3e-7 * (1.0 + wide.abs()), "gelu at {x}");
        }
    }

    #[test]
    fn nan_stays_nan() {
        assert!(sigmoid(f32::NAN).is_nan() && tanh_of(f32::NAN).is_nan() && gelu(f32::NAN).is_nan());
    }
}
