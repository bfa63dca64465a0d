//! Matrices on slices.

/// A row-major matrix, or its transpose.
#[derive(Debug, Clone, Copy)]
pub struct Matrix<'a> {
    pub(super) data: &'a [f32],
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) row_stride: usize,
    pub(super) column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// A matrix whose rows stand one behind the other.
    pub fn new(data: &'a [f32], rows: usize, columns: usize) -> Self {
        assert_eq!(data.len(), rows * columns, "a matrix of {rows} x {columns}");
        Matrix { data, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// A matrix whose rows start `row_stride` numbers apart.
    pub fn strided(data: &'a [f32], rows: usize, columns: usize, row_stride: usize) -> Self {
        assert!(
            rows == 0 || (rows - 1) * row_stride + columns <= data.len(),
            "{rows} rows of {columns} in {row_stride}"
        );
        Matrix { data, rows, columns, row_stride, column_stride: 1 }
    }

    /// The same numbers with rows and columns exchanged.
    pub fn transposed(self) -> Self {
        Matrix {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    /// Its values, row-major.
    pub fn to_rows(self) -> Vec<f32> {
        let at = |row: usize, column: usize| self.data[row * self.row_stride + column * self.column_stride];
        (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| at(row, column))).collect()
    }
}
