//! Which counts explain the length of an array: samples one after another, and taxels in a sample.

use super::hints;
use crate::msg::definition::TypeTree;
use crate::msg::dynamic::{FieldPlan, ReadAs, ReadError, numeric_paths};

/// Most pairs of rows and columns that are tried on the arrays of one type.
const MAX_GRIDS: usize = 4;

/// Counts that may explain the length of an array.
#[derive(Debug)]
pub(super) enum Grid {
    /// Two fields of the message, or one.
    Fields { rows: FieldPlan, cols: Option<FieldPlan> },
    /// The sizes of a `std_msgs/MultiArrayLayout`.
    Layout(FieldPlan),
}

/// How a [`Grid`] stands to an array.
#[derive(Debug, Clone, Default)]
pub(super) struct GridFit {
    n_fits: u64,
    /// Fewest and most.
    pub(super) rows: [u64; 2],
    /// Fewest and most, where it says or the rows leave them.
    pub(super) cols: [u64; 2],
}

/// Pairs of counts in a type whose names say rows and columns.
pub(super) fn grids(tree: &TypeTree) -> Vec<Grid> {
    if tree.root().field("encoding").is_some() && tree.root().field("step").is_some() {
        return Vec::new(); // height and width of an image are one grid of taxels, no samples after one another
    }
    if let Ok(sizes) = FieldPlan::compile(tree, "layout.dim[].size", ReadAs::Numbers) {
        return vec![Grid::Layout(sizes)];
    }
    let counts: Vec<FieldPlan> = numeric_paths(tree)
        .iter()
        .filter(|numeric| !numeric.kind.many)
        .filter_map(|numeric| FieldPlan::compile(tree, &numeric.path, ReadAs::Count).ok())
        .collect();
    let (parent, name) =
        (|plan: &FieldPlan| split(plan.path()).0.to_owned(), |plan: &FieldPlan| split(plan.path()).1.to_owned());
    let named =
        |hints: &'static [&'static str]| counts.iter().filter(move |plan| hints::found(&name(plan), hints).is_some());
    let mut grids = Vec::new();
    for rows in named(hints::ROWS) {
        let pairs = named(hints::COLS).filter(|cols| parent(cols) == parent(rows) && cols.path() != rows.path());
        grids.extend(pairs.map(|cols| Grid::Fields { rows: rows.clone(), cols: Some(cols.clone()) }));
        grids.push(Grid::Fields { rows: rows.clone(), cols: None });
    }
    grids.truncate(MAX_GRIDS);
    grids
}

impl Grid {
    /// Rows and columns that a message states.
    pub(super) fn read(&self, cdr: &[u8], sizes: &mut Vec<f32>) -> Result<Option<(u64, Option<u64>)>, ReadError> {
        match self {
            Grid::Fields { rows, cols } => {
                let cols = cols.as_ref().map(|cols| cols.read_count(cdr)).transpose()?;
                rows.read_count(cdr).map(|rows| Some((rows, cols)))
            }
            Grid::Layout(plan) => {
                sizes.clear();
                plan.read_f32(cdr, sizes)?;
                Ok(match sizes[..] {
                    [rows, cols] => Some((rows as u64, Some(cols as u64))),
                    _ => None,
                })
            }
        }
    }
}

impl GridFit {
    /// Takes in the length of an array and what the message states about it.
    pub(super) fn handle(&mut self, len: u64, stated: Option<(u64, Option<u64>)>) {
        let Some((rows, cols)) = stated else { return };
        let left = len.checked_div(rows).unwrap_or(0);
        if rows > 0 && len > 0 && rows.checked_mul(cols.unwrap_or(left)) == Some(len) {
            self.rows = spanned(self.n_fits, self.rows, rows);
            self.cols = spanned(self.n_fits, self.cols, left);
            self.n_fits += 1;
        }
    }

    /// Whether it explained the length of each of `n` arrays.
    pub(super) fn explains(&self, n: u64) -> bool {
        self.n_fits > 0 && self.n_fits == n
    }
}

/// Where a field is, and its own name.
pub(super) fn split(path: &str) -> (&str, &str) {
    path.rsplit_once('.').unwrap_or(("", path))
}

/// Fewest and most, with one more value.
pub(super) fn spanned(n_before: u64, [least, most]: [u64; 2], value: u64) -> [u64; 2] {
    if n_before == 0 { [value, value] } else { [least.min(value), most.max(value)] }
}
