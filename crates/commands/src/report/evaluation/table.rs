//! Models against metrics in the shape of the paper's Table I, as text.

use comfy_table::{CellAlignment, Table, presets};
use tactile_pose_fusion::eval::{Cell, Measure, ResultTable};

/// A row for each model and glove, the best value of each glove and measure marked with `*`. The first two columns name the
/// rows.
///
/// The paper sets the gloves side by side; here they are below each other, so that a terminal holds any number of
/// them.
pub(super) fn table(results: &ResultTable) -> Table {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(["Glove", "Model", "BA % (+)", "F1 % (+)", "MDF gF (-)", "MAE gF (-)", "R2 (+)", "Frames"]);
    for column in table.column_iter_mut().skip(2) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    for (glove_idx, glove) in results.gloves.iter().enumerate() {
        for row in &results.rows {
            let mut texts = vec![glove.clone(), row.model.clone()];
            match row.cells.get(glove_idx).copied().flatten() {
                Some(cell) => {
                    texts.extend(Measure::ALL.map(|measure| {
                        let mark = if is_best(results, glove_idx, measure, &cell) { '*' } else { ' ' };
                        format!("{}{mark}", cell.text(measure))
                    }));
                    texts.push(cell.coverage.n_scored.to_string());
                }
                None => texts.extend(std::iter::repeat_n("-".to_owned(), Measure::ALL.len() + 1)),
            }
            table.add_row(texts);
        }
    }
    table
}

/// Whether no other model has a better value, and one has a worse one.
fn is_best(results: &ResultTable, glove_idx: usize, measure: Measure, cell: &Cell) -> bool {
    let Some(value) = cell.value(measure) else { return false };
    let sign = if measure.higher_is_better() { 1.0 } else { -1.0 };
    let others = results.rows.iter().filter_map(|row| row.cells.get(glove_idx)?.as_ref()?.value(measure));
    let gains: Vec<f64> = others.map(|other| sign * (value - other)).collect();
    gains.iter().all(|&gain| gain >= 0.0) && gains.iter().any(|&gain| gain > 0.0)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use tactile_pose_fusion::eval::{Score, Tally};

    use super::*;

    fn glove_scores(error: f64) -> BTreeMap<String, Score> {
        let mut tally = Tally::default();
        for k in 0..200 {
            let truth = f64::from(k % 100);
            tally.add(truth, Some((truth - error).max(0.0)));
        }
        BTreeMap::from([("glove 1".to_owned(), tally.score())])
    }

    #[test]
    fn the_table_marks_the_better_model_and_says_what_has_no_number() {
        let (base, mut with_second) = (glove_scores(20.0), glove_scores(10.0));
        with_second.insert("glove 2".to_owned(), Tally::default().score());
        let results = ResultTable::new([("tactile-only", &base), ("pose-aware", &with_second)]);
        let expected = "\
| Glove   | Model        |  BA % (+) |  F1 % (+) | MDF gF (-) | MAE gF (-) |     R2 (+) | Frames |
|---------|--------------|-----------|-----------|------------|------------|------------|--------|
| glove 1 | tactile-only |    89.69  |    88.51  |     28.33  |     17.90  |     0.586  |    200 |
| glove 1 | pose-aware   |    94.85* |    94.57* |     18.33* |      9.45* |     0.889* |    200 |
| glove 2 | tactile-only |         - |         - |          - |          - |          - |      - |
| glove 2 | pose-aware   | no touch  | no touch  |  no touch  | no frames  | no frames  |      0 |";
        assert_eq!(table(&results).to_string(), expected);
    }
}
