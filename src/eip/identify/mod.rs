//! What the weights of a bank settle on: one model, a mixture, or neither.
//!
//! The sets of Upsilon say which model explains a plant best. Whether the weights
//! end there depends on their law: the posterior does, the dynamic weighting signal
//! generator only outside a band around each boundary, the differential equation
//! of Dunn's weights averages.

mod gauss;
mod joint;
mod mixture;
mod result;
mod simplex;

pub use result::{Band, Identification, Lemma, Outcome, OutcomeKind, Stretch, WeightLaw};

use faer::Mat;

use crate::eip::engine::Engine;
use crate::eip::identify::gauss::{Ratio, Scale};
use crate::eip::identify::joint::Joint;
use crate::eip::root::{self, Bracket};
use crate::eip::setup::Setup;
use crate::eip::study::Study;
use crate::eip::{Case, Convention, Interval};
use crate::error::{Error, Result};
use crate::par::{RunControl, try_map_chunks};

/// Models of a bank at most: the joint covariances grow with their square.
const MODELS: usize = 24;
/// A weight that is all but this has won.
const ALL: f64 = 1e-6;
/// A weight of a mixture below this is taken for none.
const PRESENT: f64 = 1e-3;
/// Exponents (relative to lambda) that are taken for zero.
const NEUTRAL: f64 = 1e-10;
/// Ends of bands are bracketed to this share of the grid's span.
const BRACKET: f64 = 1e-11;
/// Temperings whose bands are told beside the scenario's own.
const TEMPERINGS: [f64; 4] = [1.0, 0.5, 0.25, 0.1];

/// Fails unless what `law` does can be told for a study.
pub(crate) fn check(setup: &Setup, law: WeightLaw) -> Result<()> {
    convention(setup, law)?;
    let models = setup.pairs.iter().flatten().count();
    if law == WeightLaw::Posterior || models <= MODELS {
        return Ok(());
    }
    Err(Error::Conflict {
        problem: format!(
            "the weights of {models} models, over the limit of {MODELS} for a law that may average"
        ),
        remedy: "give fewer models, or leave [weighting] out of the study".into(),
    })
}

/// What `law` does with the plants of `case`, the first of the study.
///
/// # Errors
/// A mistake in the study, `Cancelled`.
pub(crate) fn analyse(
    setup: &Setup,
    case: &Case,
    law: WeightLaw,
    control: &RunControl<'_>,
) -> Result<Identification> {
    if law == WeightLaw::Posterior {
        return Ok(posterior(setup, case));
    }
    // the covariances of the law's own convention
    let study = Study { convention: convention(setup, law)?, ..setup.study.bare() };
    let own = Setup::new(&study)?;
    let engine = Engine::new(&own, case.delay)?;
    Weighed { setup: &own, engine: &engine, case, law }.run(control)
}

/// The convention in which a law's residuals are described.
fn convention(setup: &Setup, law: WeightLaw) -> Result<Convention> {
    let continuous = setup.nominal.time.is_continuous();
    match law {
        WeightLaw::Posterior => Ok(setup.study.convention),
        WeightLaw::Ode if continuous => Ok(Convention::Ito),
        WeightLaw::Ode => Err(Error::Conflict {
            problem: "Dunn's differential equation with a discrete plant".into(),
            remedy: "use law = \"bayes\" or \"dwsg\"".into(),
        }),
        WeightLaw::Dwsg { dt, .. } => match (setup.study.convention, setup.nominal.time) {
            (c @ Convention::Baram { .. }, _) => Ok(c),
            (_, crate::model::Time::Discrete { dt }) => Ok(Convention::Baram { dt }),
            _ => dt.map(|dt| Convention::Baram { dt }).ok_or_else(|| Error::Conflict {
                problem: "the likelihoods of the dynamic weighting signal generator without a \
                          sampling interval"
                    .into(),
                remedy: "give bank.dt, or convention = \"baram\" with dt".into(),
            }),
        },
    }
}

/// The posterior follows Upsilon: its log-odds move at the difference.
fn posterior(setup: &Setup, case: &Case) -> Identification {
    let n = setup.models.len();
    let outcome = |k: usize| {
        let winner = case.winner[k]?;
        let margin = case.margin[k];
        let mut weights = vec![0.0; n];
        weights[winner] = 1.0;
        // false for NaN, too
        let kind = if margin > 0.0 { OutcomeKind::Identifies } else { OutcomeKind::Undecided };
        Some(Outcome { kind, model: winner, exponent: -margin, weights, smooth: None, lemma: None })
    };
    let mut stretches = Vec::new();
    for (model, set) in case.sets.iter().enumerate() {
        let kind = OutcomeKind::Identifies;
        stretches.extend(set.iter().map(|&interval| Stretch { interval, model, kind }));
    }
    stretches.sort_by(|a, b| a.interval.from.total_cmp(&b.interval.from));
    let law = WeightLaw::Posterior;
    let outcomes = (0..case.winner.len()).map(outcome).collect();
    Identification { law, dt: None, outcomes, stretches, bands: Vec::new() }
}

struct Weighed<'a, 'e> {
    setup: &'a Setup,
    engine: &'a Engine<'e>,
    case: &'a Case,
    law: WeightLaw,
}

impl Weighed<'_, '_> {
    fn run(&self, control: &RunControl<'_>) -> Result<Identification> {
        let grid = &self.setup.study.grid;
        let silent = RunControl { progress: None, ..*control };
        let joints = try_map_chunks(&silent, grid.len(), 8, |range| {
            let one =
                |k: usize| self.case.winner[k].map(|_| self.joint(&grid.point(k))).transpose();
            range.map(one).collect::<Result<Vec<_>>>()
        })?;
        let joints: Vec<Option<Joint>> = joints.into_iter().flatten().collect();
        let outcomes = try_map_chunks(&silent, grid.len(), 8, |range| {
            let one = |k: usize| match (self.case.winner[k], &joints[k]) {
                (Some(w), Some(joint)) => self.outcome(joint, w).map(Some),
                _ => Ok(None),
            };
            range.map(one).collect::<Result<Vec<_>>>()
        })?;
        let mut found = Identification {
            law: self.law,
            dt: match self.setup.study.convention {
                Convention::Baram { dt } => Some(dt),
                _ => None,
            },
            outcomes: outcomes.into_iter().flatten().collect(),
            stretches: Vec::new(),
            bands: Vec::new(),
        };
        if grid.axes().len() == 1 {
            self.line(&joints, &silent, &mut found)?;
        }
        Ok(found)
    }

    fn joint(&self, point: &[f64]) -> Result<Joint> {
        Joint::new(self.setup, self.engine, &self.setup.theta_at(point))
    }

    fn outcome(&self, joint: &Joint, winner: usize) -> Result<Outcome> {
        match self.law {
            WeightLaw::Dwsg { lambda, tempering, .. } => {
                self.dwsg(joint, winner, lambda, tempering)
            }
            _ => self.ode(joint, winner),
        }
    }

    /// Positive where the law averages at a plant that `winner` wins, negative
    /// where one model attracts.
    fn averages(&self, joint: &Joint, winner: usize, tempering: Option<f64>) -> Result<f64> {
        match tempering {
            Some(tempering) => {
                Ok(self.invader(joint, winner, tempering)?.map_or(-1.0, |(_, e, _)| e.min(1e300)))
            }
            None => {
                let outcome = self.ode(joint, winner)?;
                let most = outcome.weights.iter().copied().fold(0.0, f64::max);
                Ok(1.0 - ALL - most)
            }
        }
    }

    /// The model with the largest `E[l_j/l_w] - 1`, that number, and the ratio.
    fn invader(
        &self,
        joint: &Joint,
        winner: usize,
        tempering: f64,
    ) -> Result<Option<(usize, f64, Ratio)>> {
        let place = |i: usize| self.engine.designed.binary_search(&i).ok();
        let Some(w) = place(winner) else { return Ok(None) };
        let own = |i: usize| self.setup.models[i].duplicate_of.unwrap_or(i);
        let mut worst: Option<(usize, f64, Ratio)> = None;
        for &j in self.engine.designed.iter().filter(|&&j| own(j) != own(winner)) {
            let (Some(a), Some(b), Some(at)) = (self.scale(winner), self.scale(j), place(j)) else {
                continue;
            };
            let ratio = Ratio::new(a, b, &joint.residuals(w, at), tempering)?;
            let excess = ratio.mean_less_one();
            if worst.as_ref().is_none_or(|(_, e, _)| excess > *e) {
                worst = Some((j, excess, ratio));
            }
        }
        Ok(worst)
    }

    fn scale(&self, i: usize) -> Option<Scale<'_>> {
        let pair = self.setup.pairs[i].as_ref()?;
        Some(Scale { inverse: &pair.W, ln_det: pair.ln_det_innovation()? })
    }

    /// Vertex `w` attracts iff `E[l_j/l_w] < 1` for all `j`; only the winner can.
    fn dwsg(&self, joint: &Joint, w: usize, lambda: f64, tempering: f64) -> Result<Outcome> {
        let mut weights = vec![0.0; self.setup.models.len()];
        weights[w] = 1.0;
        let (smooth, lemma) = (None, None);
        let Some((_, excess, _)) = self.invader(joint, w, tempering)? else {
            let (kind, exponent) = (OutcomeKind::Identifies, f64::NEG_INFINITY);
            return Ok(Outcome { kind, model: w, exponent, weights, smooth, lemma });
        };
        let kind = if excess.abs() <= NEUTRAL {
            OutcomeKind::Undecided
        } else if excess < 0.0 {
            OutcomeKind::Identifies
        } else {
            weights = self.mixture(joint, w, tempering)?;
            OutcomeKind::Averages
        };
        let exponent = lambda * excess;
        Ok(Outcome { kind, model: w, exponent, weights, smooth, lemma })
    }

    /// The mixture with the largest mean log-likelihood; NaN if there is none.
    fn mixture(&self, joint: &Joint, w: usize, tempering: f64) -> Result<Vec<f64>> {
        let own = |i: usize| self.setup.models[i].duplicate_of.is_none() || i == w;
        // models, their places among those designed, and how they judge residuals
        let mut each: Vec<(usize, usize, Scale<'_>)> = Vec::new();
        for (place, &i) in self.engine.designed.iter().enumerate() {
            each.extend(self.scale(i).filter(|_| own(i)).map(|scale| (i, place, scale)));
        }
        let mut weights = vec![0.0; self.setup.models.len()];
        let places: Vec<usize> = each.iter().map(|e| e.1).collect();
        let scales: Vec<Scale<'_>> = each.iter().map(|e| e.2).collect();
        let at = each.iter().position(|e| e.0 == w).unwrap_or(0);
        let Some(p) = mixture::best(&scales, at, &joint.all(&places), tempering) else {
            weights.fill(f64::NAN);
            return Ok(weights);
        };
        let support: Vec<usize> = (0..p.len()).filter(|&k| p[k] > PRESENT).collect();
        if let [a, b] = support[..] {
            // two models alone have an exact mixture
            let sigma = joint.residuals(places[a], places[b]);
            let p = Ratio::new(scales[a], scales[b], &sigma, tempering)?.mixture();
            (weights[each[a].0], weights[each[b].0]) = (p, 1.0 - p);
            return Ok(weights);
        }
        for (e, p) in each.iter().zip(p) {
            weights[e.0] = p;
        }
        Ok(weights)
    }

    /// The simplex minimum of the error's Gram matrix, for noise held over each
    /// interval and for smooth noise.
    fn ode(&self, joint: &Joint, w: usize) -> Result<Outcome> {
        let designed = &self.engine.designed;
        let places: Vec<usize> = (0..designed.len()).collect();
        let pairs: Vec<_> = designed.iter().filter_map(|&i| self.setup.pairs[i].as_ref()).collect();
        let n = places.len();
        let gram = joint.gram(&pairs[0].W, &places);
        // s_i = tr(C_i L_i)
        let gain = |c: &Mat<f64>, h: &Mat<f64>| -> f64 {
            let product = c * h;
            (0..product.nrows()).map(|k| product[(k, k)]).sum()
        };
        let s: Vec<f64> = pairs.iter().map(|p| gain(&p.C, &p.H)).collect();
        let full = |p: Option<Vec<f64>>| -> Vec<f64> {
            let mut weights = vec![f64::NAN; self.setup.models.len()];
            if let Some(p) = p {
                weights.fill(0.0);
                for (&i, p) in designed.iter().zip(p) {
                    weights[i] = p;
                }
            }
            weights
        };
        let held = full(simplex::minimise(&gram, &s));
        let smooth = full(simplex::minimise(&gram, &vec![0.0; n]));
        let at = designed.binary_search(&w).unwrap_or(0);
        let others: Vec<usize> = (0..n).filter(|&i| i != at).collect();
        let rest: Vec<f64> = others
            .iter()
            .flat_map(|&i| others.iter().map(move |&j| (i, j)))
            .map(|(i, j)| gram[i * n + j])
            .collect();
        let eps = gram[at * n + at];
        let lemma = simplex::least_energy(&rest, n - 1).map(|mu| Lemma {
            eps,
            mu,
            bound: (1.0 - (2.0 * eps / mu).sqrt()).clamp(0.0, 1.0),
        });
        let most = (0..held.len()).max_by(|&i, &j| held[i].total_cmp(&held[j])).unwrap_or(w);
        let growth = |j: usize| {
            let k = designed.binary_search(&most).unwrap_or(0);
            gram[k * n + k] - gram[j * n + k] + 0.5 * (s[j] - s[k])
        };
        let exponent = (0..n).filter(|&j| designed[j] != most).map(growth);
        let exponent = exponent.fold(f64::NEG_INFINITY, f64::max);
        let kind = if held[most].is_nan() {
            OutcomeKind::Undecided
        } else if held[most] >= 1.0 - ALL {
            OutcomeKind::Identifies
        } else {
            OutcomeKind::Averages
        };
        Ok(Outcome { kind, model: most, exponent, weights: held, smooth: Some(smooth), lemma })
    }

    /// Stretches and bands along one parameter.
    fn line(
        &self,
        joints: &[Option<Joint>],
        control: &RunControl<'_>,
        found: &mut Identification,
    ) -> Result<()> {
        let mut won: Vec<(Interval, usize)> = Vec::new();
        for (w, set) in self.case.sets.iter().enumerate() {
            won.extend(set.iter().map(|i| (*i, w)));
        }
        won.sort_by(|a, b| a.0.from.total_cmp(&b.0.from));
        let mut temperings = match self.law {
            WeightLaw::Dwsg { tempering, .. } => vec![Some(tempering)],
            _ => vec![None],
        };
        if temperings[0].is_some() {
            let more = TEMPERINGS.iter().copied().filter(|t| Some(*t) != temperings[0]);
            temperings.extend(more.map(Some).collect::<Vec<_>>());
        }
        let jobs = temperings.len() * won.len();
        let parts = try_map_chunks(control, jobs, 1, |range| {
            let one = |k: usize| {
                let (interval, w) = won[k % won.len()];
                self.cuts(joints, interval, w, temperings[k / won.len()], control)
            };
            range.map(one).collect::<Result<Vec<_>>>()
        })?;
        let parts: Vec<Vec<Stretch>> = parts.into_iter().flatten().collect();
        for (tempering, parts) in temperings.iter().zip(parts.chunks(won.len().max(1))) {
            let Some(tempering) = *tempering else { continue };
            let mut band = Band { tempering, intervals: Vec::new() };
            for s in parts.iter().flatten().filter(|s| s.kind == OutcomeKind::Averages) {
                match band.intervals.last_mut() {
                    Some(last) if last.to == s.interval.from => last.to = s.interval.to,
                    _ => band.intervals.push(s.interval),
                }
            }
            found.bands.push(band);
        }
        found.stretches = parts.into_iter().take(won.len()).flatten().collect();
        found.bands.sort_by(|a, b| b.tempering.total_cmp(&a.tempering));
        Ok(())
    }

    /// A cell, cut where the answer changes.
    fn cuts(
        &self,
        joints: &[Option<Joint>],
        cell: Interval,
        w: usize,
        tempering: Option<f64>,
        control: &RunControl<'_>,
    ) -> Result<Vec<Stretch>> {
        let axis = &self.setup.study.grid.axes()[0].1;
        let values = axis.values();
        let width = BRACKET * (axis.value(axis.len() - 1) - axis.value(0)).abs();
        let value = |x: f64| -> Result<f64> {
            if control.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let known = values.binary_search_by(|v| v.total_cmp(&x)).ok();
            match known.and_then(|k| joints[k].as_ref()) {
                Some(joint) => self.averages(joint, w, tempering),
                None => self.averages(&self.joint(&[x])?, w, tempering),
            }
        };
        let inside = values.iter().copied().filter(|v| cell.from < *v && *v < cell.to);
        let mut at = vec![cell.from];
        at.extend(inside);
        at.extend((cell.to > cell.from).then_some(cell.to));
        let mut points = Vec::with_capacity(at.len());
        for x in at {
            points.push((x, value(x)?));
        }
        let kind = |v: f64| {
            if v > NEUTRAL { OutcomeKind::Averages } else { OutcomeKind::Identifies }
        };
        let mut all: Vec<Stretch> = Vec::new();
        let mut add = |from: f64, to: f64, kind: OutcomeKind| match all.last_mut() {
            Some(last) if last.kind == kind => last.interval.to = to,
            _ => all.push(Stretch { interval: Interval { from, to }, model: w, kind }),
        };
        if let [only] = points[..] {
            add(only.0, only.0, kind(only.1));
        }
        for pair in points.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let (ka, kb) = (kind(a.1), kind(b.1));
            if ka == kb {
                add(a.0, b.0, ka);
                continue;
            }
            let f = |xs: &[f64]| -> Result<Vec<Option<f64>>> {
                xs.iter().map(|x| Ok(Some(value(*x)? - NEUTRAL))).collect()
            };
            let ends = ((a.0, a.1 - NEUTRAL), (b.0, b.1 - NEUTRAL));
            let x = match root::bracket(ends.0, ends.1, width, f)? {
                Bracket::Root(p, q) => 0.5 * (p.0 + q.0),
                Bracket::Undefined(x) => x,
            };
            add(a.0, x, ka);
            add(x, b.0, kb);
        }
        Ok(all)
    }
}
