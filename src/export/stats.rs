//! Statistics of each feature that LeRobot needs for normalization, per episode and for the whole dataset.

use serde_json::{Value, json};

use crate::columns::Cells;

/// The quantiles in LeRobot's statistics, with their names.
pub(super) const QUANTILES: [(f64, &str); 5] = [(0.01, "q01"), (0.1, "q10"), (0.5, "q50"), (0.9, "q90"), (0.99, "q99")];

/// Statistics of one feature, over its finite values.
///
/// # Shapes
/// `[elements]` each. For a matrix: one element per column, over all rows.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stats {
    pub(super) min: Vec<f64>,
    pub(super) max: Vec<f64>,
    pub(super) mean: Vec<f64>,
    pub(super) std: Vec<f64>,
    /// Indexed by quantile.
    pub(super) quantiles: Vec<Vec<f64>>,
    /// Number of frames with a finite value.
    pub(super) count: u64,
}

impl Stats {
    /// Statistics of the cells of a column. `None` if an element has no finite value.
    pub(super) fn of(cells: &Cells) -> Option<Stats> {
        let (n_columns, values) = numbers(cells);
        let n_frames = cells.n_rows();
        let per_frame = values.len() / n_frames.max(1);
        let has_value = |frame: &&[f64]| frame.iter().any(|value| value.is_finite());
        let count = values.chunks_exact(per_frame.max(1)).filter(has_value).count() as u64;
        let mut stats = Stats {
            min: Vec::new(),
            max: Vec::new(),
            mean: Vec::new(),
            std: Vec::new(),
            quantiles: vec![Vec::new(); QUANTILES.len()],
            count,
        };
        for column in 0..n_columns {
            let of_column = values.iter().skip(column).step_by(n_columns);
            let mut finite: Vec<f64> = of_column.copied().filter(|value| value.is_finite()).collect();
            finite.sort_unstable_by(f64::total_cmp);
            let (first, last) = (*finite.first()?, *finite.last()?);
            let n = finite.len() as f64;
            let mean = finite.iter().sum::<f64>() / n;
            let variance = finite.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n;
            stats.min.push(first);
            stats.max.push(last);
            stats.mean.push(mean);
            stats.std.push(variance.sqrt());
            for ((share, _), quantiles) in QUANTILES.iter().zip(&mut stats.quantiles) {
                quantiles.push(quantile(&finite, *share));
            }
        }
        Some(stats)
    }

    /// Statistics of all episodes. As in LeRobot, a quantile of the dataset is the mean of the episodes' quantiles.
    pub(super) fn of_all<'s>(episodes: impl Iterator<Item = &'s Stats> + Clone) -> Option<Stats> {
        let count: u64 = episodes.clone().map(|stats| stats.count).sum();
        let first = episodes.clone().next()?;
        let weighted = |of: &dyn Fn(&Stats) -> f64| {
            episodes.clone().map(|stats| of(stats) * stats.count as f64).sum::<f64>() / count as f64
        };
        let elements = 0..first.mean.len();
        let mean: Vec<f64> = elements.clone().map(|idx| weighted(&|stats| stats.mean[idx])).collect();
        let variance = |idx: usize| weighted(&|stats| stats.std[idx].powi(2) + (stats.mean[idx] - mean[idx]).powi(2));
        let quantile = |which: usize| elements.clone().map(|idx| weighted(&|one| one.quantiles[which][idx])).collect();
        Some(Stats {
            min: elements
                .clone()
                .map(|idx| episodes.clone().map(|one| one.min[idx]).fold(f64::MAX, f64::min))
                .collect(),
            max: elements
                .clone()
                .map(|idx| episodes.clone().map(|one| one.max[idx]).fold(f64::MIN, f64::max))
                .collect(),
            std: elements.clone().map(|idx| variance(idx).sqrt()).collect(),
            quantiles: (0..QUANTILES.len()).map(quantile).collect(),
            count,
            mean,
        })
    }

    /// The statistics with LeRobot's names.
    pub(super) fn named(&self) -> impl Iterator<Item = (&'static str, &[f64])> {
        let moments = [("min", &self.min), ("max", &self.max), ("mean", &self.mean), ("std", &self.std)];
        let quantiles = QUANTILES.iter().map(|(_, name)| *name).zip(&self.quantiles);
        moments.into_iter().chain(quantiles).map(|(name, values)| (name, values.as_slice()))
    }

    pub(super) fn to_json(&self) -> Value {
        let mut json: serde_json::Map<String, Value> =
            self.named().map(|(name, values)| (name.to_owned(), json!(values))).collect();
        json.insert("count".to_owned(), json!([self.count]));
        Value::Object(json)
    }
}

/// Interpolates linearly, as NumPy does by default.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * (sorted.len() - 1) as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    below + (above - below) * at.fract()
}

/// Cells as numbers, row-major, and the number of columns. Cells without a number are NaN.
fn numbers(cells: &Cells) -> (usize, Vec<f64>) {
    let single = |values: &[f32]| values.iter().copied().map(f64::from).collect();
    match cells {
        Cells::Number(cells) => (1, cells.iter().map(|cell| cell.unwrap_or(f64::NAN)).collect()),
        Cells::Single(cells) => (1, single(cells)),
        Cells::Whole(cells) => (1, cells.iter().map(|cell| cell.map_or(f64::NAN, |cell| cell as f64)).collect()),
        Cells::Flag(cells) => (1, cells.iter().map(|cell| cell.map_or(f64::NAN, f64::from)).collect()),
        Cells::Vector { len, values } => (*len, single(values)),
        Cells::Matrix { n_columns, values, .. } => (*n_columns, single(values)),
        Cells::Text(_) | Cells::Stamp(_) | Cells::Texts(_) | Cells::Numbers(_) | Cells::Wholes(_) => (0, Vec::new()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_counts_for_nothing() {
        let stats = Stats::of(&Cells::Single(vec![1.0, f32::NAN, 3.0, 8.0])).unwrap();
        assert_eq!((stats.count, stats.min[0], stats.max[0], stats.mean[0]), (3, 1.0, 8.0, 4.0));
        assert_eq!(stats.std[0], (26.0f64 / 3.0).sqrt());
        assert_eq!(stats.quantiles[2], [3.0]);
        assert_eq!(Stats::of(&Cells::Single(vec![f32::NAN; 3])), None);
    }

    #[test]
    fn a_matrix_has_statistics_by_column() {
        let cells = Cells::Matrix { n_rows: 2, n_columns: 2, values: vec![1.0, 10.0, 2.0, 20.0, 3.0, 30.0, 4.0, 40.0] };
        let stats = Stats::of(&cells).unwrap();
        assert_eq!((stats.mean, stats.max, stats.count), (vec![2.5, 25.0], vec![4.0, 40.0], 2));
    }

    #[test]
    fn statistics_of_all_episodes_are_those_of_their_values_together() {
        let (a, b) = (vec![1.0, 2.0, 9.0], vec![4.0]);
        let parts = [a.clone(), b.clone()].map(|values| Stats::of(&Cells::Single(values)).unwrap());
        let all = Stats::of_all(parts.iter()).unwrap();
        let whole = Stats::of(&Cells::Single([a, b].concat())).unwrap();
        assert_eq!((all.min, all.max, all.count), (whole.min, whole.max, 4));
        assert!((all.mean[0] - whole.mean[0]).abs() < 1e-12 && (all.std[0] - whole.std[0]).abs() < 1e-12);
    }
}
