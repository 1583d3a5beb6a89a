//! Recursive least squares by themselves, in batch.

use super::ud;
use crate::error::{Error, Result};
use crate::real::Real;
use crate::simd::{Block, Kernel, Panel, dispatch, groups, load_group, store_group};

/// Many recursive least squares with forgetting, one a lane, as `P = U D U'`.
///
/// ```text
/// L <- mu L + w phi' phi,   theta <- theta + P phi' w (y - phi theta),   P = L^-1
/// ```
/// The update that [`Adaptive`](super::Adaptive) runs inside; a Kalman filter without
/// process noise, `mu = 1` and `w = 1 / R`.
///
/// ```
/// use mmae::adaptive::LeastSquares;
/// use mmae::simd::Panel;
/// // ten problems: y = i + 2 i x, seen without noise at three x
/// let mut fit = LeastSquares::new(2, 10, 1e12)?;
/// for x in [0.0, 1.0, 3.0] {
///     let phi = Panel::from_fn(1, 2, 10, |_, _, j| if j == 0 { 1.0 } else { x });
///     let y = Panel::from_fn(1, 1, 10, |i, _, _| i as f64 * (1.0 + 2.0 * x));
///     fit.update(&phi, &y, 1.0, 1.0)?;
/// }
/// let theta = fit.theta(7);
/// assert!((theta[0] - 7.0).abs() < 1e-9 && (theta[1] - 14.0).abs() < 1e-9);
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct LeastSquares {
    p: usize,
    theta: Panel,
    ud: Panel,
    scratch: Vec<Block>,
}

impl LeastSquares {
    /// `len` problems of `p` parameters that start at zero with `P = p0 I`.
    ///
    /// # Errors
    /// `Empty` without parameters or problems; `Range` for a `p0` that is not positive.
    pub fn new(p: usize, len: usize, p0: f64) -> Result<Self> {
        if p == 0 || len == 0 {
            return Err(Error::Empty { what: "the batch of least squares".into() });
        }
        if !(p0 > 0.0 && p0.is_finite()) {
            let remedy = "give a positive number, the larger the less is known".into();
            return Err(Error::Range { what: "P(0)".into(), value: p0, remedy });
        }
        Ok(Self {
            p,
            theta: Panel::new(p, 1, len),
            ud: Panel::from_fn(p, p, len, |_, i, j| if i == j { p0 } else { 0.0 }),
            scratch: vec![Block::default(); (2 + ud::SCRATCH) * p],
        })
    }

    /// A measurement of every problem: `phi` holds rows of p numbers, `y` one number;
    /// the past is forgotten by `mu`, the measurement has the weight `w`.
    ///
    /// # Errors
    /// `Shape` for panels of another size; `Range` for `mu` or `w` that is not positive.
    pub fn update(&mut self, phi: &Panel, y: &Panel, mu: f64, w: f64) -> Result<()> {
        for (what, panel, cols) in [("phi", phi, self.p), ("y", y, 1)] {
            if [panel.rows(), panel.cols(), panel.len()] != [1, cols, self.theta.len()] {
                let (want, got) = ([self.theta.len(), cols], [panel.len(), panel.cols()]);
                return Err(Error::Shape { what: what.into(), want, got });
            }
        }
        for (what, value) in [("mu", mu), ("w", w)] {
            if !(value > 0.0 && value.is_finite()) {
                let remedy = "give a positive number".into();
                return Err(Error::Range { what: what.into(), value, remedy });
            }
        }
        dispatch(Update { fit: self, phi, y, mu, r: 1.0 / w });
        Ok(())
    }

    /// The parameters of a problem.
    ///
    /// # Panics
    /// Unless there is such a problem.
    pub fn theta(&self, item: usize) -> Vec<f64> {
        let mut theta = vec![0.0; self.p];
        self.theta.read_item(item, &mut theta);
        theta
    }

    /// `P` of a problem, row by row.
    ///
    /// # Panics
    /// Unless there is such a problem.
    pub fn covariance(&self, item: usize) -> Vec<f64> {
        let mut rows = vec![0.0; self.p * self.p];
        self.ud.read_item(item, &mut rows);
        ud::covariance(self.p, 0, &rows)
    }
}

struct Update<'a> {
    fit: &'a mut LeastSquares,
    phi: &'a Panel,
    y: &'a Panel,
    mu: f64,
    r: f64,
}

impl Kernel for Update<'_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let Self { fit, phi, y, mu, r } = self;
        let p = fit.p;
        let (growth, r) = (T::splat(mu).recip(), T::splat(r));
        for b in 0..fit.theta.n_blocks() {
            let (theta, ud) = (fit.theta.block_mut(b), fit.ud.block_mut(b));
            let (phi, y) = (phi.block(b), y.block(b));
            if let (Some(phi), Some(y)) = (T::view(phi), T::view(y))
                && let (Some(theta), Some(ud)) = (T::view_mut(theta), T::view_mut(ud))
                && let Some(scratch) = T::view_mut(&mut fit.scratch)
            {
                one(p, [growth, r], phi, y[0], theta, ud, scratch);
                continue;
            }
            let room = |len: usize| vec![T::zero(); len];
            let (mut own_phi, mut own_y) = (room(p), room(1));
            let (mut own_theta, mut own_ud) = (room(p), room(p * p));
            let mut scratch = room(fit.scratch.len());
            for group in 0..groups::<T>() {
                load_group(phi, group, &mut own_phi);
                load_group(y, group, &mut own_y);
                load_group(theta, group, &mut own_theta);
                load_group(ud, group, &mut own_ud);
                let rates = [growth, r];
                one(p, rates, &own_phi, own_y[0], &mut own_theta, &mut own_ud, &mut scratch);
                store_group(&own_theta, group, theta);
                store_group(&own_ud, group, ud);
            }
        }
    }
}

#[inline(always)]
fn one<T: Real>(
    p: usize,
    [growth, r]: [T; 2],
    phi: &[T],
    y: T,
    theta: &mut [T],
    ud: &mut [T],
    scratch: &mut [T],
) {
    let (gain, work) = scratch.split_at_mut(p);
    let mut e = y;
    for i in 0..p {
        ud[i * p + i] = ud[i * p + i] * growth;
        e = phi[i].neg_mul_add(theta[i], e);
    }
    let total = ud::update(ud, phi, r, gain, work);
    let step = e / total;
    for i in 0..p {
        theta[i] = gain[i].mul_add(step, theta[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::real::Tier;
    use crate::simd::dispatch_on;

    #[test]
    fn every_tier_has_the_bits_of_the_oracle() {
        for (p, len) in [(1, 3), (4, 11), (7, 8)] {
            let run = |tier: Tier| -> Option<Vec<u64>> {
                let mut fit = LeastSquares::new(p, len, 1e6).unwrap();
                for k in 0..60 {
                    let wave = |i: usize, j: usize| {
                        libm::sin(0.37 * (k * (j + 1)) as f64 + 0.11 * (i * j) as f64)
                    };
                    let phi = Panel::from_fn(1, p, len, |i, _, j| wave(i, j));
                    let y = Panel::from_fn(1, 1, len, |i, _, _| wave(i, p + 3));
                    let update = Update { fit: &mut fit, phi: &phi, y: &y, mu: 0.99, r: 50.0 };
                    dispatch_on(tier, update)?;
                }
                let numbers = fit.theta.to_row_major().into_iter().chain(fit.ud.to_row_major());
                Some(numbers.map(f64::to_bits).collect())
            };
            let oracle = run(Tier::Scalar);
            for tier in Tier::ALL {
                let lanes = run(tier);
                assert!(lanes.is_none() || oracle.is_none() || lanes == oracle, "{tier}: {p}");
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert!(LeastSquares::new(0, 1, 1.0).is_err() && LeastSquares::new(1, 1, 0.0).is_err());
        let mut fit = LeastSquares::new(2, 3, 1.0).unwrap();
        let (phi, y) = (Panel::new(1, 2, 3), Panel::new(1, 1, 3));
        assert!(fit.update(&y, &y, 1.0, 1.0).is_err());
        assert!(fit.update(&phi, &y, 0.0, 1.0).is_err());
        assert!(fit.update(&phi, &y, 1.0, f64::NAN).is_err());
        assert!(fit.update(&phi, &y, 1.0, 1.0).is_ok());
    }
}
