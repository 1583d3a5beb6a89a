//! Which parameters the output can tell apart: a rank test on sensitivities.
//!
//! ```text
//! x' = A(theta) x + Gamma theta + f,       y = C x,          a probing input u
//! s_i' = A_k(theta) s_i + g_i,             s_i(0) = 0        a parameter
//! s_0' = A_k(theta) s_0,                   s_0(0) = I        the unknown x(0)
//! ```
//! Parameters are identifiable (locally, by rich inputs) where the columns `C s_i(t)`,
//! freed from those of `x(0)`, are independent. The output that the gain feeds back
//! passes through an invertible filter: `K` changes no rank.

use super::layout::{Kind, kinds};
use super::plant::{Structure, Tuning};
use super::scheme::closed;
use super::words;
use crate::error::Result;
use crate::solve::backend;

/// Singular value, relative to the largest, below which a combination counts as
/// invisible. Those that are invisible come out at some 1e-14.
const INVISIBLE: f64 = 1e-9;
/// Samples of the probing experiment.
const SAMPLES: [f64; 2] = [300.0, 6000.0];
/// A state that large is that of an unstable plant: the experiment is shortened.
const LARGE: f64 = 1e6;

/// What the rank test found.
///
/// ```
/// # use std::sync::Arc;
/// use mmae::adaptive::{FnRegressor, Prior, Structure, Tuning, Unknown, identifiability};
/// use mmae::mat;
/// // x1' = -x1 + b x2, x2' = -2 x2 + c u, y = x1: only the product b c is seen
/// let input = FnRegressor::new(1, |_, u, _, gamma, _| gamma[1] = u[0]);
/// let structure = Structure {
///     states: vec!["x1".into(), "x2".into()],
///     outputs: vec!["y".into()],
///     inputs: 1,
///     unknown: vec![Unknown::entry("b", 0, 1), Unknown::given("c")],
///     regressor: Arc::new(input),
/// };
/// let a = mat![[-1.0, 1.0], [0.0, -2.0]];
/// let (c, k) = (mat![[1.0, 0.0]], mat![[1.0], [1.0]]);
/// let tuning = Tuning::new(a, c, k, vec![0.5, 1.0], Prior::uniform(1e4, 2));
/// let found = identifiability(&structure, &tuning)?;
/// assert_eq!(found.rank, 1);
/// assert_eq!(found.words, ["x2 -> alpha x2 leaves y unchanged"]);
/// # Ok::<(), mmae::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Identifiability {
    /// Combinations of the parameters that the output shows.
    pub rank: usize,
    /// Parameters.
    pub parameters: usize,
    /// Singular values of the scaled sensitivities, relative to the largest, in
    /// decreasing order.
    pub singular: Vec<f64>,
    /// Directions in the parameters that leave the output as it is, of length one.
    pub directions: Vec<Vec<f64>>,
    /// What they are, in words.
    pub words: Vec<String>,
}

/// Tests whether the output tells the parameters of a plant apart, at `theta(0)`; if
/// it does not, at a second value, since a rank that is lacking at one point only is
/// no property of the plant.
///
/// # Errors
/// `Range` if eigenvalues or singular values do not converge.
pub fn identifiability(structure: &Structure, tuning: &Tuning) -> Result<Identifiability> {
    let first = at(structure, tuning, &tuning.theta)?;
    if first.rank == first.parameters {
        return Ok(first);
    }
    let away = |(i, theta): (usize, &f64)| theta + 0.3 * (1.0 + theta.abs()) * scatter(i);
    let other: Vec<f64> = tuning.theta.iter().enumerate().map(away).collect();
    let second = at(structure, tuning, &other)?;
    Ok(if second.rank > first.rank { second } else { first })
}

/// Numbers between -1 and 1 without a pattern, always the same.
pub(super) fn scatter(i: usize) -> f64 {
    let x = (i as f64 + 1.0) * 0.618_033_988_749_894_9;
    2.0 * (x - x.floor()) - 1.0
}

/// The plant with given parameters, and its sensitivities.
pub(super) struct Probe<'a> {
    pub(super) structure: &'a Structure,
    pub(super) tuning: &'a Tuning,
    pub(super) kinds: Vec<Kind>,
    pub(super) theta: &'a [f64],
    /// `A - K C` with the entries that act on an estimated state, row by row.
    a_k: Vec<f64>,
    /// Frequencies in rad/s of the probing input.
    omega: Vec<f64>,
}

impl<'a> Probe<'a> {
    fn new(
        structure: &'a Structure,
        tuning: &'a Tuning,
        theta: &'a [f64],
        [slow, fast]: [f64; 2],
    ) -> Self {
        let kinds = kinds(structure, tuning);
        let n = structure.states.len();
        let mut a_k = closed(tuning);
        for (kind, theta) in kinds.iter().zip(theta) {
            if let Kind::Estimated { row, col } = *kind {
                a_k[row * n + col] += theta;
            }
        }
        let count = 2 * theta.len() + 2;
        let (low, high) = (0.3 * slow, 1.5 * fast);
        let step = libm::log(high / low) / (count - 1) as f64;
        let omega = (0..count).map(|s| low * libm::exp(step * s as f64)).collect();
        Self { structure, tuning, kinds, theta, a_k, omega }
    }

    fn input(&self, t: f64) -> Vec<f64> {
        let channel = |c: usize| {
            let term = |(s, w): (usize, &f64)| libm::sin(w * t + 7.0 * scatter(31 * c + s));
            self.omega.iter().enumerate().map(term).sum()
        };
        (0..self.structure.inputs).map(channel).collect()
    }

    /// The regressors `g_i` of all parameters and the known term, at a state.
    pub(super) fn regressors(&self, t: f64, u: &[f64], x: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let [n, _, q, p] = self.structure.sizes();
        let c = &self.tuning.C;
        let y: Vec<f64> = (0..q).map(|j| (0..n).map(|i| c[(j, i)] * x[i]).sum()).collect();
        let regressor = &self.structure.regressor;
        let (mut gamma, mut known) = (vec![0.0; regressor.columns() * n], vec![0.0; n]);
        regressor.evaluate(t, u, &y, &mut gamma, &mut known);
        let mut g = vec![0.0; p * n];
        for (i, kind) in self.kinds.iter().enumerate() {
            let column = &mut g[i * n..][..n];
            match *kind {
                Kind::Measured { row, col, .. } | Kind::Estimated { row, col } => {
                    column[row] = x[col];
                }
                Kind::Given(j) => column.copy_from_slice(&gamma[j * n..][..n]),
            }
        }
        (g, known)
    }

    /// `x'`, from the regressors.
    pub(super) fn derivative(&self, x: &[f64], g: &[f64], known: &[f64]) -> Vec<f64> {
        let n = x.len();
        let row = |i: usize| {
            let linear: f64 = (0..n).map(|j| self.tuning.A[(i, j)] * x[j]).sum();
            let unknown: f64 = self.theta.iter().enumerate().map(|(k, v)| v * g[k * n + i]).sum();
            linear + unknown + known[i]
        };
        (0..n).map(row).collect()
    }

    /// Derivative of state and sensitivities: `x`, then columns of n numbers.
    fn flow(&self, t: f64, z: &[f64]) -> Vec<f64> {
        let n = self.structure.states.len();
        let (x, columns) = z.split_at(n);
        let (g, known) = self.regressors(t, &self.input(t), x);
        let mut out = self.derivative(x, &g, &known);
        for (k, s) in columns.chunks_exact(n).enumerate() {
            for i in 0..n {
                let drive = if k < n { 0.0 } else { g[(k - n) * n + i] };
                let row = &self.a_k[i * n..][..n];
                out.push(row.iter().zip(s).fold(drive, |sum, (a, s)| sum + a * s));
            }
        }
        out
    }

    /// `C s` of every column over `count` steps of `h` by Runge-Kutta, or `None` if
    /// the plant runs away.
    fn columns(&self, h: f64, count: usize) -> Option<Vec<Vec<f64>>> {
        let [n, _, q, p] = self.structure.sizes();
        let mut z = vec![0.0; n + n * n + n * p];
        for i in 0..n {
            z[i] = self.tuning.x_hat[i] + scatter(5 * i);
            z[n + i * n + i] = 1.0;
        }
        let mut columns = vec![Vec::with_capacity(count * q); n + p];
        for k in 0..count {
            let t = k as f64 * h;
            let at = |slope: &[f64], share: f64| -> Vec<f64> {
                z.iter().zip(slope).map(|(z, s)| z + share * h * s).collect()
            };
            let a = self.flow(t, &z);
            let b = self.flow(t + 0.5 * h, &at(&a, 0.5));
            let c = self.flow(t + 0.5 * h, &at(&b, 0.5));
            let d = self.flow(t + h, &at(&c, 1.0));
            for (i, z) in z.iter_mut().enumerate() {
                *z += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
            }
            if !z.iter().all(|v| v.abs() < LARGE) {
                return None;
            }
            for (column, s) in columns.iter_mut().zip(z[n..].chunks_exact(n)) {
                for j in 0..q {
                    column.push((0..n).map(|i| self.tuning.C[(j, i)] * s[i]).sum());
                }
            }
        }
        Some(columns)
    }
}

fn at(structure: &Structure, tuning: &Tuning, theta: &[f64]) -> Result<Identifiability> {
    let [n, _, _, p] = structure.sizes();
    let a = closed(tuning);
    let matrix = faer::Mat::from_fn(n, n, |i, j| a[i * n + j]);
    let poles = backend::eigenvalues(matrix.as_ref())?;
    let slow = poles.iter().map(|v| v.re.abs()).fold(f64::INFINITY, f64::min);
    let fast = poles.iter().map(|v| v.re.hypot(v.im)).fold(0.0, f64::max);
    let slow = slow.max(1e-3 * fast);
    let probe = Probe::new(structure, tuning, theta, [slow, fast]);
    let (mut duration, mut columns) = (15.0 / slow, None);
    for _ in 0..12 {
        let count = (4.0 * fast * duration).clamp(SAMPLES[0], SAMPLES[1]);
        columns = probe.columns(duration / count, count as usize);
        if columns.is_some() {
            break;
        }
        duration *= 0.5;
    }
    // a plant that cannot be simulated at all says nothing about its parameters
    let mut columns = columns.unwrap_or_else(|| vec![vec![0.0]; n + p]);
    let mut seen = columns.split_off(n);
    let norms: Vec<f64> = seen.iter_mut().map(|v| normalize(v)).collect();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for mut column in columns {
        normalize(&mut column);
        free(&mut column, &basis);
        if norm(&column) > INVISIBLE {
            normalize(&mut column);
            basis.push(column);
        }
    }
    seen.iter_mut().for_each(|column| free(column, &basis));
    let (values, vectors) = one_sided_jacobi(seen);
    let largest = values.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let mut order: Vec<usize> = (0..p).collect();
    order.sort_by(|&i, &j| values[j].total_cmp(&values[i]));
    let singular: Vec<f64> = order.iter().map(|&i| values[i] / largest).collect();
    let rank = singular.iter().filter(|v| **v > INVISIBLE).count();
    let direction = |&k: &usize| {
        let unscaled = |i: usize| vectors[k][i] / if norms[i] > 0.0 { norms[i] } else { 1.0 };
        let mut direction: Vec<f64> = (0..p).map(unscaled).collect();
        normalize(&mut direction);
        direction
    };
    let directions: Vec<Vec<f64>> = order[rank..].iter().map(direction).collect();
    let words = words::explain(&probe, &directions);
    Ok(Identifiability { rank, parameters: p, singular, directions, words })
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Brings a vector to length one (unless it is zero) and returns the length it had.
fn normalize(v: &mut [f64]) -> f64 {
    let length = norm(v);
    if length > 0.0 {
        v.iter_mut().for_each(|x| *x /= length);
    }
    length
}

/// Takes from `v` what lies along the orthonormal `basis`, twice.
fn free(v: &mut [f64], basis: &[Vec<f64>]) {
    for _ in 0..2 {
        for b in basis {
            let along: f64 = v.iter().zip(b).map(|(v, b)| v * b).sum();
            v.iter_mut().zip(b).for_each(|(v, b)| *v -= along * b);
        }
    }
}

/// Singular values of the matrix with these columns and the right singular vectors,
/// accurate also where the values are small.
///
/// # Source
/// Hestenes (1958), Inversion of matrices by biorthogonalization, SIAM Journal 6.
fn one_sided_jacobi(mut columns: Vec<Vec<f64>>) -> (Vec<f64>, Vec<Vec<f64>>) {
    let p = columns.len();
    let unit = |i: usize| (0..p).map(|j| if i == j { 1.0 } else { 0.0 }).collect();
    let mut vectors: Vec<Vec<f64>> = (0..p).map(unit).collect();
    let turn = |pair: &mut [Vec<f64>], i: usize, j: usize, (c, s): (f64, f64)| {
        let (head, tail) = pair.split_at_mut(j);
        for (x, y) in head[i].iter_mut().zip(&mut tail[0]) {
            (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
        }
    };
    for _ in 0..60 {
        let mut turned = false;
        for j in 1..p {
            for i in 0..j {
                let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum();
                let cross: f64 = product(&columns[i], &columns[j]);
                let [a, b]: [f64; 2] = [i, j].map(|k| product(&columns[k], &columns[k]));
                if cross.abs() <= 1e-15 * (a * b).sqrt() || cross == 0.0 {
                    continue;
                }
                turned = true;
                let zeta = (b - a) / (2.0 * cross);
                let tangent = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let rotation = (cosine, cosine * tangent);
                turn(&mut columns, i, j, rotation);
                turn(&mut vectors, i, j, rotation);
            }
        }
        if !turned {
            break;
        }
    }
    (columns.iter().map(|c| norm(c)).collect(), vectors)
}
