//! Products of matrices that change from call to call, for training.
//!
//! A tile of the result stays in registers over the whole inner axis, so neither factor is packed. Each value is summed
//! in the order of the inner axis. The result therefore doesn't depend on the vector width of the machine, only on
//! whether it has fused multiply-add.

use macerator::{AutoArch, Scalar, Simd, WithSimd};

use super::matrix::Matrix;
use super::{lanes, load};

/// `out = a b`, `out` row-major.
pub fn multiply(out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) {
    out.fill(0.0);
    add_product(out, a, b);
}

/// `out += a b`, `out` row-major. Fastest if both are row-major. One that isn't is first copied to that order.
pub fn add_product(out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) {
    assert_eq!(a.columns, b.rows, "the inner axes of a product");
    assert_eq!(out.len(), a.rows * b.columns, "a product of {} x {}", a.rows, b.columns);
    let copied = [a, b].map(|matrix| (matrix.column_stride != 1).then(|| matrix.to_rows()));
    let [a, b] = [(a, &copied[0]), (b, &copied[1])].map(|(matrix, copied)| match copied {
        Some(rows) => Matrix::new(rows, matrix.rows, matrix.columns),
        None => matrix,
    });
    AutoArch::new().dispatch(Product { out, a, b });
}

/// `out += column sums of rows`: the gradient of a bias.
pub fn add_column_sums(out: &mut [f32], rows: &[f32]) {
    for row in rows.chunks_exact(out.len()) {
        out.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
}

/// Adds the product of two row-major matrices.
struct Product<'a> {
    out: &'a mut [f32],
    a: Matrix<'a>,
    b: Matrix<'a>,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self) {
        let lanes = lanes::<S>();
        let columns = self.b.columns;
        let mut from = 0;
        // Registers: 6 rows of 4 vectors fill the 32 of AVX-512 and NEON, 6 rows of 2 vectors the 16 of AVX2.
        if lanes != 8 {
            while from + 4 * lanes <= columns {
                self.columns::<S, 4>(from);
                from += 4 * lanes;
            }
        }
        while from + 2 * lanes <= columns {
            self.columns::<S, 2>(from);
            from += 2 * lanes;
        }
        while from + lanes <= columns {
            self.columns::<S, 1>(from);
            from += lanes;
        }
        if from < columns {
            self.last_columns::<S>(from);
        }
    }
}

impl Product<'_> {
    /// Computes the columns of `V` vectors.
    #[inline(always)]
    fn columns<S: Simd, const V: usize>(&mut self, from: usize) {
        let mut row = 0;
        while row + 6 <= self.a.rows {
            self.tile::<S, 6, V>(row, from);
            row += 6;
        }
        match self.a.rows - row {
            5 => self.tile::<S, 5, V>(row, from),
            4 => self.tile::<S, 4, V>(row, from),
            3 => self.tile::<S, 3, V>(row, from),
            2 => self.tile::<S, 2, V>(row, from),
            1 => self.tile::<S, 1, V>(row, from),
            _ => {}
        }
    }

    /// Computes a tile of `R` rows and `V` vectors.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "counted loops are unrolled, so that the sums stay in registers")]
    fn tile<S: Simd, const R: usize, const V: usize>(&mut self, row: usize, from: usize) {
        let Matrix { data, columns: inner, row_stride, .. } = self.a;
        let lanes = lanes::<S>();
        let width = self.b.columns;
        // A slice a row, so that its bound is not checked, nor its address computed, in the inner loop.
        let rows: [&[f32]; R] = std::array::from_fn(|r| &data[(row + r) * row_stride..][..inner]);
        let mut sums = [[0.0f32.splat::<S>(); V]; R];
        for k in 0..inner {
            let line = &self.b.data[k * self.b.row_stride + from..][..V * lanes];
            let mut factors = [0.0f32.splat::<S>(); V];
            for v in 0..V {
                factors[v] = load(&line[v * lanes..(v + 1) * lanes]);
            }
            for r in 0..R {
                let a = rows[r][k].splat::<S>();
                for v in 0..V {
                    sums[r][v] = a.mul_add(factors[v], sums[r][v]);
                }
            }
        }
        for r in 0..R {
            let line = &mut self.out[(row + r) * width + from..][..V * lanes];
            for v in 0..V {
                let part = &mut line[v * lanes..(v + 1) * lanes];
                let sum = load::<S>(part) + sums[r][v];
                part.copy_from_slice(bytemuck::cast_slice(std::slice::from_ref(&sum)));
            }
        }
    }

    /// Computes the remaining columns, padded to one vector.
    #[inline(always)]
    fn last_columns<S: Simd>(&mut self, from: usize) {
        let (lanes, width) = (lanes::<S>(), self.b.columns);
        let (n, rows) = (width - from, self.a.rows);
        let mut b = vec![0.0; self.b.rows * lanes];
        for (k, padded) in b.chunks_exact_mut(lanes).enumerate() {
            padded[..n].copy_from_slice(&self.b.data[k * self.b.row_stride + from..][..n]);
        }
        let mut out = vec![0.0; rows * lanes];
        Product { out: &mut out, a: self.a, b: Matrix::new(&b, self.b.rows, lanes) }.columns::<S, 1>(0);
        for (row, padded) in out.chunks_exact(lanes).enumerate() {
            let line = &mut self.out[row * width + from..(row + 1) * width];
            line.iter_mut().zip(padded).for_each(|(sum, value)| *sum += value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_size_and_layout_gives_the_product() {
        let number = |idx: usize| ((idx * 37 + 11) % 19) as f32 - 9.0; // small integers: sums are exact
        let turned =
            |values: &[f32], rows: usize, columns: usize| Matrix::new(values, rows, columns).transposed().to_rows();
        for rows in [1, 2, 5, 6, 8, 9, 17] {
            for inner in [0, 1, 3, 8, 20] {
                for columns in [1, 4, 7, 8, 13, 16, 39, 64, 107] {
                    let a: Vec<f32> = (0..rows * inner).map(number).collect();
                    let b: Vec<f32> = (0..inner * columns).map(|idx| number(idx + 5)).collect();
                    let (a_turned, b_turned) = (turned(&a, rows, inner), turned(&b, inner, columns));
                    let dot =
                        |r: usize, c: usize| (0..inner).map(|i| a[r * inner + i] * b[i * columns + c]).sum::<f32>();
                    let expected: Vec<f32> = (0..rows * columns).map(|idx| dot(idx / columns, idx % columns)).collect();
                    let onto: Vec<f32> = expected.iter().map(|value| value + 2.0).collect();
                    for a in [Matrix::new(&a, rows, inner), Matrix::new(&a_turned, inner, rows).transposed()] {
                        for b in [Matrix::new(&b, inner, columns), Matrix::new(&b_turned, columns, inner).transposed()]
                        {
                            let mut out = vec![f32::NAN; rows * columns];
                            multiply(&mut out, a, b);
                            assert_eq!(out, expected, "{rows} x {inner} x {columns}");
                            out.fill(2.0);
                            add_product(&mut out, a, b);
                            assert_eq!(out, onto, "{rows} x {inner} x {columns}");
                        }
                    }
                }
            }
        }
    }
}
