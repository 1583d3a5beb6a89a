//! Mixtures of Gaussian estimates.

use faer::Mat;

use crate::bank::{Bank, GainMode};
use crate::weight::Transition;

/// Scratch for moments of mixtures.
#[derive(Debug, Clone)]
pub(super) struct Moments {
    n: usize,
    x: Vec<Vec<f64>>,
    p: Vec<Mat<f64>>,
    mixed_x: Vec<Vec<f64>>,
    mixed_p: Vec<Mat<f64>>,
}

impl Moments {
    pub(super) fn new(models: usize, n: usize) -> Self {
        let zero = || vec![Mat::zeros(n, n); models];
        Self {
            n,
            x: vec![vec![0.0; n]; models],
            p: zero(),
            mixed_x: vec![vec![0.0; n]; models],
            mixed_p: zero(),
        }
    }

    fn read(&mut self, bank: &Bank) {
        for i in 0..self.x.len() {
            bank.x_hat_into(i, &mut self.x[i]);
            bank.covariance_into(i, &mut self.p[i]);
        }
    }

    /// Mean and covariance of `sum w_i N(x_i, P_i)`, `w` of sum one.
    ///
    /// ```text
    /// x = sum w_i x_i,   P = sum w_i (P_i + (x_i - x)(x_i - x)')
    /// ```
    fn mixture(&self, w: impl Fn(usize) -> f64, x: &mut [f64], p: &mut Mat<f64>) {
        x.fill(0.0);
        for (i, xi) in self.x.iter().enumerate() {
            let weight = w(i);
            // a member that failed has weight zero and may hold anything
            if weight > 0.0 {
                for r in 0..self.n {
                    x[r] = weight.mul_add(xi[r], x[r]);
                }
            }
        }
        p.fill(0.0);
        for (i, xi) in self.x.iter().enumerate() {
            let weight = w(i);
            if weight > 0.0 {
                for r in 0..self.n {
                    for c in 0..self.n {
                        let spread = (xi[r] - x[r]) * (xi[c] - x[c]);
                        p[(r, c)] = weight.mul_add(self.p[i][(r, c)] + spread, p[(r, c)]);
                    }
                }
            }
        }
    }

    /// Puts every member to the mixture of those that may have changed to it.
    ///
    /// ```text
    /// w_{i|j} = Pi_ij p_i / sum_k Pi_kj p_k
    /// ```
    pub(super) fn interact(&mut self, bank: &mut Bank, pi: &Transition, p: &[f64]) {
        self.read(bank);
        let models = self.x.len();
        let recursive = bank.gains().mode() == GainMode::Recursive;
        let mut x = std::mem::take(&mut self.mixed_x);
        let mut cov = std::mem::take(&mut self.mixed_p);
        for j in 0..models {
            let total: f64 = (0..models).map(|i| pi.get(i, j) * p[i]).sum();
            if total > 0.0 {
                self.mixture(|i| pi.get(i, j) * p[i] / total, &mut x[j], &mut cov[j]);
                bank.set(j, &x[j], recursive.then_some(&cov[j]));
            }
        }
        (self.mixed_x, self.mixed_p) = (x, cov);
    }

    /// Puts the members marked by `starved` to the mixture with weights `p`.
    pub(super) fn reseed(&mut self, bank: &mut Bank, p: &[f64], starved: impl Fn(usize) -> bool) {
        if !(0..p.len()).any(&starved) {
            return;
        }
        self.read(bank);
        let recursive = bank.gains().mode() == GainMode::Recursive;
        let mut x = std::mem::take(&mut self.mixed_x);
        let mut cov = std::mem::take(&mut self.mixed_p);
        self.mixture(|i| p[i], &mut x[0], &mut cov[0]);
        for i in (0..p.len()).filter(|&i| starved(i)) {
            bank.set(i, &x[0], recursive.then_some(&cov[0]));
        }
        (self.mixed_x, self.mixed_p) = (x, cov);
    }

    /// Covariance of the fused estimate.
    pub(super) fn covariance(&mut self, bank: &Bank, p: &[f64]) -> Mat<f64> {
        self.read(bank);
        let mut x = vec![0.0; self.n];
        let mut cov = Mat::zeros(self.n, self.n);
        self.mixture(|i| p[i], &mut x, &mut cov);
        cov
    }
}
