//! Ridge regression from sums of products, so that any choice of features can be fitted without another pass over the
//! data.

use nalgebra::DMatrix;

/// Strength of the ridge, as a fraction of each feature's own variance. It is strong enough that joints that move
/// together don't get opposite weights, and too weak to matter for a joint that moves alone.
const RIDGE: f64 = 1e-3;

/// Sums of products of features and targets, without an intercept.
#[derive(Debug, Clone)]
pub(super) struct Gram {
    n_features: usize,
    n_targets: usize,
    n: f64,
    products: DMatrix<f64>,
}

/// Weights of some features for every target.
#[derive(Debug, Clone)]
pub(super) struct Weights {
    features: Vec<usize>,
    /// `[features, targets]`
    weights: DMatrix<f64>,
}

impl Weights {
    /// Weight of the `k`-th of the fitted features for a target.
    pub(super) fn weight(&self, k: usize, target: usize) -> f64 {
        self.weights[(k, target)]
    }
}

impl Gram {
    pub(super) fn new(n_features: usize, n_targets: usize) -> Self {
        let size = n_features + n_targets;
        Gram { n_features, n_targets, n: 0.0, products: DMatrix::zeros(size, size) }
    }

    /// Adds a row of features and targets.
    pub(super) fn handle(&mut self, features: &[f64], targets: &[f64]) {
        self.n += 1.0;
        let row: Vec<f64> = features.iter().chain(targets).copied().collect();
        for (column, value) in row.iter().enumerate() {
            // Only the lower triangle; `product` accounts for that.
            self.products
                .column_mut(column)
                .iter_mut()
                .zip(&row)
                .skip(column)
                .for_each(|(sum, other)| *sum += value * other);
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.n == 0.0
    }

    /// Adds all rows of another Gram.
    pub(super) fn add(&mut self, other: &Gram) {
        self.n += other.n;
        self.products += &other.products;
    }

    fn product(&self, a: usize, b: usize) -> f64 {
        self.products[(a.max(b), a.min(b))]
    }

    fn of_target(&self, feature: usize, target: usize) -> f64 {
        self.product(feature, self.n_features + target)
    }

    /// The weights of these features with the best fit to the targets. Features that never vary get zero.
    pub(super) fn fit(&self, features: &[usize]) -> Weights {
        let scales: Vec<f64> =
            features.iter().map(|&feature| (self.product(feature, feature) / self.n).sqrt()).collect();
        let is_still = |k: usize| scales[k].is_nan() || scales[k] < 1e-12;
        let n = features.len();
        let normal = DMatrix::from_fn(n, n, |a, b| {
            let scaled = match is_still(a) || is_still(b) {
                true => f64::from(u8::from(a == b)),
                false => self.product(features[a], features[b]) / (self.n * scales[a] * scales[b]),
            };
            scaled + if a == b { RIDGE } else { 0.0 }
        });
        let right = DMatrix::from_fn(n, self.n_targets, |k, target| match is_still(k) {
            true => 0.0,
            false => self.of_target(features[k], target) / (self.n * scales[k]),
        });
        let mut weights = match normal.cholesky() {
            Some(cholesky) => cholesky.solve(&right),
            None => DMatrix::zeros(n, self.n_targets), // if products are not finite
        };
        for (k, scale) in scales.iter().enumerate() {
            let unscale = if is_still(k) { 0.0 } else { 1.0 / scale };
            weights.row_mut(k).iter_mut().for_each(|weight| *weight *= unscale);
        }
        Weights { features: features.to_vec(), weights }
    }

    /// Sum of the products of a feature with the prediction of the first target: positive if they grow together.
    pub(super) fn along(&self, by: &Weights, feature: usize) -> f64 {
        by.features.iter().enumerate().map(|(k, other)| by.weight(k, 0) * self.product(*other, feature)).sum()
    }

    /// Sum of the squares of the targets, before and after subtracting the prediction.
    pub(super) fn squares(&self, by: &Weights) -> [f64; 2] {
        let Weights { features, weights } = by;
        let (mut left, mut total) = (0.0, 0.0);
        for target in 0..self.n_targets {
            let square = self.product(self.n_features + target, self.n_features + target);
            let (mut with, mut within) = (0.0, 0.0);
            for (a, &feature) in features.iter().enumerate() {
                with += weights[(a, target)] * self.of_target(feature, target);
                for (b, &other) in features.iter().enumerate() {
                    within += weights[(a, target)] * weights[(b, target)] * self.product(feature, other);
                }
            }
            left += square - 2.0 * with + within;
            total += square;
        }
        [total, left]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_found_and_a_still_feature_gets_none() {
        let mut gram = Gram::new(3, 1);
        for k in 0..200 {
            let (a, b) = ((f64::from(k) * 0.7).sin(), (f64::from(k) * 1.9).cos());
            gram.handle(&[a, 0.0, b], &[3.0 * a - 2.0 * b]);
        }
        let weights = gram.fit(&[0, 1, 2]);
        // The ridge reduces the weights by a thousandth.
        assert!((weights.weight(0, 0) - 3.0).abs() < 0.01 && (weights.weight(2, 0) + 2.0).abs() < 0.01);
        assert_eq!(weights.weight(1, 0), 0.0);
        assert!(gram.along(&weights, 0) > 0.0 && gram.along(&weights, 2) < 0.0);
        let [total, left] = gram.squares(&weights);
        assert!(left < 1e-3 * total, "{left} of {total}");
        assert_eq!(gram.squares(&gram.fit(&[1])), [total, total]);
    }
}
