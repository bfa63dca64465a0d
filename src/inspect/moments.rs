//! Mean, spread and skew of numbers that come one after another.

/// Running moments (Welford's recurrence, to the third: Terriberry 2007). Numbers that aren't finite are left out.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    n: u64,
    mean: f64,
    m2: f64,
    m3: f64,
}

impl Moments {
    pub(super) fn handle(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        let n_before = self.n as f64;
        self.n += 1;
        let n = self.n as f64;
        let delta = value - self.mean;
        let step = delta / n;
        let term = delta * step * n_before;
        self.mean += step;
        self.m3 += term * step * (n - 2.0) - 3.0 * step * self.m2;
        self.m2 += term;
    }

    /// Whether no finite number came.
    pub(super) fn is_empty(&self) -> bool {
        self.n == 0
    }

    /// Whether all numbers were the same.
    pub(super) fn is_constant(&self) -> bool {
        self.m2 == 0.0
    }

    pub(super) fn mean(&self) -> f64 {
        self.mean
    }

    /// Skewness: positive where rare numbers are far above the others. None where nothing changes.
    pub(super) fn skew(&self) -> Option<f64> {
        (self.m2 > 0.0).then(|| (self.n as f64).sqrt() * self.m3 / self.m2.powf(1.5)).filter(|skew| skew.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_textbook() {
        let mut moments = Moments::default();
        [1.0, 1.0, 1.0, f64::NAN, 5.0].into_iter().for_each(|value| moments.handle(value));
        assert_eq!(moments.mean(), 2.0);
        // Deviations -1, -1, -1, 3: m2 = 12, m3 = 24.
        let expected = 4.0_f64.sqrt() * 24.0 / 12.0_f64.powf(1.5);
        assert!((moments.skew().unwrap() - expected).abs() < 1e-12); // rounding
        assert!(!moments.is_constant() && Moments::default().is_empty());
    }
}
