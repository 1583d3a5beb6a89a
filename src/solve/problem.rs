//! Problems as whole arrays: what the solvers take, and its hygiene.

use crate::error::{Error, Result};

/// Relative asymmetry that is taken for rounding and averaged away.
const SYMMETRY: f64 = 1e-12;

/// The exponent field of a number.
const EXPONENT: u64 = 0x7ff0_0000_0000_0000;

/// A batch of Riccati equations, continuous ([`care`](crate::solve::care)) or
/// discrete ([`dare`](crate::solve::dare)).
///
/// ```text
/// continuous   A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0
/// discrete     A'XA - X - (A'XB + S)(R + B'XB)^-1(B'XA + S') + Q = 0
/// ```
///
/// Arrays are in C order of shape `(len, rows, cols)`, or `(rows, cols)` for a
/// matrix that all items share. `A` n by n, `B` n by m, `Q` n by n and
/// symmetric, `R` m by m and symmetric, `S` n by m (`None` for zero). `Q` and
/// `R` may be indefinite where a stabilizing solution exists. `m` may be zero.
///
/// For a filter pass `A'` for `A` and `C'` for `B`: `X` is then the error
/// covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Riccati<'a> {
    /// Order of the state.
    pub n: usize,
    /// Number of inputs.
    pub m: usize,
    /// Number of items.
    pub len: usize,
    /// State matrix.
    pub A: &'a [f64],
    /// Input matrix.
    pub B: &'a [f64],
    /// State weight.
    pub Q: &'a [f64],
    /// Input weight.
    pub R: &'a [f64],
    /// Cross weight.
    pub S: Option<&'a [f64]>,
}

/// A batch for [`care`](crate::solve::care).
pub type Care<'a> = Riccati<'a>;
/// A batch for [`dare`](crate::solve::dare).
pub type Dare<'a> = Riccati<'a>;

/// A batch of Lyapunov equations, continuous
/// ([`lyapunov_continuous`](crate::solve::lyapunov_continuous)) or discrete
/// ([`lyapunov_discrete`](crate::solve::lyapunov_discrete)).
///
/// ```text
/// continuous   A X + X A' + Q = 0
/// discrete     A X A' - X + Q = 0
/// ```
///
/// Arrays as in [`Riccati`]; `A` and `Q` n by n, `Q` symmetric.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Lyapunov<'a> {
    /// Order.
    pub n: usize,
    /// Number of items.
    pub len: usize,
    /// Coefficient.
    pub A: &'a [f64],
    /// Right-hand side.
    pub Q: &'a [f64],
}

/// A batch of Sylvester equations, continuous
/// ([`sylvester_continuous`](crate::solve::sylvester_continuous)) or discrete
/// ([`sylvester_discrete`](crate::solve::sylvester_discrete)).
///
/// ```text
/// continuous   A X + X B + C = 0
/// discrete     A X B - X + C = 0
/// ```
///
/// Arrays as in [`Riccati`]; `A` n by n, `B` m by m, `C` and `X` n by m.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct Sylvester<'a> {
    /// Rows of `X`.
    pub n: usize,
    /// Columns of `X`.
    pub m: usize,
    /// Number of items.
    pub len: usize,
    /// Left coefficient.
    pub A: &'a [f64],
    /// Right coefficient.
    pub B: &'a [f64],
    /// Right-hand side.
    pub C: &'a [f64],
}

/// A batch of steps of the Riccati differential equation, for
/// [`riccati_ode`](crate::solve::riccati_ode).
///
/// ```text
/// dP/dt = F P + P F' - P H' R^-1 H P + Q,    P(0) = P,  wanted P(h)
/// ```
///
/// Arrays as in [`Riccati`]; `F`, `Q` and `P` n by n, `H` m by n, `R` m by m; `Q`,
/// `R`, `P` symmetric, `R` positive definite. `m` may be zero.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub struct RiccatiOde<'a> {
    /// Order of the state.
    pub n: usize,
    /// Number of outputs.
    pub m: usize,
    /// Number of items.
    pub len: usize,
    /// State matrix.
    pub F: &'a [f64],
    /// Output matrix.
    pub H: &'a [f64],
    /// Intensity of the process noise.
    pub Q: &'a [f64],
    /// Intensity of the measurement noise.
    pub R: &'a [f64],
    /// Covariance before the step.
    pub P: &'a [f64],
    /// The step in seconds, positive: one for all, or one an item.
    pub h: &'a [f64],
}

/// One argument of a batch: a matrix an item, or one for all.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Field<'a> {
    what: &'static str,
    rows: usize,
    cols: usize,
    data: &'a [f64],
    stride: usize,
    symmetric: bool,
}

impl<'a> Field<'a> {
    /// Wraps `data` after checking its length.
    ///
    /// # Errors
    /// `Shape` unless it holds one matrix or `len` of them.
    pub(crate) fn new(
        what: &'static str,
        data: &'a [f64],
        [rows, cols]: [usize; 2],
        len: usize,
        symmetric: bool,
    ) -> Result<Self> {
        let size = rows * cols;
        let stride = match data.len() {
            got if got == size => 0,
            got if Some(got) == size.checked_mul(len) => size,
            got => {
                let what = format!("array {what} (items by entries)");
                return Err(Error::Shape { what, want: [len, size], got: [1, got] });
            }
        };
        Ok(Field { what, rows, cols, data, stride, symmetric })
    }

    /// The matrix of item `k`, row by row.
    pub(crate) fn item(&self, k: usize) -> &'a [f64] {
        &self.data[k * self.stride..][..self.rows * self.cols]
    }

    /// True if all items share one matrix.
    pub(crate) fn is_shared(&self) -> bool {
        self.stride == 0
    }

    /// Rows and columns.
    pub(crate) fn shape(&self) -> (usize, usize) {
        (self.rows, self.cols)
    }

    /// True if the matrix is symmetric, up to rounding that is averaged away.
    pub(crate) fn symmetric(&self) -> bool {
        self.symmetric
    }

    /// Checks item `k` of `len`.
    fn check(&self, k: usize, len: usize) -> Result<()> {
        let named = || match len {
            1 => self.what.to_string(),
            _ => format!("item {k}: {}", self.what),
        };
        let (x, cols) = (self.item(k), self.cols);
        // One pass without branches, which any compiler makes vectors of: adding
        // one to a full exponent field carries into the sign bit. The place is
        // looked for only on failure.
        let exponent = |v: &f64| v.to_bits() & EXPONENT;
        if x.iter().fold(0, |any, v| any | (exponent(v) + (1 << 52))) >> 63 != 0 {
            let at = x.iter().position(|v| !v.is_finite()).unwrap_or(0);
            return Err(Error::NonFinite { what: named(), row: at / cols, col: at % cols });
        }
        if self.symmetric {
            if (0..self.rows).all(|i| (0..i).all(|j| x[i * cols + j] == x[j * cols + i])) {
                return Ok(());
            }
            let (mut largest, mut difference) = (0.0_f64, 0.0_f64);
            for i in 0..self.rows {
                largest = largest.max(x[i * cols + i].abs());
                for j in 0..i {
                    let (lower, upper) = (x[i * cols + j], x[j * cols + i]);
                    largest = largest.max(lower.abs()).max(upper.abs());
                    // Halves first: the difference of two numbers near the
                    // largest float must not overflow.
                    difference = difference.max((0.5 * lower - 0.5 * upper).abs());
                }
            }
            if difference > 0.5 * SYMMETRY * largest {
                let what = named();
                let relative = difference / (0.5 * largest);
                return Err(Error::NotSymmetric { what, relative });
            }
        }
        Ok(())
    }
}

/// Checks item `k` of all `fields`.
pub(crate) fn check_item(fields: &[Field<'_>], k: usize, len: usize) -> Result<()> {
    fields.iter().try_for_each(|f| f.check(k, len))
}

/// Fails with `Empty` when a size that must be positive is zero.
fn positive(sizes: &[(&str, usize)]) -> Result<()> {
    match sizes.iter().find(|(_, n)| *n == 0) {
        Some((what, _)) => Err(Error::Empty { what: (*what).into() }),
        None => Ok(()),
    }
}

impl<'a> Riccati<'a> {
    /// `A B Q R` and perhaps `S`, lengths checked.
    pub(crate) fn fields(&self) -> Result<Vec<Field<'a>>> {
        let (n, m, len) = (self.n, self.m, self.len);
        positive(&[("A (n = 0)", n), ("batch (len = 0)", len)])?;
        let mut fields = vec![
            Field::new("A", self.A, [n, n], len, false)?,
            Field::new("B", self.B, [n, m], len, false)?,
            Field::new("Q", self.Q, [n, n], len, true)?,
            Field::new("R", self.R, [m, m], len, true)?,
        ];
        if let Some(s) = self.S {
            fields.push(Field::new("S", s, [n, m], len, false)?);
        }
        Ok(fields)
    }
}

impl<'a> RiccatiOde<'a> {
    /// `F H Q R P h`, lengths checked.
    pub(crate) fn fields(&self) -> Result<Vec<Field<'a>>> {
        let (n, m, len) = (self.n, self.m, self.len);
        positive(&[("F (n = 0)", n), ("batch (len = 0)", len)])?;
        Ok(vec![
            Field::new("F", self.F, [n, n], len, false)?,
            Field::new("H", self.H, [m, n], len, false)?,
            Field::new("Q", self.Q, [n, n], len, true)?,
            Field::new("R", self.R, [m, m], len, true)?,
            Field::new("P", self.P, [n, n], len, true)?,
            Field::new("h", self.h, [1, 1], len, false)?,
        ])
    }
}

impl<'a> Lyapunov<'a> {
    /// `A Q`, lengths checked.
    pub(crate) fn fields(&self) -> Result<Vec<Field<'a>>> {
        let (n, len) = (self.n, self.len);
        positive(&[("A (n = 0)", n), ("batch (len = 0)", len)])?;
        Ok(vec![
            Field::new("A", self.A, [n, n], len, false)?,
            Field::new("Q", self.Q, [n, n], len, true)?,
        ])
    }
}

impl<'a> Sylvester<'a> {
    /// `A B C`, lengths checked.
    pub(crate) fn fields(&self) -> Result<Vec<Field<'a>>> {
        let (n, m, len) = (self.n, self.m, self.len);
        positive(&[("A (n = 0)", n), ("B (m = 0)", m), ("batch (len = 0)", len)])?;
        Ok(vec![
            Field::new("A", self.A, [n, n], len, false)?,
            Field::new("B", self.B, [m, m], len, false)?,
            Field::new("C", self.C, [n, m], len, false)?,
        ])
    }
}
