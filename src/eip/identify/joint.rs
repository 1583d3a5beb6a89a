//! Joint covariances of the output errors of all models at one plant.

use faer::Mat;

use crate::eip::engine::Engine;
use crate::eip::frequency::{Frequency, ModelWork, Scratch, lane_of};
use crate::eip::quadrature::{Interval, integrate};
use crate::eip::setup::{PairModel, Setup};
use crate::error::Result;
use crate::model::{DelayForm, LoopBlock};
use crate::real::Real;
use crate::simd::{self, Block, Kernel, LANES};
use crate::small::Cx;

/// Relative tolerance of every covariance.
const TOLERANCE: f64 = 1e-10;

/// `E[eps_i eps_j']` of all pairs of the designed models, without the measurement
/// noise, and that noise.
pub(super) struct Joint {
    ny: usize,
    /// Models by models, each `ny` by `ny`, the upper half.
    blocks: Vec<Mat<f64>>,
    models: usize,
    noise: Mat<f64>,
}

impl Joint {
    /// At the parameter vector `theta`.
    ///
    /// # Errors
    /// A plant that cannot be built.
    pub(super) fn new(setup: &Setup, engine: &Engine<'_>, theta: &[f64]) -> Result<Self> {
        let (block, noise) = setup.block(theta, engine.delay, DelayForm::Exact)?;
        let route = engine.second_route();
        let (ny, models) = (noise.nrows(), route.models.len());
        let width = models * (models + 1) / 2 * ny * ny;
        let mut kept = &route.gains[..];
        let (integrals, _) = integrate(&route.mesh, width, TOLERANCE, |intervals, values| {
            let (omega, factor) = route.frequencies(intervals as &[Interval]);
            values.resize(omega.len() * width, 0.0);
            simd::dispatch(Cross { route, block: &block, omega: &omega, kept, width, out: values });
            kept = &[]; // the rest is off the mesh
            for (row, f) in values.chunks_mut(width).zip(&factor) {
                row.iter_mut().for_each(|v| *v *= f);
            }
        });
        let blocks = integrals
            .chunks(ny * ny)
            .map(|c| Mat::from_fn(ny, ny, |a, b| c[a * ny + b].value))
            .collect();
        Ok(Self { ny, blocks, models, noise })
    }

    /// `E[eps_i eps_j']` of the designed models at places `i` and `j`.
    fn cross(&self, i: usize, j: usize) -> Mat<f64> {
        let (low, high) = (i.min(j), i.max(j));
        let block = &self.blocks[low * self.models - low * (low + 1) / 2 + high];
        if i <= j { block.clone() } else { block.transpose().to_owned() }
    }

    /// The covariance of the residuals of all models at `places`, models by outputs.
    pub(super) fn all(&self, places: &[usize]) -> Mat<f64> {
        let ny = self.ny;
        let blocks: Vec<Mat<f64>> =
            places.iter().flat_map(|&i| places.iter().map(move |&j| self.cross(i, j))).collect();
        let n = places.len();
        Mat::from_fn(n * ny, n * ny, |a, b| {
            blocks[a / ny * n + b / ny][(a % ny, b % ny)] + self.noise[(a % ny, b % ny)]
        })
    }

    /// The covariance of `(e_i, e_j)`, measurement noise included: it is the same
    /// in both.
    pub(super) fn residuals(&self, i: usize, j: usize) -> Mat<f64> {
        self.all(&[i, j])
    }

    /// The Gram matrix `tr(W E[eps_i eps_j'])` of the models at `places`, by rows.
    pub(super) fn gram(&self, w: &Mat<f64>, places: &[usize]) -> Vec<f64> {
        let trace = |i: usize, j: usize| {
            let c = self.cross(i, j);
            let entry = |a: usize, b: usize| w[(a, b)] * c[(b, a)];
            (0..self.ny)
                .flat_map(|a| (0..self.ny).map(move |b| (a, b)))
                .map(|(a, b)| entry(a, b))
                .sum()
        };
        places
            .iter()
            .flat_map(|&i| places.iter().map(move |&j| (i, j)))
            .map(|(i, j)| trace(i, j))
            .collect()
    }
}

/// `Re E_i E_j^H` of all pairs, frequencies in lanes.
struct Cross<'a, 'm> {
    route: &'a Frequency<'m>,
    block: &'a LoopBlock,
    omega: &'a [f64],
    /// Gains of the models at these frequencies, or nothing.
    kept: &'a [Block],
    width: usize,
    out: &'a mut [f64],
}

impl Kernel for Cross<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<T: Real>(self) {
        let Cross { route, block, omega, kept, width, out } = self;
        let len = route.gain_len();
        let models: &[&PairModel] = &route.models;
        let size = models.len() * 2 * len;
        let mut scratch = Scratch::<T>::new();
        let mut work = ModelWork::<T>::new();
        let mut flat = vec![T::zero(); 2 * len];
        let (ny, nw) = (block.Cy.nrows(), block.nw());
        // models by outputs by noises
        let mut errors: Vec<Cx<T>> = Vec::new();
        let nan = T::splat(f64::NAN);
        for g in 0..omega.len().div_ceil(T::LANES) {
            let w = lane_of::<T>(omega, g);
            let s = route.variable(w);
            scratch.solve_loop(block, w, s);
            let first = g * T::LANES;
            errors.clear();
            for (m, model) in models.iter().enumerate() {
                if kept.is_empty() {
                    work.solve(model, s);
                } else {
                    let blocks = &kept[first / LANES * size + m * 2 * len..][..2 * len];
                    work.load(blocks, first % LANES / T::LANES, &mut flat);
                }
                scratch.errors_into(model, &work.gain, nw, &mut errors);
            }
            let mut at = 0;
            for i in 0..models.len() {
                for j in i..models.len() {
                    for a in 0..ny {
                        for b in 0..ny {
                            let mut sum = T::zero();
                            for k in 0..nw {
                                let p = errors[(i * ny + a) * nw + k];
                                let q = errors[(j * ny + b) * nw + k];
                                sum = p.re.mul_add(q.re, p.im.mul_add(q.im, sum));
                            }
                            let sum = T::select(scratch.ok, sum, nan);
                            for l in 0..T::LANES.min(omega.len() - first) {
                                out[(first + l) * width + at] = sum.lane(l);
                            }
                            at += 1;
                        }
                    }
                }
            }
        }
    }
}
