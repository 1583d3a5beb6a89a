//! Two models under Gaussian residuals: closed forms, and the mixture.
//!
//! ```text
//! ln (l_j/l_i)^theta = theta/2 (ln det S_i - ln det S_j) + 1/2 x' (-Q) x,   x = (e_i, e_j) ~ N(0, Sigma)
//! E[(l_j/l_i)^theta] = (det S_i / det S_j)^{theta/2} det(I + Sigma Q)^{-1/2},  Q = theta diag(-S_i^-1, S_j^-1)
//! ```
//!
//! With `Sigma = L L'` and `mu_k` the eigenvalues of `L' Q L` the log ratio is a
//! constant less `1/2 sum mu_k z_k^2`, `z_k` independent and standard normal.

use std::f64::consts::PI;

use faer::Mat;

use crate::error::Result;
use crate::model::psd_factor;
use crate::solve::backend;

/// Evaluations of the mixture's integrand, about.
const BUDGET: f64 = 40_000.0;
/// Nodes on the half line at most.
const NODES: usize = 32;

/// A model as its residuals see it: `S^-1` and `ln det S`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale<'a> {
    pub(super) inverse: &'a Mat<f64>,
    pub(super) ln_det: f64,
}

/// The log-likelihood ratio of model `j` over model `i`, tempered.
#[derive(Debug, Clone)]
pub(super) struct Ratio {
    /// `theta/2 (ln det S_i - ln det S_j)`.
    constant: f64,
    mu: Vec<f64>,
}

impl Ratio {
    /// `sigma` is the covariance of `(e_i, e_j)`.
    pub(super) fn new(
        i: Scale<'_>,
        j: Scale<'_>,
        sigma: &Mat<f64>,
        tempering: f64,
    ) -> Result<Self> {
        let ny = i.inverse.nrows();
        let l = psd_factor(sigma.as_ref());
        let (li, lj) = (l.get(..ny, ..), l.get(ny.., ..));
        let form = lj.transpose() * j.inverse * lj - li.transpose() * i.inverse * li;
        let n = form.nrows();
        let half = Mat::from_fn(n, n, |a, b| 0.5 * tempering * (form[(a, b)] + form[(b, a)]));
        Ok(Self {
            constant: 0.5 * tempering * (i.ln_det - j.ln_det),
            mu: backend::symmetric_eigenvalues(half.as_ref())?,
        })
    }

    /// `E[(l_j/l_i)^theta] - 1`; infinite where the mean does not exist.
    pub(super) fn mean_less_one(&self) -> f64 {
        if self.mu.iter().any(|m| *m <= -1.0) {
            return f64::INFINITY;
        }
        let half: f64 = self.mu.iter().map(|m| 0.5 * libm::log1p(*m)).sum();
        libm::expm1(self.constant - half)
    }

    /// The weight of `i` in the mixture with the largest mean log-likelihood.
    ///
    /// ```text
    /// argmax E ln(p l_i + (1 - p) l_j):  E[(1 - r)/(p + (1 - p) r)] = 0,  r = (l_j/l_i)^theta
    /// ```
    pub(super) fn mixture(&self) -> f64 {
        let samples = self.samples();
        let slope = |p: f64| -> f64 {
            samples.iter().map(|(w, r)| w * (1.0 - r) / (p + (1.0 - p) * r)).sum()
        };
        if slope(1.0) >= 0.0 {
            return 1.0;
        }
        if slope(0.0) <= 0.0 {
            return 0.0;
        }
        // the slope falls: regula falsi inside a bracket that halves
        let (mut low, mut high) = (0.0, 1.0);
        let (mut at_low, mut at_high) = (slope(0.0), slope(1.0));
        for k in 0..200 {
            let share = if k % 2 == 0 { at_low / (at_low - at_high) } else { 0.5 };
            let p = low + share * (high - low);
            let value = slope(p);
            if value > 0.0 {
                (low, at_low) = (p, value);
            } else {
                (high, at_high) = (p, value);
            }
            if high - low < 1e-14 || value == 0.0 {
                break;
            }
        }
        if at_low < -at_high { low } else { high }
    }

    /// Weights and ratios on a product of Gauss-Hermite nodes; the ratio is even in
    /// every coordinate.
    fn samples(&self) -> Vec<(f64, f64)> {
        let live: Vec<f64> = self.mu.iter().copied().filter(|m| m.abs() > 1e-15).collect();
        let each = libm::pow(BUDGET, 1.0 / live.len().max(1) as f64) as usize;
        let nodes = half_normal(each.clamp(3, NODES));
        let mut all = vec![(1.0, self.constant)];
        for mu in live {
            let mut next = Vec::with_capacity(all.len() * nodes.len());
            for &(w, exponent) in &all {
                for &(weight, z) in &nodes {
                    let weight = w * weight;
                    // what weighs nothing costs all the same
                    if weight > 1e-22 {
                        next.push((weight, exponent - 0.5 * mu * z * z));
                    }
                }
            }
            all = next;
        }
        all.into_iter().map(|(w, e)| (w, libm::exp(e))).collect()
    }
}

/// The `n` positive nodes of the Gauss rule of `2 n` nodes for the standard normal
/// law, with weights that sum to 1: for even functions.
///
/// Newton's method on the orthonormal Hermite polynomials, from the largest root.
fn half_normal(n: usize) -> Vec<(f64, f64)> {
    let degree = 2 * n;
    // value and slope of the orthonormal polynomial for the weight e^{-x^2}
    let polynomial = |x: f64| {
        let (mut before, mut now) = (0.0, libm::pow(PI, -0.25));
        for k in 0..degree {
            let k = k as f64;
            let next = x * (2.0 / (k + 1.0)).sqrt() * now - (k / (k + 1.0)).sqrt() * before;
            (before, now) = (now, next);
        }
        (now, (2.0 * degree as f64).sqrt() * before)
    };
    let mut roots: Vec<f64> = Vec::with_capacity(n);
    let size = 2.0 * degree as f64 + 1.0;
    for k in 0..n {
        // first guesses as in Press et al., Numerical Recipes, section 4.6
        let mut x = match k {
            0 => size.sqrt() - 1.85575 * libm::pow(size, -1.0 / 6.0),
            1 => roots[0] - 1.14 * libm::pow(degree as f64, 0.426) / roots[0],
            2 => 1.86 * roots[1] - 0.86 * roots[0],
            3 => 1.91 * roots[2] - 0.91 * roots[1],
            _ => 2.0 * roots[k - 1] - roots[k - 2],
        };
        for _ in 0..100 {
            let (value, slope) = polynomial(x);
            let step = value / slope;
            x -= step;
            if step.abs() <= 1e-15 * x.abs() {
                break;
            }
        }
        roots.push(x);
    }
    let weight = |x: f64| {
        let slope = polynomial(x).1;
        2.0 * 2.0 / (slope * slope) / PI.sqrt()
    };
    roots.into_iter().map(|x| (weight(x), std::f64::consts::SQRT_2 * x)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_integrate_even_moments() {
        for n in [3, 5, 14, 32] {
            let nodes = half_normal(n);
            for (power, moment) in
                [(0, 1.0), (2, 1.0), (4, 3.0), (6, 15.0), (8, 105.0), (10, 945.0)]
            {
                let sum: f64 = nodes.iter().map(|(w, z)| w * z.powi(power)).sum();
                assert!((sum / moment - 1.0).abs() < 1e-12, "{n} nodes, power {power}: {sum}");
            }
        }
    }

    #[test]
    fn the_mean_is_that_of_the_samples() {
        let ratio = Ratio { constant: 0.01, mu: vec![0.1, -0.2, 0.05, 0.3] };
        let mean: f64 = ratio.samples().iter().map(|(w, r)| w * (r - 1.0)).sum();
        assert!((mean - ratio.mean_less_one()).abs() < 1e-12, "{mean}");
        assert_eq!(Ratio { constant: 0.0, mu: vec![-1.5] }.mean_less_one(), f64::INFINITY);
    }

    #[test]
    fn one_noise_under_two_variances_is_a_known_mixture() {
        // e_i = e_j = x ~ N(0, v): the likelihoods are N(x; 0, a) and N(x; 0, b); the
        // true law in between is no vertex
        let one = |v: f64| Mat::from_fn(1, 1, |_, _| v);
        let (a, b) = (one(1.0), one(1.0 / 4.0));
        let scale = |m, ln_det| Scale { inverse: m, ln_det };
        let ratio = |v: f64| {
            let sigma = Mat::from_fn(2, 2, |_, _| v);
            Ratio::new(scale(&a, 0.0), scale(&b, libm::log(4.0)), &sigma, 1.0).unwrap()
        };
        // in the bank: the other's ratio has mean 1
        assert!(ratio(1.0).mean_less_one().abs() < 1e-14);
        assert_eq!(ratio(0.5).mixture(), 1.0);
        let p = ratio(2.0).mixture();
        assert!(p > 0.1 && p < 0.9, "{p}");
    }
}
