//! What the analysis of an unmodelled actuator returns.

use crate::eip::Interval;
use crate::eip::robust::Found;

/// The sets that hold for every stable `Delta` with `|Delta(jw)| <= |W(jw)|`.
///
/// A model that is *guaranteed* for a plant has the smallest Upsilon whatever the
/// `Delta`; where no model is, the plant is *undecidable*. Upsilon differences are
/// bounded frequency by frequency, so that the undecidable sets are outer
/// estimates; `inner` says how tight they are.
///
/// # Source
/// Hassani et al. (2009), section IV, the bound made pointwise in the frequency.
#[derive(Debug, Clone, PartialEq)]
pub struct Robust {
    /// Actuator delay in seconds about which `Delta` acts: the first of the study.
    pub delay: f64,
    /// Largest `|W T|` over the plants of the grid, `T = -K P / (1 - K P)`; `None`
    /// if no plant has a winner. Below 1 the loop is stable for every `Delta`.
    pub peak: Option<Peak>,
    /// Largest `|W T|` over the frequency, of each plant (NaN without a winner).
    pub loop_gain: Vec<f64>,
    /// Guaranteed model of each plant.
    pub guaranteed: Vec<Option<usize>>,
    /// Least lead of the nominal winner over every other model for every `Delta`,
    /// less the quadrature's error: positive where it is guaranteed, minus infinity
    /// where the loop may be unstable, NaN without a winner.
    pub lead: Vec<f64>,
    /// Largest error estimate of the leads of the grid's plants.
    pub error: f64,
    /// One parameter: where each model is guaranteed, as disjoint intervals.
    pub sets: Vec<Vec<Interval>>,
    /// One parameter: where no model is guaranteed.
    pub undecidable: Vec<Uncertain>,
    /// One parameter: where some `Delta` makes the loop unstable.
    pub fragile: Vec<Interval>,
}

impl Robust {
    pub(super) fn empty(delay: f64, models: usize) -> Self {
        Self {
            delay,
            peak: None,
            loop_gain: Vec::new(),
            guaranteed: Vec::new(),
            lead: Vec::new(),
            error: 0.0,
            sets: vec![Vec::new(); models],
            undecidable: Vec::new(),
            fragile: Vec::new(),
        }
    }

    /// Whether every plant with a winner is stable for every `Delta`.
    pub fn is_stable(&self) -> bool {
        self.peak.is_none_or(|p| p.size < 1.0) && self.fragile.is_empty()
    }
}

/// Where the loop is nearest to instability.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Index of the plant on the grid.
    pub plant: usize,
    /// `|W T|` there.
    pub size: f64,
    /// At this frequency, in rad/s.
    pub omega: f64,
}

/// A stretch without a guaranteed model.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertain {
    /// The stretch, an outer estimate.
    pub interval: Interval,
    /// Models that may win in it, in increasing order.
    pub models: Vec<usize>,
    /// Inner estimates, one a nominal boundary of the stretch.
    pub inner: Vec<Inner>,
}

/// A stretch around a nominal boundary in which causal `Delta` were found that
/// move the boundary to its ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Inner {
    /// The stretch.
    pub interval: Interval,
    /// The `Delta` with which the boundary is at the lower end; `None` where the
    /// search found none that moves it.
    pub lower: Option<Found>,
    /// The same for the upper end.
    pub upper: Option<Found>,
}
