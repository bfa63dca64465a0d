//! Matrix products on slices.

use nalgebra::{DMatrixView, DMatrixViewMut, Dyn};

/// A row-major matrix, or its transpose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Matrix<'a> {
    data: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    pub(super) fn new(data: &'a [f32], rows: usize, columns: usize) -> Self {
        Matrix { data, rows, columns, row_stride: columns, column_stride: 1 }
    }

    pub(super) fn transposed(self) -> Self {
        Matrix {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    fn view(self) -> DMatrixView<'a, f32, Dyn, Dyn> {
        DMatrixView::from_slice_with_strides_generic(
            self.data,
            Dyn(self.rows),
            Dyn(self.columns),
            Dyn(self.row_stride),
            Dyn(self.column_stride),
        )
    }
}

/// Products with an axis shorter than this are done by plain loops: nalgebra 0.35 sends those with up to 5 to a path of
/// its own that doesn't hold for strided views, all others to `matrixmultiply`.
const SMALL: usize = 8;

/// `out = keep * out + a b`, `out` row-major.
pub(super) fn multiply(out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>, keep: f32) {
    if a.rows.min(a.columns).min(b.columns) < SMALL {
        return multiply_small(out, a, b, keep);
    }
    // nalgebra counts columns first: the row-major `out` is the transpose of what it writes.
    let mut out = DMatrixViewMut::<f32, Dyn, Dyn>::from_slice_with_strides_generic(
        out,
        Dyn(b.columns),
        Dyn(a.rows),
        Dyn(1),
        Dyn(b.columns),
    );
    out.gemm(1.0, &b.transposed().view(), &a.transposed().view(), keep);
}

fn multiply_small(out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>, keep: f32) {
    for (row_idx, row) in out.chunks_exact_mut(b.columns.max(1)).enumerate().take(a.rows) {
        // What is not kept isn't read either: it may be NaN.
        row.iter_mut().for_each(|value| *value = if keep == 0.0 { 0.0 } else { keep * *value });
        for inner in 0..a.columns {
            let factor = a.data[row_idx * a.row_stride + inner * a.column_stride];
            for (column, value) in row.iter_mut().enumerate() {
                *value += factor * b.data[inner * b.row_stride + column * b.column_stride];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_size_and_layout_gives_the_product() {
        let number = |idx: usize| ((idx * 37 + 11) % 19) as f32 - 9.0; // small whole numbers: sums are exact
        for rows in [1, 2, 5, 6, 8, 9, 17] {
            for inner in [1, 3, 6, 8, 20] {
                for columns in [1, 4, 7, 8, 13] {
                    let a: Vec<f32> = (0..rows * inner).map(number).collect();
                    let b: Vec<f32> = (0..inner * columns).map(|idx| number(idx + 5)).collect();
                    let turned = |values: &[f32], rows: usize, columns: usize| -> Vec<f32> {
                        (0..columns).flat_map(|c| (0..rows).map(move |r| values[r * columns + c])).collect()
                    };
                    let (a_turned, b_turned) = (turned(&a, rows, inner), turned(&b, inner, columns));
                    let expected = |keep: f32| -> Vec<f32> {
                        let dot =
                            |r: usize, c: usize| (0..inner).map(|i| a[r * inner + i] * b[i * columns + c]).sum::<f32>();
                        (0..rows * columns).map(|idx| keep * 2.0 + dot(idx / columns, idx % columns)).collect()
                    };
                    for keep in [0.0, 1.0] {
                        for a in [Matrix::new(&a, rows, inner), Matrix::new(&a_turned, inner, rows).transposed()] {
                            for b in
                                [Matrix::new(&b, inner, columns), Matrix::new(&b_turned, columns, inner).transposed()]
                            {
                                let mut out = vec![if keep == 0.0 { f32::NAN } else { 2.0 }; rows * columns];
                                multiply(&mut out, a, b, keep);
                                assert_eq!(out, expected(keep), "{rows} x {inner} x {columns}");
                            }
                        }
                    }
                }
            }
        }
    }
}
