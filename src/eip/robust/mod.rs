//! Sets that hold for every unmodelled actuator within a bound.
//!
//! For `|Delta(jw)| <= |W(jw)|` the integrand of `Upsilon_i - Upsilon_j` has a
//! closed-form worst case at each frequency ([`disc`]). Its integral bounds the
//! difference from above, whatever `Delta` is; it is conservative, as the worst
//! `Delta` of each frequency need not be one causal system. A search over causal
//! ones ([`inner`]) shows by how much.

mod disc;
mod inner;
mod parts;
mod peak;
mod result;
mod search;

pub use inner::Found;
pub use result::{Inner, Peak, Robust, Uncertain};

use crate::eip::engine::Engine;
use crate::eip::robust::disc::Disc;
use crate::eip::robust::parts::Opened;
use crate::eip::root::{self, Bracket};
use crate::eip::setup::Setup;
use crate::eip::{Case, Convention, Interval};
use crate::error::{Error, Result};
use crate::model::ActuatorBound;
use crate::par::{RunControl, try_map_chunks};

/// Relative tolerance of the worst case's integral; its integrand has kinks.
const TOLERANCE: f64 = 1e-9;
/// Ends of sets are bracketed to this share of the grid's span.
const BRACKET: f64 = 1e-12;
/// Stands for a difference without bound.
const UNBOUNDED: f64 = 1e300;

/// Fails unless the analysis can be done for a study.
pub(crate) fn check(setup: &Setup, bound: &ActuatorBound) -> Result<()> {
    bound.check()?;
    let conflict =
        |problem: String, remedy: &str| Err(Error::Conflict { problem, remedy: remedy.into() });
    let inputs = setup.nominal.nu();
    if inputs != 1 {
        return conflict(
            format!("a bound on the unmodelled actuator dynamics with {inputs} inputs"),
            "remove actuator.W: it is for plants of a single input",
        );
    }
    if setup.sampled.is_some() || !setup.time.is_continuous() {
        return conflict(
            "a bound on the unmodelled actuator dynamics of a sampled study".into(),
            "use a continuous plant and convention \"ito\" or \"identity\", or remove actuator.W",
        );
    }
    debug_assert!(!matches!(setup.study.convention, Convention::Baram { .. }));
    if setup.controller.is_none() && setup.input.is_none() {
        return conflict(
            "a bound on the unmodelled actuator dynamics, and nothing drives the input".into(),
            "add [controller] or [input], or remove actuator.W",
        );
    }
    Ok(())
}

/// The sets that hold for every `Delta` within `bound`, about the delay of `case`.
///
/// # Errors
/// A mistake in the study, `Cancelled`.
pub(crate) fn analyse(
    setup: &Setup,
    engine: &Engine<'_>,
    case: &Case,
    bound: &ActuatorBound,
    control: &RunControl<'_>,
) -> Result<Robust> {
    let worst = WorstCase { setup, engine, bound };
    let grid = &setup.study.grid;
    let plants = try_map_chunks(control, grid.len(), 8, |range| {
        let one = |k: usize| case.winner[k].map(|w| worst.probe(&grid.point(k), w)).transpose();
        range.map(one).collect::<Result<Vec<_>>>()
    })?;
    let plants: Vec<Option<Probe>> = plants.into_iter().flatten().collect();
    let mut robust = Robust::empty(case.delay, setup.models.len());
    for (k, plant) in plants.iter().enumerate() {
        let none = Probe { peak: (f64::NAN, 0.0), lead: f64::NAN, error: 0.0, rivals: Vec::new() };
        let plant = plant.as_ref().unwrap_or(&none);
        let holds = plant.lead > 0.0 && plant.peak.0 < 1.0;
        robust.guaranteed.push(case.winner[k].filter(|_| holds));
        robust.lead.push(if plant.lead <= -UNBOUNDED { f64::NEG_INFINITY } else { plant.lead });
        robust.loop_gain.push(plant.peak.0);
        robust.error = robust.error.max(plant.error);
        if plant.peak.0 > robust.peak.map_or(f64::NEG_INFINITY, |p| p.size) {
            robust.peak = Some(Peak { plant: k, size: plant.peak.0, omega: plant.peak.1 });
        }
    }
    if grid.axes().len() == 1 {
        worst.line(case, &plants, control, &mut robust)?;
    }
    Ok(robust)
}

/// The analysis of one study and delay.
struct WorstCase<'a, 'e> {
    setup: &'a Setup,
    engine: &'a Engine<'e>,
    bound: &'a ActuatorBound,
}

/// A plant that was looked at, as the nominal winner's.
#[derive(Clone)]
struct Probe {
    /// Largest `|W T|`, and the frequency.
    peak: (f64, f64),
    /// Least lead of the winner over any rival for any `Delta`, less the error
    /// of the quadrature.
    lead: f64,
    error: f64,
    /// Rivals that some `Delta` may let win.
    rivals: Vec<usize>,
}

/// A stretch of the parameter with one nominal winner and one answer.
struct Stretch {
    interval: Interval,
    winner: usize,
    rivals: Vec<usize>,
    answer: Answer,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Answer {
    Guaranteed,
    Undecidable,
    /// Some allowed `Delta` makes the loop unstable.
    Fragile,
}

impl WorstCase<'_, '_> {
    /// The nominal `winner` against all others at the grid's point `values`.
    fn probe(&self, values: &[f64], winner: usize) -> Result<Probe> {
        let opened = Opened::new(self.setup, &self.setup.theta_at(values), self.engine.delay)?;
        let route = self.engine.second_route();
        let peak = peak::peak(route, &opened, self.bound);
        let designed = &self.engine.designed;
        let place = |i: usize| designed.binary_search(&i).ok();
        let same = |i: usize| self.setup.models[i].duplicate_of.unwrap_or(i);
        let rivals: Vec<usize> =
            designed.iter().copied().filter(|&j| same(j) != same(winner)).collect();
        let none = Probe { peak, lead: f64::INFINITY, error: 0.0, rivals: Vec::new() };
        let Some(own) = place(winner).filter(|_| !rivals.is_empty()) else { return Ok(none) };
        if peak.0.is_nan() || peak.0 >= 1.0 {
            return Ok(Probe { lead: -UNBOUNDED, rivals, ..none });
        }
        let places: Vec<usize> = rivals.iter().filter_map(|&j| place(j)).collect();
        let (integrals, _) =
            route.integrate_parts(&opened, places.len(), TOLERANCE, |w, parts, out| {
                let Some(disc) = Disc::new(parts.t(), self.bound.size(w)) else {
                    out.fill(f64::NAN);
                    return;
                };
                let first = parts.upsilon(own);
                for (value, &j) in out.iter_mut().zip(&places) {
                    *value = first.minus(parts.upsilon(j)).max(&disc);
                }
            });
        let mut probe = Probe { rivals: Vec::new(), ..none };
        for (integral, &j) in integrals.iter().zip(&rivals) {
            let worst = integral.value + integral.error;
            let lead = if worst.is_nan() { -UNBOUNDED } else { -worst };
            if lead <= 0.0 {
                probe.rivals.push(j);
            }
            if lead < probe.lead {
                (probe.lead, probe.error) = (lead, integral.error);
            }
        }
        Ok(probe)
    }

    /// The sets along one parameter.
    fn line(
        &self,
        case: &Case,
        plants: &[Option<Probe>],
        control: &RunControl<'_>,
        robust: &mut Robust,
    ) -> Result<()> {
        let values = self.setup.study.grid.axes()[0].1.values();
        let mut won: Vec<(Interval, usize)> = Vec::new();
        for (w, set) in case.sets.iter().enumerate() {
            won.extend(set.iter().map(|i| (*i, w)));
        }
        won.sort_by(|a, b| a.0.from.total_cmp(&b.0.from));
        let found = try_map_chunks(control, won.len(), 1, |range| {
            let mut found = Vec::new();
            for &(interval, winner) in &won[range] {
                let known = |x: f64| {
                    let k = values.binary_search_by(|v| v.total_cmp(&x)).ok()?;
                    plants[k].clone().filter(|_| case.winner[k] == Some(winner))
                };
                let inside = values.iter().copied();
                let inside = inside.filter(|v| interval.from < *v && *v < interval.to);
                let ends = [interval.from, interval.to];
                let mut at: Vec<f64> = ends[..1].iter().copied().chain(inside).collect();
                at.extend((interval.to > interval.from).then_some(interval.to));
                found.extend(self.stretches(&at, winner, known, control)?);
            }
            Ok(found)
        })?;
        self.collect(case, found.into_iter().flatten().collect(), control, robust)
    }

    /// Cuts a stretch won by `winner`, with the points `at`, where the answer
    /// changes.
    fn stretches(
        &self,
        at: &[f64],
        winner: usize,
        known: impl Fn(f64) -> Option<Probe>,
        control: &RunControl<'_>,
    ) -> Result<Vec<Stretch>> {
        let probe = |x: f64| match known(x) {
            Some(probe) => Ok(probe),
            None if control.is_cancelled() => Err(Error::Cancelled),
            None => self.probe(&[x], winner),
        };
        let axis = &self.setup.study.grid.axes()[0].1;
        let width = BRACKET * (axis.value(axis.len() - 1) - axis.value(0)).abs();
        let fragile = |p: &Probe| 1.0 - p.peak.0.min(UNBOUNDED);
        let lead = |p: &Probe| p.lead.clamp(-UNBOUNDED, UNBOUNDED);
        let mut points: Vec<(f64, Probe)> = Vec::new();
        for &x in at {
            points.push((x, probe(x)?));
        }
        for value in [&fragile as &dyn Fn(&Probe) -> f64, &lead] {
            let mut cut: Vec<(f64, Probe)> = Vec::new();
            for pair in points.windows(2) {
                let (a, b) = (&pair[0], &pair[1]);
                cut.push(a.clone());
                let (fa, fb) = (value(&a.1), value(&b.1));
                if (fa > 0.0) == (fb > 0.0) || fa == 0.0 || fb == 0.0 {
                    continue;
                }
                let f = |xs: &[f64]| -> Result<Vec<Option<f64>>> {
                    xs.iter().map(|x| Ok(Some(value(&probe(*x)?)))).collect()
                };
                if let Bracket::Root(p, q) = root::bracket((a.0, fa), (b.0, fb), width, f)? {
                    // the end that promises less
                    let x = if p.1 > 0.0 { p.0 } else { q.0 };
                    if x > a.0 && x < b.0 {
                        cut.push((x, probe(x)?));
                    }
                }
            }
            cut.extend(points.last().cloned());
            points = cut;
        }
        let mut all: Vec<Stretch> = Vec::new();
        for k in 0..points.len().max(2) - 1 {
            let (a, b) = (&points[k], points.get(k + 1).unwrap_or(&points[k]));
            let middle = if a.0 == b.0 { a.1.clone() } else { probe(0.5 * (a.0 + b.0))? };
            let answer = if fragile(&middle) <= 0.0 {
                Answer::Fragile
            } else if middle.lead > 0.0 {
                Answer::Guaranteed
            } else {
                Answer::Undecidable
            };
            let rivals = [&a.1, &middle, &b.1].into_iter().flat_map(|p| p.rivals.iter().copied());
            let rivals: Vec<usize> = rivals.filter(|_| answer == Answer::Undecidable).collect();
            let interval = Interval { from: a.0, to: b.0 };
            match all.last_mut() {
                Some(last) if last.answer == answer => {
                    last.interval.to = b.0;
                    last.rivals.extend(rivals);
                }
                _ => all.push(Stretch { interval, winner, rivals, answer }),
            }
        }
        Ok(all)
    }

    /// Joins the stretches of all winners, and looks for the inner estimates.
    fn collect(
        &self,
        case: &Case,
        stretches: Vec<Stretch>,
        control: &RunControl<'_>,
        robust: &mut Robust,
    ) -> Result<()> {
        for s in stretches {
            let mut models = s.rivals;
            models.push(s.winner);
            match s.answer {
                Answer::Guaranteed => robust.sets[s.winner].push(s.interval),
                Answer::Fragile => match robust.fragile.last_mut() {
                    Some(last) if last.to == s.interval.from => last.to = s.interval.to,
                    _ => robust.fragile.push(s.interval),
                },
                Answer::Undecidable => match robust.undecidable.last_mut() {
                    Some(last) if last.interval.to == s.interval.from => {
                        last.interval.to = s.interval.to;
                        last.models.append(&mut models);
                    }
                    _ => robust.undecidable.push(Uncertain {
                        interval: s.interval,
                        models,
                        inner: Vec::new(),
                    }),
                },
            }
        }
        for u in &mut robust.undecidable {
            u.models.sort_unstable();
            u.models.dedup();
        }
        let search = search::Search::new(self, control);
        let inner = try_map_chunks(control, robust.undecidable.len(), 1, |range| {
            let mut all = Vec::new();
            for u in &robust.undecidable[range] {
                let mut inner = Vec::new();
                for (k, b) in case.boundaries.iter().enumerate() {
                    if u.interval.from <= b.value && b.value <= u.interval.to {
                        let at = |k: usize| case.boundaries.get(k).map(|b| b.value);
                        let before = k.checked_sub(1).and_then(at).unwrap_or(f64::NEG_INFINITY);
                        let after = at(k + 1).unwrap_or(f64::INFINITY);
                        inner.push(search.around(b, [before, after], &u.interval)?);
                    }
                }
                all.push(inner);
            }
            Ok(all)
        })?;
        for (u, inner) in robust.undecidable.iter_mut().zip(inner.into_iter().flatten()) {
            u.inner = inner;
        }
        Ok(())
    }
}
