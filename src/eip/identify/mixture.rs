//! The mixture of several models with the largest mean log-likelihood.
//!
//! ```text
//! argmax_p E ln(sum p_j r_j),   r_j = (l_j / l_w)^theta,   p >= 0, sum p = 1
//! ```
//!
//! The mean is over a fixed set of points, spread evenly and turned into a normal
//! law; the concave problem is then solved by Newton's method, each step a
//! quadratic programme over the simplex.

use std::f64::consts::TAU;

use faer::Mat;

use crate::eip::identify::gauss::Scale;
use crate::eip::identify::simplex;
use crate::model::psd_factor;

/// Points of the mean: weights are good to about 1e-3.
const POINTS: usize = 8192;
/// Newton steps at most.
const STEPS: usize = 60;
/// A step that moves every weight by less than this is the last.
const RESTS: f64 = 1e-12;

/// The weights of `scales` (the model `w` among them) for residuals of the joint
/// covariance `sigma`, models by outputs; nothing if they cannot be computed.
pub(super) fn best(
    scales: &[Scale<'_>],
    w: usize,
    sigma: &Mat<f64>,
    tempering: f64,
) -> Option<Vec<f64>> {
    let n = scales.len();
    let ratios = ratios(scales, w, sigma, tempering);
    let mean = |p: &[f64]| -> f64 {
        ratios.chunks(n).map(|r| libm::log(dot(r, p))).sum::<f64>() / POINTS as f64
    };
    let mut p = vec![0.0; n];
    p[w] = 1.0;
    let mut value = mean(&p);
    for _ in 0..STEPS {
        let (gradient, curvature) = derivatives(&ratios, &p);
        // f(q) ~ f(p) + g'(q - p) - 1/2 (q - p)' H (q - p)
        let s: Vec<f64> =
            (0..n).map(|i| 2.0 * (gradient[i] + dot(&curvature[i * n..(i + 1) * n], &p))).collect();
        let q = simplex::minimise(&curvature, &s)?;
        let (mut share, mut moved) = (1.0, None);
        for _ in 0..40 {
            let next: Vec<f64> = p.iter().zip(&q).map(|(p, q)| p + share * (q - p)).collect();
            let at = mean(&next);
            if at > value {
                moved = Some((next, at));
                break;
            }
            share *= 0.5;
        }
        let Some((next, at)) = moved else { break };
        let step = p.iter().zip(&next).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        (p, value) = (next, at);
        if step < RESTS {
            break;
        }
    }
    Some(p)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Gradient and (negative) curvature of the mean at `p`.
fn derivatives(ratios: &[f64], p: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let n = p.len();
    let (mut gradient, mut curvature) = (vec![0.0; n], vec![0.0; n * n]);
    for r in ratios.chunks(n) {
        let share = 1.0 / dot(r, p);
        for i in 0..n {
            gradient[i] += share * r[i];
            for j in 0..n {
                curvature[i * n + j] += share * share * r[i] * r[j];
            }
        }
    }
    let points = POINTS as f64;
    gradient.iter_mut().chain(&mut curvature).for_each(|v| *v /= points);
    (gradient, curvature)
}

/// `r_j` at every point, points by models.
fn ratios(scales: &[Scale<'_>], w: usize, sigma: &Mat<f64>, tempering: f64) -> Vec<f64> {
    let ny = scales[w].inverse.nrows();
    let factor = psd_factor(sigma.as_ref());
    let size = sigma.nrows();
    let normals = normals(size);
    let mut out = Vec::with_capacity(POINTS * scales.len());
    let mut x = vec![0.0; size];
    for z in normals.chunks(size) {
        for (i, x) in x.iter_mut().enumerate() {
            *x = (0..size).map(|k| factor[(i, k)] * z[k]).sum();
        }
        let half = |j: usize| -> f64 {
            let (s, e) = (&scales[j], &x[j * ny..(j + 1) * ny]);
            let rows =
                (0..ny).map(|a| e[a] * (0..ny).map(|b| s.inverse[(a, b)] * e[b]).sum::<f64>());
            0.5 * (s.ln_det + rows.sum::<f64>())
        };
        let own = half(w);
        out.extend((0..scales.len()).map(|j| libm::exp(tempering * (own - half(j)))));
    }
    out
}

/// Points of a standard normal law of `size` dimensions, each coordinate of
/// variance one: an additive recurrence on the generalised golden ratio, turned
/// into normals in pairs.
///
/// # Source
/// Roberts (2018), "The unreasonable effectiveness of quasirandom sequences"; Box,
/// Muller (1958).
fn normals(size: usize) -> Vec<f64> {
    let even = size.next_multiple_of(2);
    // the root above one of x^{d+1} = x + 1
    let mut phi = 2.0_f64;
    for _ in 0..60 {
        phi = libm::pow(1.0 + phi, 1.0 / (even as f64 + 1.0));
    }
    let alpha: Vec<f64> = (1..=even).map(|k| libm::pow(phi, -(k as f64))).collect();
    let mut out = Vec::with_capacity(POINTS * size);
    for n in 0..POINTS {
        let at = |k: usize| {
            let v = 0.5 + (n as f64 + 1.0) * alpha[k];
            v - v.floor()
        };
        let mut point = Vec::with_capacity(even);
        for k in (0..even).step_by(2) {
            let radius = (-2.0 * libm::log(1.0 - at(k))).sqrt();
            let angle = TAU * at(k + 1);
            point.extend([radius * libm::cos(angle), radius * libm::sin(angle)]);
        }
        out.extend_from_slice(&point[..size]);
    }
    for k in 0..size {
        let column = || out.iter().skip(k).step_by(size);
        let power = (column().map(|z| z * z).sum::<f64>() / POINTS as f64).sqrt();
        out.iter_mut().skip(k).step_by(size).for_each(|z| *z /= power);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eip::identify::gauss::Ratio;

    #[test]
    fn a_pair_has_the_mixture_of_the_exact_quadrature() {
        // one residual of variance v under N(0, 1) and N(0, 4), and a third model
        // that cannot enter
        let one = |v: f64| Mat::from_fn(1, 1, |_, _| v);
        let (a, b, c) = (one(1.0), one(0.25), one(1.0 / 400.0));
        let scale = |m, ln_det| Scale { inverse: m, ln_det };
        let all = [scale(&a, 0.0), scale(&b, libm::log(4.0)), scale(&c, libm::log(400.0))];
        for v in [1.6, 2.0, 2.6] {
            let sigma = |n: usize| Mat::from_fn(n, n, |_, _| v);
            let exact = Ratio::new(all[0], all[1], &sigma(2), 1.0).map(|r| r.mixture()).unwrap();
            let p = best(&all, 0, &sigma(3), 1.0).unwrap();
            assert!((p[0] - exact).abs() < 5e-3, "{p:?} {exact}");
            assert!(p[2] < 5e-3, "{p:?}");
        }
    }
}
