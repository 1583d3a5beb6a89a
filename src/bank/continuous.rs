//! Continuous observers between two measurements: exact for signals that are
//! held.

use faer::Mat;

use super::covariance::HALF_LN_2_PI;
use super::gains::Coefficients;
use super::matrices::{panel, whitener};
use crate::error::{Error, Result};
use crate::observer::Observer;
use crate::real::{Mask, Real};
use crate::simd::{Kernel, Panel, dispatch, groups, load_group, store_group};
use crate::small::{Dyn, expm, expm_work};

/// Fills the coefficients for steps of length `h`, parts of an interval `dt`.
///
/// ```text
/// x(t+h) = e^{F h} x + int_0^h e^{F s} ds (L y + B u)
///        = A_d x + B_d u + K (y - C x),   K = int_0^h e^{F s} ds L,  A_d = e^{F h} + K C
/// ```
/// The innovation covariance of a sample is `S = C P C' + R / dt`.
pub(super) fn hold(designs: &[&Observer], h: f64, dt: f64, c: &mut Coefficients) -> Result<()> {
    let Some(first) = designs.first() else { return Ok(()) };
    let (n, m, q) = (first.plant.nx(), first.plant.nu(), first.plant.ny());
    let order = n + q + m;
    // [F L B; 0 0 0] h
    let blocks: Vec<Mat<f64>> = designs
        .iter()
        .map(|o| {
            let f = closed(o);
            Mat::from_fn(order, order, |i, j| match (i, j) {
                (i, _) if i >= n => 0.0,
                (i, j) if j < n => f[(i, j)] * h,
                (i, j) if j < n + q => o.L[(i, j - n)] * h,
                (i, j) => o.plant.B[(i, j - n - q)] * h,
            })
        })
        .collect();
    let a = panel(&blocks.iter().collect::<Vec<_>>());
    let mut e = Panel::new(order, order, designs.len());
    if !dispatch(Exponentials { order, a: &a, e: &mut e }) {
        return Err(Error::Range {
            what: "sampling interval".into(),
            value: h,
            remedy: "the observers move too far in one step; take a shorter one".into(),
        });
    }
    for (k, o) in designs.iter().enumerate() {
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
        let cpc = &o.plant.C * &o.P * o.plant.C.transpose();
        let s =
            Mat::from_fn(q, q, |i, j| 0.5 * (cpc[(i, j)] + cpc[(j, i)]) + o.plant.R[(i, j)] / dt);
        let (w, ln_det) = whitener("S = C P C' + R / dt", s.as_ref())?;
        let (white, _) = whitener("R", o.plant.R.as_ref())?;
        let mut trace = 0.0;
        for i in 0..q {
            for j in 0..q {
                c.w.set(k, i, j, w[(i, j)]);
                c.white.set(k, i, j, white[(i, j)]);
            }
            for j in 0..n {
                trace += o.plant.C[(i, j)] * o.L[(j, i)];
            }
        }
        c.bias.set(k, 0, 0, 0.5 * trace);
        let turns = 2.0 * q as f64 * HALF_LN_2_PI;
        c.log_norm.set(k, 0, 0, -0.5 * (ln_det + turns));
    }
    for panel in
        [&mut c.a, &mut c.b, &mut c.k, &mut c.w, &mut c.white, &mut c.bias, &mut c.log_norm]
    {
        panel.fill_padding();
    }
    Ok(())
}

/// `A - L C`.
fn closed(o: &Observer) -> Mat<f64> {
    let (n, q) = (o.plant.nx(), o.plant.ny());
    Mat::from_fn(n, n, |i, j| {
        (0..q).fold(o.plant.A[(i, j)], |s, k| f64::mul_add(-o.L[(i, k)], o.plant.C[(k, j)], s))
    })
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
