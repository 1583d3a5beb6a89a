//! The search for causal `Delta` that move a boundary far.
//!
//! At one plant the parts of every frequency are known, and a `Delta` costs one sum
//! over the nodes of the quadrature. All-pass factors are added one at a time, the
//! best of a raster first, then all are moved until no step gains; delays are
//! tried where the bound covers them. With the best `Delta` the boundary is found
//! again, and the search goes on there.

use crate::eip::robust::disc::{Disc, Quadratic, image};
use crate::eip::robust::parts::Opened;
use crate::eip::robust::{Found, Inner, WorstCase};
use crate::eip::root::{self, Bracket};
use crate::eip::{Boundary, Interval};
use crate::error::{Error, Result};
use crate::par::RunControl;
use crate::small::Cx;

/// Relative tolerance of the integrals for one `Delta`.
const TOLERANCE: f64 = 1e-8;
/// That of the mesh on which many are compared.
const COARSE: f64 = 1e-4;
/// All-pass factors at most.
const FACTORS: usize = 4;
/// Searches for one end at most.
const ROUNDS: usize = 4;
/// Frequencies of the raster, two decades to each side of the loop's scale.
const RASTER: usize = 25;
const DAMPING: [f64; 3] = [0.1, 0.4, 1.0];
/// Delays of the raster.
const DELAYS: usize = 16;
/// Longest delay that is tried, in units of the loop's scale.
const LONGEST: f64 = 100.0;
/// A factor must gain this share to stay.
const GAIN: f64 = 1e-4;
/// A boundary that moves by less than this share of the outer estimate rests.
const RESTS: f64 = 1e-3;

pub(super) struct Search<'a, 'e> {
    worst: &'a WorstCase<'a, 'e>,
    control: &'a RunControl<'a>,
    /// Longest delay that the bound covers.
    covered: f64,
}

/// A frequency with what a `Delta` needs there.
struct Node {
    omega: f64,
    w: Cx<f64>,
    t: Cx<f64>,
    /// Of the model that should lose less the one that should win.
    lead: Quadratic,
}

impl<'a, 'e> Search<'a, 'e> {
    pub(super) fn new(worst: &'a WorstCase<'a, 'e>, control: &'a RunControl<'a>) -> Self {
        let gamma = worst.engine.second_route().gamma;
        // a bound that covers every delay: some turns of the loop's own scale
        let covered = worst.bound.covered_delay(gamma).min(LONGEST / gamma);
        Self { worst, control, covered }
    }

    /// The inner estimate around a boundary inside `outer`.
    pub(super) fn around(
        &self,
        boundary: &Boundary,
        neighbours: [f64; 2],
        outer: &Interval,
    ) -> Result<Inner> {
        let (i, j, x) = (boundary.left, boundary.right, boundary.value);
        let (low, lower) = self.end([i, j], x, outer.from.max(neighbours[0]))?;
        let (high, upper) = self.end([j, i], x, outer.to.min(neighbours[1]))?;
        Ok(Inner { interval: Interval { from: low, to: high }, lower, upper })
    }

    /// How far from `start` towards `limit` the second of two models can be made
    /// to beat the first, which wins there without a `Delta`.
    fn end(&self, pair: [usize; 2], start: f64, limit: f64) -> Result<(f64, Option<Found>)> {
        let (mut x, mut best) = (start, None);
        for _ in 0..ROUNDS {
            if self.control.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let Some(found) = self.maximise(x, pair)? else { break };
            let next = self.reach(&found, pair, [start, limit])?;
            let further = (next - x) * (limit - start).signum();
            if further.is_nan() || further <= 0.0 {
                break;
            }
            (x, best) = (next, Some(found));
            if further <= RESTS * (limit - start).abs() {
                break;
            }
        }
        Ok((x, best))
    }

    /// Where the boundary is with `found`, between `start` and `limit`.
    fn reach(&self, found: &Found, pair: [usize; 2], [start, limit]: [f64; 2]) -> Result<f64> {
        let value = |x: f64| self.difference(x, pair, found);
        let (at_start, at_limit) = (value(start)?, value(limit)?);
        if at_start.is_nan() || at_start <= 0.0 {
            return Ok(start);
        }
        if at_limit.is_nan() || at_limit >= 0.0 {
            return Ok(if at_limit.is_nan() { start } else { limit });
        }
        let rising = limit < start;
        let ends = if rising {
            [(limit, at_limit), (start, at_start)]
        } else {
            [(start, at_start), (limit, at_limit)]
        };
        let f = |xs: &[f64]| -> Result<Vec<Option<f64>>> {
            xs.iter().map(|x| value(*x).map(Some)).collect()
        };
        let width = 1e-9 * (limit - start).abs();
        Ok(match root::bracket(ends[0], ends[1], width, f)? {
            // the end where the second model wins
            Bracket::Root(a, b) => {
                if rising {
                    b.0
                } else {
                    a.0
                }
            }
            Bracket::Undefined(_) => start,
        })
    }

    /// Upsilon of the first model less that of the second with a `Delta`.
    fn difference(&self, x: f64, [i, j]: [usize; 2], found: &Found) -> Result<f64> {
        let places = self.places([i, j]);
        let Some([i, j]) = places else { return Ok(f64::NAN) };
        let opened = self.opened(x)?;
        let bound = self.worst.bound;
        let route = self.worst.engine.second_route();
        let (integrals, _) = route.integrate_parts(&opened, 1, TOLERANCE, |omega, parts, out| {
            let [re, im] = bound.response(omega);
            let p = image(parts.t(), found.response(omega, Cx::new(re, im)));
            out[0] = parts.upsilon(i).minus(parts.upsilon(j)).at(p);
        });
        Ok(integrals[0].value)
    }

    fn places(&self, pair: [usize; 2]) -> Option<[usize; 2]> {
        let place = |i: usize| self.worst.engine.designed.binary_search(&i).ok();
        Some([place(pair[0])?, place(pair[1])?])
    }

    fn opened(&self, x: f64) -> Result<Opened> {
        let setup = self.worst.setup;
        Opened::new(setup, &setup.theta_at(&[x]), self.worst.engine.delay)
    }

    /// The best `Delta` found at `x`.
    fn maximise(&self, x: f64, pair: [usize; 2]) -> Result<Option<Found>> {
        let Some([i, j]) = self.places(pair) else { return Ok(None) };
        let opened = self.opened(x)?;
        let bound = self.worst.bound;
        let route = self.worst.engine.second_route();
        let (_, mesh) = route.integrate_parts(&opened, 1, COARSE, |omega, parts, out| {
            let lead = parts.upsilon(i).minus(parts.upsilon(j));
            let disc = Disc::new(parts.t(), bound.size(omega));
            out[0] = disc.map_or(f64::NAN, |disc| lead.max(&disc));
        });
        let mut nodes = Vec::new();
        route.parts_on(&opened, &mesh, |omega, parts| {
            let [re, im] = bound.response(omega);
            let lead = parts.upsilon(i).minus(parts.upsilon(j));
            nodes.push(Node { omega, w: Cx::new(re, im), t: parts.t(), lead });
        });
        let mut best: Option<(f64, Found)> = None;
        let mut offer = |value: f64, found: Found| {
            if best.as_ref().is_none_or(|b| value > b.0) {
                best = Some((value, found));
            }
        };
        for gain in [1.0, -1.0] {
            let (value, found) = all_pass(&nodes, route.gamma, gain);
            offer(value, found);
        }
        let shorter = self.worst.engine.delay.min(self.covered);
        for (reach, sign) in [(self.covered, 1.0), (shorter, -1.0)] {
            for k in 1..=DELAYS {
                let found = Found::Delay { h: sign * reach * k as f64 / DELAYS as f64 };
                if reach > 0.0 {
                    offer(objective(&nodes, &found), found);
                }
            }
        }
        Ok(best.map(|(_, found)| found))
    }
}

fn objective(nodes: &[Node], found: &Found) -> f64 {
    nodes.iter().map(|n| n.lead.at(image(n.t, found.response(n.omega, n.w)))).sum()
}

/// The best product of all-pass factors found from `gain` on, and its value.
fn all_pass(nodes: &[Node], gamma: f64, gain: f64) -> (f64, Found) {
    let start = Found::AllPass { gain, real: Vec::new(), pairs: Vec::new() };
    let mut best = refined(nodes, objective(nodes, &start), start);
    for _ in 0..FACTORS {
        let mut step: Option<(f64, Found)> = None;
        for k in 0..RASTER {
            let at = gamma * libm::pow(10.0, 4.0 * k as f64 / (RASTER - 1) as f64 - 2.0);
            for damping in [None].into_iter().chain(DAMPING.map(Some)) {
                let mut next = best.1.clone();
                if let Found::AllPass { real, pairs, .. } = &mut next {
                    match damping {
                        None => real.push(at),
                        Some(z) => pairs.push([at, z]),
                    }
                }
                let value = objective(nodes, &next);
                if step.as_ref().is_none_or(|s| value > s.0) {
                    step = Some((value, next));
                }
            }
        }
        let Some((value, next)) = step else { break };
        let next = refined(nodes, value, next);
        if next.0.is_nan() || next.0 <= best.0 + GAIN * best.0.abs() {
            break;
        }
        best = next;
    }
    best
}

/// Moves every number of `found` by shrinking steps as long as the value rises.
fn refined(nodes: &[Node], value: f64, found: Found) -> (f64, Found) {
    let (mut value, mut found) = (value, found);
    let mut step = 0.4;
    while step > 2e-3 {
        let mut moved = false;
        for k in 0..freedom(&found) {
            for by in [step, -step] {
                let next = shifted(&found, k, by);
                let at = objective(nodes, &next);
                if at > value {
                    (value, found, moved) = (at, next, true);
                    break;
                }
            }
        }
        if !moved {
            step *= 0.5;
        }
    }
    (value, found)
}

fn freedom(found: &Found) -> usize {
    match found {
        Found::AllPass { real, pairs, .. } => 1 + real.len() + 2 * pairs.len(),
        Found::Delay { .. } => 0,
    }
}

/// `found` with number `k` changed: the gain by addition, the others in their
/// logarithm.
fn shifted(found: &Found, k: usize, by: f64) -> Found {
    let mut next = found.clone();
    if let Found::AllPass { gain, real, pairs } = &mut next {
        let factor = libm::exp(by);
        match k {
            0 => *gain = (*gain + by).clamp(-1.0, 1.0),
            k if k <= real.len() => real[k - 1] *= factor,
            k => {
                let k = k - 1 - real.len();
                pairs[k / 2][k % 2] *= factor;
            }
        }
    }
    next
}
