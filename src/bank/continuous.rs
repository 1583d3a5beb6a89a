//! Continuous observers between two measurements: exact for signals that are
//! held.

use faer::Mat;

use super::covariance::HALF_LN_2_PI;
use super::gains::Coefficients;
use super::matrices::{panel, whitener};
use crate::error::{Error, Result};
use crate::model::Plant;
use crate::observer::Observer;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, Panel, dispatch, groups, load_group, store_group};
use crate::small::{Dyn, cholesky, cholesky_solve, expm, expm_work};
use crate::solve::{RiccatiOde, riccati_ode};

/// A continuous observer with its gain and covariance of the moment.
pub(super) struct Held<'a> {
    pub(super) plant: &'a Plant,
    pub(super) gain: Mat<f64>,
    pub(super) covariance: Mat<f64>,
}

impl<'a> Held<'a> {
    /// The steady observer of a design.
    pub(super) fn steady(o: &'a Observer) -> Self {
        Held { plant: &o.plant, gain: o.L.clone(), covariance: o.P.clone() }
    }

    /// With the gain `P C' R^-1` of a covariance; `None` if `R` is singular.
    pub(super) fn at(plant: &'a Plant, p: Mat<f64>) -> Option<Self> {
        let (n, q) = (plant.nx(), plant.ny());
        let mut r: Vec<f64> = (0..q * q).map(|e| plant.R[(e / q, e % q)]).collect();
        // (C P)' column by column is P C', row by row as C P for the solve
        let mut gain = vec![0.0; q * n];
        for i in 0..q {
            for j in 0..n {
                gain[i * n + j] =
                    (0..n).fold(0.0, |s, k| f64::mul_add(plant.C[(i, k)], p[(k, j)], s));
            }
        }
        if !cholesky(Dyn(q), &mut r) {
            return None;
        }
        cholesky_solve(Dyn(q), Dyn(n), &r, &mut gain);
        let gain = Mat::from_fn(n, q, |i, j| gain[j * n + i]);
        Some(Held { plant, gain, covariance: p })
    }

    /// Without a gain: the model alone.
    pub(super) fn alone(plant: &'a Plant) -> Self {
        let (n, q) = (plant.nx(), plant.ny());
        Held { plant, gain: Mat::zeros(n, q), covariance: Mat::zeros(n, n) }
    }

    /// `A - L C`.
    pub(super) fn closed(&self) -> Mat<f64> {
        let (n, q) = (self.plant.nx(), self.plant.ny());
        let (gain, c) = (&self.gain, &self.plant.C);
        Mat::from_fn(n, n, |i, j| {
            (0..q).fold(self.plant.A[(i, j)], |s, k| f64::mul_add(-gain[(i, k)], c[(k, j)], s))
        })
    }
}

/// The plant without the outputs that are missing: they see nothing, with a noise
/// of their own.
pub(super) fn masked(plant: &Plant, present: &[bool]) -> Plant {
    let mut plant = plant.clone();
    for (i, _) in present.iter().enumerate().filter(|(_, present)| !**present) {
        for j in 0..plant.nx() {
            plant.C[(i, j)] = 0.0;
        }
        for j in 0..present.len() {
            plant.R[(i, j)] = 0.0;
            plant.R[(j, i)] = 0.0;
        }
        plant.R[(i, i)] = 1.0;
    }
    plant
}

/// Fills the coefficients for steps of length `h`, parts of an interval `dt`.
///
/// ```text
/// x(t+h) = e^{F h} x + int_0^h e^{F s} ds (L y + B u)
///        = A_d x + B_d u + K (y - C x),   K = int_0^h e^{F s} ds L,  A_d = e^{F h} + K C
/// ```
/// The innovation covariance of a sample is `S = C P C' + R / dt`.
///
/// Outputs that are not `present` were left out of the gains already
/// ([`masked`]); here they are left out of the norms.
pub(super) fn hold(
    held: &[Held<'_>],
    present: &[bool],
    h: f64,
    dt: f64,
    c: &mut Coefficients,
) -> Result<()> {
    let Some(first) = held.first() else { return Ok(()) };
    let (n, m, q) = (first.plant.nx(), first.plant.nu(), first.plant.ny());
    let order = n + q + m;
    // [F L B; 0 0 0] h
    let blocks: Vec<Mat<f64>> = held
        .iter()
        .map(|o| {
            let f = o.closed();
            Mat::from_fn(order, order, |i, j| match (i, j) {
                (i, _) if i >= n => 0.0,
                (i, j) if j < n => f[(i, j)] * h,
                (i, j) if j < n + q => o.gain[(i, j - n)] * h,
                (i, j) => o.plant.B[(i, j - n - q)] * h,
            })
        })
        .collect();
    let a = panel(&blocks.iter().collect::<Vec<_>>());
    let mut e = Panel::new(order, order, held.len());
    if !dispatch(Exponentials { order, a: &a, e: &mut e }) {
        return Err(Error::Range {
            what: "sampling interval".into(),
            value: h,
            remedy: "the observers move too far in one step; take a shorter one".into(),
        });
    }
    let turns = 2.0 * present.iter().filter(|p| **p).count() as f64 * HALF_LN_2_PI;
    for (k, o) in held.iter().enumerate() {
        for i in 0..n {
            for j in 0..q {
                c.k.set(k, i, j, e.get(k, i, n + j));
            }
            for j in 0..m {
                c.b.set(k, i, j, e.get(k, i, n + q + j));
            }
            for j in 0..n {
                let through =
                    (0..q).fold(0.0, |s, l| f64::mul_add(e.get(k, i, n + l), o.plant.C[(l, j)], s));
                c.a.set(k, i, j, e.get(k, i, j) + through);
            }
        }
        let cpc = &o.plant.C * &o.covariance * o.plant.C.transpose();
        let s = Mat::from_fn(q, q, |i, j| {
            if i == j && !present[i] {
                return 1.0;
            }
            0.5 * (cpc[(i, j)] + cpc[(j, i)]) + o.plant.R[(i, j)] / dt
        });
        let (w, ln_det) = whitener("S = C P C' + R / dt", s.as_ref())?;
        let (white, _) = whitener("R", o.plant.R.as_ref())?;
        let mut trace = 0.0;
        for i in 0..q {
            for j in 0..q {
                let counts = if present[i] { 1.0 } else { 0.0 };
                c.w.set(k, i, j, counts * w[(i, j)]);
                c.white.set(k, i, j, counts * white[(i, j)]);
            }
            for j in 0..n {
                trace += o.plant.C[(i, j)] * o.gain[(j, i)];
            }
        }
        c.bias.set(k, 0, 0, 0.5 * trace);
        c.log_norm.set(k, 0, 0, -0.5 * (ln_det + turns));
    }
    for panel in
        [&mut c.a, &mut c.b, &mut c.k, &mut c.w, &mut c.white, &mut c.bias, &mut c.log_norm]
    {
        panel.fill_padding();
    }
    Ok(())
}

/// `P` of every model after `h` seconds; a model whose equation fails holds NaN.
///
/// ```text
/// dP/dt = A P + P A' - P C' R^-1 C P + G Q G'
/// ```
///
/// # Source
/// Aguiar et al. (2007), (4a).
pub(super) fn flow(plants: &[Plant], noise: &[f64], p: &mut Panel, h: f64) {
    let (Some(first), len) = (plants.first(), plants.len()) else { return };
    let (n, m) = (first.nx(), first.ny());
    let flat = |of: fn(&Plant) -> &Mat<f64>| -> Vec<f64> {
        let rows = |x: &Mat<f64>| -> Vec<f64> {
            (0..x.nrows() * x.ncols()).map(|e| x[(e / x.ncols(), e % x.ncols())]).collect()
        };
        plants.iter().flat_map(|plant| rows(of(plant))).collect()
    };
    let (f, c, r) = (flat(|p| &p.A), flat(|p| &p.C), flat(|p| &p.R));
    let start = p.to_row_major();
    let problem =
        RiccatiOde { n, m, len, F: &f, H: &c, Q: noise, R: &r, P: &start, h: &vec![h; len] };
    // sizes were checked when the bank was built
    let Ok(solutions) = riccati_ode(&problem) else { return };
    for k in 0..len {
        match solutions.item(k) {
            Ok(x) => p.write_item(k, x),
            Err(_) => p.write_item(k, &vec![f64::NAN; n * n]),
        }
    }
    p.fill_padding();
}

/// `e^A` of every model; false if one is not finite.
struct Exponentials<'a> {
    order: usize,
    a: &'a Panel,
    e: &'a mut Panel,
}

impl Kernel for Exponentials<'_> {
    type Out = bool;

    #[inline(always)]
    fn run<T: Real>(self) -> bool {
        let size = self.order * self.order;
        let mut a = vec![T::zero(); size];
        let mut e = vec![T::zero(); size];
        let mut work = vec![T::zero(); expm_work(self.order)];
        let mut good = true;
        for block in 0..self.a.n_blocks() {
            for group in 0..groups::<T>() {
                load_group(self.a.block(block), group, &mut a);
                good &= expm(Dyn(self.order), &a, &mut e, &mut work).all();
                store_group(&e, group, self.e.block_mut(block));
            }
        }
        good
    }
}
