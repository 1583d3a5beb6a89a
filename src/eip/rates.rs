//! The frequency scale of a study, from the modes of its plants and observers.

use crate::error::Eigenvalue;

/// Slowest and fastest rate of the modes seen so far (rad/s, or rad/sample).
pub(crate) struct Rates {
    slowest: f64,
    fastest: f64,
}

impl Default for Rates {
    fn default() -> Self {
        Self { slowest: f64::INFINITY, fastest: 0.0 }
    }
}

impl Rates {
    /// Takes the modes of one matrix.
    pub(crate) fn add(&mut self, values: &[Eigenvalue], continuous: bool) {
        for v in values {
            let modulus = v.re.hypot(v.im);
            let rate = if continuous {
                modulus
            } else {
                // |ln lambda|; modes that vanish in a sample set no scale
                libm::log(modulus).hypot(v.im.atan2(v.re))
            };
            if rate.is_finite() && rate > 1e-9 {
                self.slowest = self.slowest.min(rate);
                self.fastest = self.fastest.max(rate);
            }
        }
    }

    /// Geometric mean, one where nothing was seen.
    pub(crate) fn centre(&self) -> f64 {
        let centre = (self.slowest * self.fastest).sqrt();
        if centre.is_finite() && centre > 0.0 { centre } else { 1.0 }
    }
}
