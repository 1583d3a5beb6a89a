//! Closing a loop: the interconnection, without allocation when repeated.

use faer::{Mat, MatRef};

use crate::error::{Error, Result};
use crate::model::discretize::{DelayLine, pade_delay};
use crate::model::{Controller, DelayForm, Delayed, LoopBlock, Plant, Shaping, Time};

/// What a loop is closed with.
#[derive(Clone, Copy)]
pub(crate) struct Around<'a> {
    pub(crate) controller: Option<&'a Controller>,
    pub(crate) input: Option<&'a Shaping>,
}

/// Closes loops one after the other, keeping the square roots of the noise
/// while it stays the same.
pub(crate) struct Closing {
    disturbance: Root,
    input: Root,
    measurement: Root,
    from_u: Mat<f64>,
}

/// A matrix and its [`psd_factor`].
struct Root {
    of: Mat<f64>,
    root: Mat<f64>,
}

impl Root {
    fn new() -> Self {
        Self { of: Mat::new(), root: Mat::new() }
    }

    fn set(&mut self, of: &Mat<f64>) -> MatRef<'_, f64> {
        if self.of != *of {
            self.root = psd_factor(of.as_ref());
            self.of.clone_from(of);
        }
        self.root.as_ref()
    }
}

impl Closing {
    pub(crate) fn new() -> Self {
        Self {
            disturbance: Root::new(),
            input: Root::new(),
            measurement: Root::new(),
            from_u: Mat::new(),
        }
    }

    /// Closes the loop around `plant`, which carries its disturbance filter
    /// already, with an actuator delay of `delay` seconds; see
    /// [`LoopBlock::new`].
    pub(crate) fn loop_of(
        &mut self,
        plant: &Plant,
        around: Around<'_>,
        delay: f64,
        form: DelayForm,
        block: &mut LoopBlock,
    ) -> Result<()> {
        if !(delay >= 0.0 && delay.is_finite()) {
            return Err(Error::Range {
                what: "actuator delay".into(),
                value: delay,
                remedy: "give seconds, zero or more".into(),
            });
        }
        if delay == 0.0 || plant.nu() == 0 {
            self.close(plant, around, None, block);
            return Ok(());
        }
        let line = match (plant.time, form) {
            (Time::Continuous, DelayForm::States { pade }) => pade_delay(plant, delay, pade),
            (Time::Continuous, DelayForm::Exact) => {
                self.close(plant, around, None, block);
                let (a, b) = (block.A.clone(), block.B.clone());
                self.close(plant, around, Some(&DelayLine::cut(plant)), block);
                block.delayed = Some(Delayed { tau: delay, A: &a - &block.A, B: &b - &block.B });
                return Ok(());
            }
            (Time::Discrete { dt }, _) => DelayLine::whole_samples(plant, delay, dt)?,
        };
        self.close(plant, around, Some(&line), block);
        Ok(())
    }

    /// The interconnection, into the buffers of `block`
    ///
    /// ```text
    /// x'   = A x + Bx x_d + B0 u + G Q^1/2 w1      plant and disturbance filter
    /// x_d' = Ad x_d + Bd u                         delay line
    /// x_K' = A_K x_K + B_K y                       controller
    /// x_r' = A_r x_r + B_r Q_r^1/2 w2              input filter
    /// y = C x + R^1/2 w3,   u = C_K x_K + D_K y + C_r x_r
    /// ```
    ///
    /// Without a line `B0 = B`.
    pub(crate) fn close(
        &mut self,
        plant: &Plant,
        around: Around<'_>,
        line: Option<&DelayLine>,
        block: &mut LoopBlock,
    ) {
        let Around { controller, input } = around;
        let (nx, nu, ny) = (plant.nx(), plant.nu(), plant.ny());
        let nd = line.map_or(0, |l| l.A.nrows());
        let nk = controller.map_or(0, |k| k.A.nrows());
        let nr = input.map_or(0, Shaping::nf);
        let np = nx + nd + nk + nr;
        let (at_d, at_k, at_r) = (nx, nx + nd, nx + nd + nk);

        let root_q = self.disturbance.set(&plant.Q);
        let root_r = self.measurement.set(&plant.R);
        let input = input.map(|f| (f, self.input.set(&f.Q)));
        let (n1, n3) = (root_q.ncols(), root_r.ncols());
        let n2 = input.map_or(0, |(_, root)| root.ncols());
        let (at_w3, nw) = (n1 + n2, n1 + n2 + n3);

        block.time = plant.time;
        block.delayed = None;
        blank(&mut block.A, np, np);
        blank(&mut block.B, np, nw);
        blank(&mut block.Cy, ny, np);
        blank(&mut block.Dy, ny, nw);
        blank(&mut block.Cu, nu, np);
        blank(&mut block.Du, nu, nw);

        put(&mut block.Cy, 0, 0, plant.C.as_ref());
        put(&mut block.Dy, 0, at_w3, root_r);
        if let Some(k) = controller {
            add_product(&mut block.Cu, 0, 0, k.D.as_ref(), plant.C.as_ref());
            put(&mut block.Cu, 0, at_k, k.C.as_ref());
            add_product(&mut block.Du, 0, at_w3, k.D.as_ref(), root_r);
        }
        if let Some((f, _)) = input {
            put(&mut block.Cu, 0, at_r, f.C.as_ref());
        }

        // what does not pass through u
        put(&mut block.A, 0, 0, plant.A.as_ref());
        if let Some(line) = line {
            put(&mut block.A, 0, at_d, line.Bx.as_ref());
            put(&mut block.A, at_d, at_d, line.A.as_ref());
        }
        add_product(&mut block.B, 0, 0, plant.G.as_ref(), root_q);
        if let Some(k) = controller {
            put(&mut block.A, at_k, at_k, k.A.as_ref());
            add_product(&mut block.A, at_k, 0, k.B.as_ref(), plant.C.as_ref());
            add_product(&mut block.B, at_k, at_w3, k.B.as_ref(), root_r);
        }
        if let Some((f, root)) = input {
            put(&mut block.A, at_r, at_r, f.A.as_ref());
            add_product(&mut block.B, at_r, n1, f.B.as_ref(), root);
        }
        // what does
        blank(&mut self.from_u, np, nu);
        match line {
            None => put(&mut self.from_u, 0, 0, plant.B.as_ref()),
            Some(line) => {
                put(&mut self.from_u, 0, 0, line.B0.as_ref());
                put(&mut self.from_u, at_d, 0, line.B.as_ref());
            }
        }
        add_product(&mut block.A, 0, 0, self.from_u.as_ref(), block.Cu.as_ref());
        add_product(&mut block.B, 0, 0, self.from_u.as_ref(), block.Du.as_ref());
    }
}

/// Makes `m` a zero matrix of the given size, in its own memory where it has
/// that size already.
pub(crate) fn blank(m: &mut Mat<f64>, rows: usize, cols: usize) {
    if (m.nrows(), m.ncols()) == (rows, cols) {
        for j in 0..cols {
            m.col_as_slice_mut(j).fill(0.0);
        }
    } else {
        *m = Mat::zeros(rows, cols);
    }
}

/// Adds `A B` to the part of `into` that starts at `(row, col)`, by plain loops:
/// an order of magnitude faster than the general product on matrices this
/// small, and one plant of a grid takes a dozen of them.
pub(crate) fn add_product(
    into: &mut Mat<f64>,
    row: usize,
    col: usize,
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
) {
    for j in 0..b.ncols() {
        let column = &mut into.col_as_slice_mut(col + j)[row..row + a.nrows()];
        for k in 0..a.ncols() {
            let factor = b[(k, j)];
            if factor != 0.0 {
                for (i, c) in column.iter_mut().enumerate() {
                    *c += factor * a[(i, k)];
                }
            }
        }
    }
}

/// `A B` by plain loops, see [`add_product`]; the general product also wakes the
/// thread pool.
pub(crate) fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    add_product(&mut out, 0, 0, a, b);
    out
}

/// Writes `from` at `(row, col)` of `into`.
pub(crate) fn put(into: &mut Mat<f64>, row: usize, col: usize, from: MatRef<'_, f64>) {
    for j in 0..from.ncols() {
        let column = &mut into.col_as_slice_mut(col + j)[row..row + from.nrows()];
        for (i, x) in column.iter_mut().enumerate() {
            *x = from[(i, j)];
        }
    }
}

/// `L` with `L L' = Q` for a positive semidefinite `Q`: Cholesky with diagonal
/// pivoting that stops at the numerical rank.
pub(crate) fn psd_factor(q: MatRef<'_, f64>) -> Mat<f64> {
    let n = q.nrows();
    let mut rest = Mat::from_fn(n, n, |i, j| 0.5 * (q[(i, j)] + q[(j, i)]));
    let mut factor = Mat::<f64>::zeros(n, n);
    let diagonal: Vec<f64> = (0..n).map(|i| rest[(i, i)]).collect();
    // pivots are judged against their own diagonal: channels may differ in
    // units by any factor
    let share = |rest: &Mat<f64>, i: usize| {
        if diagonal[i] > 0.0 { rest[(i, i)] / diagonal[i] } else { 0.0 }
    };
    let mut taken = vec![false; n];
    for k in 0..n {
        let Some(p) = (0..n)
            .filter(|&i| !taken[i])
            .max_by(|&i, &j| share(&rest, i).total_cmp(&share(&rest, j)))
        else {
            break;
        };
        if share(&rest, p) <= 8.0 * f64::EPSILON * n as f64 {
            break;
        }
        let pivot = rest[(p, p)];
        taken[p] = true;
        let root = pivot.sqrt();
        for i in 0..n {
            factor[(i, k)] = if i == p {
                root
            } else if taken[i] {
                0.0
            } else {
                rest[(i, p)] / root
            };
        }
        for i in 0..n {
            for j in 0..n {
                rest[(i, j)] -= factor[(i, k)] * factor[(j, k)];
            }
        }
    }
    factor
}
