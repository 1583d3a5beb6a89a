//! Zhang's algorithms in the log domain.

use super::law::Window;
use super::log::{ln_1p, normalise};
use crate::real::Real;

/// Sums of squared residuals.
#[derive(Debug, Clone)]
pub(super) struct Energies<T> {
    /// `J_i`.
    sums: Vec<T>,
    /// The last energies, step by step, where a sliding window must forget them.
    ring: Vec<T>,
    at: usize,
    /// Steps remembered, `k`.
    count: f64,
    window: Window,
}

impl<T: Real> Energies<T> {
    pub(super) fn new(models: usize, window: Window) -> Self {
        let ring = match window {
            Window::Sliding(steps) => vec![T::zero(); steps * models],
            _ => Vec::new(),
        };
        Self { sums: vec![T::zero(); models], ring, at: 0, count: 0.0, window }
    }

    /// Takes in the squared residuals of a step.
    #[inline(always)]
    fn add(&mut self, energy: &[T]) {
        let models = self.sums.len();
        match self.window {
            Window::All => {
                self.count += 1.0;
                for i in 0..models {
                    self.sums[i] = self.sums[i] + energy[i];
                }
            }
            Window::Exponential(keep) => {
                self.count = keep * self.count + 1.0;
                for i in 0..models {
                    self.sums[i] = self.sums[i].mul_add(T::splat(keep), energy[i]);
                }
            }
            Window::Sliding(steps) => {
                self.count = (self.count + 1.0).min(steps as f64);
                self.ring[self.at * models..][..models].copy_from_slice(energy);
                self.at = (self.at + 1) % steps;
                // summed anew: a running difference would drift
                for i in 0..models {
                    let mut sum = T::zero();
                    for k in 0..steps {
                        sum = sum + self.ring[k * models + i];
                    }
                    self.sums[i] = sum;
                }
            }
        }
    }

    /// One step of the law on log weights; a member whose energy is not a finite
    /// number gets none.
    ///
    /// ```text
    /// d_i = (J_i - J_min) / (k + J_i) = 1 - beta_i, without cancellation
    /// ```
    #[inline(always)]
    pub(super) fn step(&mut self, energy: &[T], n_max: f64, log_p: &mut [T]) -> T::Mask {
        self.add(energy);
        let mut least = T::splat(f64::INFINITY);
        for i in 0..log_p.len() {
            // a model without weight is no measure for the others
            let alive = log_p[i].gt(T::splat(f64::NEG_INFINITY));
            least = T::select(alive, self.sums[i].min(least), least);
        }
        for i in 0..log_p.len() {
            let excess = self.sums[i] - least;
            let whole = T::splat(self.count) + self.sums[i];
            let behind = excess.gt(T::zero());
            let excess_or_one = T::select(behind, excess, T::one());
            // near a tie the quotient overflows, and the product is -1
            let ratio = (whole / excess_or_one).min(T::splat(f64::MAX));
            let exponent = ceil(ratio).min(T::splat(n_max));
            let change = exponent * ln_1p(-(excess_or_one / whole));
            let change = T::select(behind, change, T::zero());
            let known = self.sums[i].is_finite();
            log_p[i] = log_p[i] + T::select(known, change, T::splat(f64::NEG_INFINITY));
        }
        normalise(log_p)
    }
}

/// The smallest integer at least `x`, for `x >= 0`.
#[inline(always)]
fn ceil<T: Real>(x: T) -> T {
    let near = x.round_ties_even();
    T::select(near.lt(x), near + T::one(), near)
}

impl<T: Real> Energies<T> {
    /// Forgets everything.
    pub(super) fn reset(&mut self) {
        self.sums.fill(T::zero());
        self.ring.fill(T::zero());
        (self.at, self.count) = (0, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::ceil;

    #[test]
    fn ceil_is_that_of_the_library() {
        for x in [0.0, 0.5, 1.0, 1.5, 2.5, 3.000_000_1, 1e15, 4.5e15, f64::INFINITY] {
            assert_eq!(ceil::<f64>(x), x.ceil());
        }
    }
}
