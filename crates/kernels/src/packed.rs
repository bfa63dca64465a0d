//! Products with a matrix that stays the same, for inference.
//!
//! A tile of the result stays in registers over the whole inner axis. Each value is summed in the order of the inner
//! axis. The result therefore doesn't depend on the vector width of the machine, only on whether it has fused
//! multiply-add.

use std::ops::Range;

use macerator::{AutoArch, Scalar, Simd, Vector, WithSimd};

use super::matrix::Matrix;
use super::{lanes, load};

/// Steps of the inner axis that are written out one after the other: addresses are then computed once for all of them,
/// and bounds are checked once.
const STEPS: usize = 4;

/// The right factor of many products, in panels of as many columns as a tile has. Each panel is contiguous.
#[derive(Debug, Clone)]
pub struct Packed {
    panels: Vec<f32>,
    rows: usize,
    columns: usize,
    /// As many as there are columns.
    zeros: Vec<f32>,
}

/// What a product is added to.
#[derive(Debug, Clone, Copy)]
pub enum Onto<'a> {
    /// Nothing.
    Zero,
    /// The values that `out` has.
    Out,
    /// The same row for every row of the product.
    Row(&'a [f32]),
    /// As many values as the product has.
    Rows(&'a [f32]),
}

impl Packed {
    /// Lays out a matrix for the vectors of this machine.
    pub fn new(matrix: Matrix<'_>) -> Self {
        AutoArch::new().dispatch(Pack(matrix))
    }

    /// Length of the inner axis.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// `out = onto + a b`, where `b` is this factor. `a` has to be row-major, `out` is.
    pub fn product(&self, a: Matrix<'_>, onto: Onto<'_>, out: &mut [f32]) {
        assert_eq!((a.columns, a.column_stride), (self.rows, 1), "the inner axes of a product");
        assert_eq!(out.len(), a.rows * self.columns, "a product of {} x {}", a.rows, self.columns);
        let onto = match onto {
            Onto::Zero => Some((self.zeros.as_slice(), 0)),
            Onto::Out => None,
            Onto::Row(row) => Some((row, 0)),
            Onto::Rows(rows) => Some((rows, self.columns)),
        };
        AutoArch::new().dispatch(Product { out, onto, a, b: self });
    }
}

struct Pack<'a>(Matrix<'a>);

impl WithSimd for Pack<'_> {
    type Output = Packed;

    #[inline(always)]
    fn with_simd<S: Simd>(self) -> Packed {
        let Matrix { data, rows, columns, row_stride, column_stride } = self.0;
        let mut panels = Vec::with_capacity(rows * columns.next_multiple_of(lanes::<S>()));
        for panel in panels_of::<S>(columns) {
            for row in 0..rows {
                let at = |column: usize| {
                    if column < columns { data[row * row_stride + column * column_stride] } else { 0.0 }
                };
                panels.extend(panel.clone().map(at));
            }
        }
        Packed { panels, rows, columns, zeros: vec![0.0; columns] }
    }
}

/// The columns of each panel: of 4, 2 or 1 vectors. The last one may end after the last column.
///
/// 6 rows of 4 vectors fill the 32 registers of AVX-512, 6 rows of 2 vectors the 16 of AVX2. NEON has 32, too, but keeps
/// the factors of four steps in them: with 4 vectors, the sums would leave them.
#[inline(always)]
fn panels_of<S: Simd>(columns: usize) -> impl Iterator<Item = Range<usize>> {
    let lanes = lanes::<S>();
    let widest = if lanes == 16 { 4 } else { 2 };
    let mut from = 0;
    std::iter::from_fn(move || {
        let fits = |vectors: &usize| from + vectors * lanes <= columns;
        let vectors = [widest, 2].into_iter().find(fits).unwrap_or(1);
        let panel = from..from + vectors * lanes;
        from = panel.end;
        (panel.start < columns).then_some(panel)
    })
}

struct Product<'a> {
    out: &'a mut [f32],
    /// What the product is added to, and the distance of its rows. `None` for `out`.
    onto: Option<(&'a [f32], usize)>,
    a: Matrix<'a>,
    b: &'a Packed,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self) {
        for Range { start, end } in panels_of::<S>(self.b.columns) {
            match (end - start) / lanes::<S>() {
                4 => self.panel::<S, 4, true>(start),
                2 => self.panel::<S, 2, true>(start),
                _ if end <= self.b.columns => self.panel::<S, 1, true>(start),
                _ => self.panel::<S, 1, false>(start),
            }
        }
    }
}

impl Product<'_> {
    /// Computes the columns of a panel of `V` vectors. Unless it is `WHOLE`, it ends after the last column.
    #[inline(always)]
    fn panel<S: Simd, const V: usize, const WHOLE: bool>(&mut self, from: usize) {
        let mut row = 0;
        while row + 6 <= self.a.rows {
            self.tile::<S, 6, V, WHOLE>(row, from);
            row += 6;
        }
        match self.a.rows - row {
            5 => self.tile::<S, 5, V, WHOLE>(row, from),
            4 => self.tile::<S, 4, V, WHOLE>(row, from),
            3 => self.tile::<S, 3, V, WHOLE>(row, from),
            2 => self.tile::<S, 2, V, WHOLE>(row, from),
            1 => self.tile::<S, 1, V, WHOLE>(row, from),
            _ => {}
        }
    }

    /// Computes a tile of `R` rows and `V` vectors.
    ///
    /// Its loops stand in one function: with parts of them in others, or closures as of `array::map`, the compiler lets
    /// the sums leave the registers, which costs a tenth of the speed.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "counted loops are unrolled, so that the sums stay in registers")]
    fn tile<S: Simd, const R: usize, const V: usize, const WHOLE: bool>(&mut self, row: usize, from: usize) {
        let (lanes, width) = (lanes::<S>(), V * lanes::<S>());
        let Matrix { data, row_stride, .. } = self.a;
        let Packed { ref panels, rows: inner, .. } = *self.b;
        let (n_whole, n_rest) = (inner / STEPS, inner % STEPS);
        let (mut whole, mut rest) = ([&[][..]; R], [&[][..]; R]);
        for r in 0..R {
            let (steps, others) = data[(row + r) * row_stride..][..inner].as_chunks::<STEPS>();
            (whole[r], rest[r]) = (&steps[..n_whole], &others[..n_rest]);
        }
        let panel = &panels[from * inner..][..width * inner];
        let (whole_lines, rest_lines) = panel.split_at(n_whole * STEPS * width);
        let mut sums = [[0.0f32.splat::<S>(); V]; R];
        for (k, lines) in (0..n_whole).zip(whole_lines.chunks_exact(STEPS * width)) {
            for step in 0..STEPS {
                let mut factors = [0.0f32.splat::<S>(); V];
                for v in 0..V {
                    factors[v] = load(&lines[step * width + v * lanes..][..lanes]);
                }
                for r in 0..R {
                    let a = whole[r][k][step].splat::<S>();
                    for v in 0..V {
                        sums[r][v] = a.mul_add(factors[v], sums[r][v]);
                    }
                }
            }
        }
        for (k, line) in (0..n_rest).zip(rest_lines.chunks_exact(width)) {
            let mut factors = [0.0f32.splat::<S>(); V];
            for v in 0..V {
                factors[v] = load(&line[v * lanes..][..lanes]);
            }
            for r in 0..R {
                let a = rest[r][k].splat::<S>();
                for v in 0..V {
                    sums[r][v] = a.mul_add(factors[v], sums[r][v]);
                }
            }
        }
        for r in 0..R {
            match WHOLE {
                true => self.put::<S, V>(row + r, from, sums[r]),
                false => self.put_last::<S, V>(row + r, from, sums[r]),
            }
        }
    }

    #[inline(always)]
    fn put<S: Simd, const V: usize>(&mut self, row: usize, from: usize, sums: [Vector<S, f32>; V]) {
        let (lanes, at) = (lanes::<S>(), row * self.b.columns + from);
        let onto = match self.onto {
            Some((values, stride)) => load_all::<S, V>(&values[row * stride + from..][..V * lanes]),
            None => load_all::<S, V>(&self.out[at..][..V * lanes]),
        };
        let out = &mut self.out[at..][..V * lanes];
        for v in 0..V {
            let sum = onto[v] + sums[v];
            out[v * lanes..][..lanes].copy_from_slice(bytemuck::cast_slice(std::slice::from_ref(&sum)));
        }
    }

    #[inline(always)]
    fn put_last<S: Simd, const V: usize>(&mut self, row: usize, from: usize, sums: [Vector<S, f32>; V]) {
        let columns = self.b.columns;
        for (column, sum) in (from..columns).zip(bytemuck::cast_slice::<_, f32>(&sums)) {
            let onto = match self.onto {
                Some((values, stride)) => values[row * stride + column],
                None => self.out[row * columns + column],
            };
            self.out[row * columns + column] = onto + sum;
        }
    }
}

/// `V` vectors.
#[inline(always)]
fn load_all<S: Simd, const V: usize>(values: &[f32]) -> [Vector<S, f32>; V] {
    let mut all = [0.0f32.splat::<S>(); V];
    for v in 0..V {
        all[v] = load(&values[v * lanes::<S>()..][..lanes::<S>()]);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::product::add_product;

    #[test]
    fn every_size_has_the_bits_of_a_product_that_is_not_packed() {
        let numbers = |n: usize, of: usize| -> Vec<f32> {
            (0..n).map(|idx| ((idx * 37 + of) as f32 * 0.61).sin() * 3.0).collect()
        };
        for rows in [0, 1, 2, 3, 4, 5, 6, 7, 13] {
            for inner in [0, 1, 3, 4, 7, 8, 21] {
                for columns in [1, 4, 7, 8, 13, 16, 24, 39, 64, 107] {
                    let (a, b) = (numbers(rows * (inner + 2), 1), numbers(inner * columns, 2));
                    let a = match rows {
                        0 => Matrix::new(&[], 0, inner),
                        _ => Matrix::strided(&a, rows, inner, inner + 2),
                    };
                    let b = Matrix::new(&b, inner, columns);
                    let (before, row) = (numbers(rows * columns, 3), numbers(columns, 4));
                    let same_row: Vec<f32> = (0..rows).flat_map(|_| row.clone()).collect();
                    let zeros = vec![0.0; rows * columns];
                    for (onto, start) in [
                        (Onto::Zero, &zeros),
                        (Onto::Out, &before),
                        (Onto::Row(&row), &same_row),
                        (Onto::Rows(&before), &before),
                    ] {
                        let mut expected = start.clone();
                        add_product(&mut expected, a, b);
                        let mut out =
                            if matches!(onto, Onto::Out) { before.clone() } else { vec![f32::NAN; rows * columns] };
                        Packed::new(b).product(a, onto, &mut out);
                        assert_eq!(out, expected, "{rows} x {inner} x {columns} onto {onto:?}");
                    }
                }
            }
        }
    }
}
