//! What holds for every unmodelled actuator, and for every delay of an interval,
//! in text and JSON.

use serde::Serialize;

use crate::eip::{DelaySweep, EipSets, Found, Inner, Interval, Peak, Robust, Uncertain};
use crate::report::layout::{Table, left, line, right};
use crate::report::significant;
use crate::report::summary::{self, numbers};

#[derive(Serialize)]
pub(super) struct RobustFields<'a> {
    delay: f64,
    stable: bool,
    peak: Option<PeakFields>,
    loop_gain: &'a [f64],
    guaranteed: &'a [Option<usize>],
    lead: &'a [f64],
    error: f64,
    sets: Vec<Vec<[f64; 2]>>,
    undecidable: Vec<UncertainFields<'a>>,
    unstable_intervals: Vec<[f64; 2]>,
}

impl<'a> RobustFields<'a> {
    pub(super) fn new(robust: &'a Robust) -> Self {
        Self {
            delay: robust.delay,
            stable: robust.is_stable(),
            peak: robust.peak.as_ref().map(PeakFields::new),
            loop_gain: &robust.loop_gain,
            guaranteed: &robust.guaranteed,
            lead: &robust.lead,
            error: robust.error,
            sets: robust.sets.iter().map(|set| pairs(set)).collect(),
            undecidable: robust.undecidable.iter().map(UncertainFields::new).collect(),
            unstable_intervals: pairs(&robust.fragile),
        }
    }
}

#[derive(Serialize)]
struct PeakFields {
    plant: usize,
    size: f64,
    omega: f64,
}

impl PeakFields {
    fn new(p: &Peak) -> Self {
        Self { plant: p.plant, size: p.size, omega: p.omega }
    }
}

#[derive(Serialize)]
struct UncertainFields<'a> {
    interval: [f64; 2],
    models: &'a [usize],
    inner: Vec<InnerFields>,
}

impl<'a> UncertainFields<'a> {
    fn new(u: &'a Uncertain) -> Self {
        let inner = u.inner.iter().map(InnerFields::new).collect();
        Self { interval: pair(&u.interval), models: &u.models, inner }
    }
}

#[derive(Serialize)]
struct InnerFields {
    interval: [f64; 2],
    lower: Option<String>,
    upper: Option<String>,
}

impl InnerFields {
    fn new(inner: &Inner) -> Self {
        let formula = |found: &Option<Found>| found.as_ref().map(Found::formula);
        Self {
            interval: pair(&inner.interval),
            lower: formula(&inner.lower),
            upper: formula(&inner.upper),
        }
    }
}

#[derive(Serialize)]
pub(super) struct SweepFields<'a> {
    delays: [f64; 2],
    undecidable: Vec<UndecidableFields<'a>>,
    unstable_intervals: Vec<[f64; 2]>,
    samples: usize,
    moved: Option<f64>,
    settled: bool,
    covered: Option<bool>,
}

#[derive(Serialize)]
struct UndecidableFields<'a> {
    interval: [f64; 2],
    models: &'a [usize],
}

impl<'a> SweepFields<'a> {
    pub(super) fn new(sweep: &'a DelaySweep) -> Self {
        let fields = |u: &'a crate::eip::Undecidable| UndecidableFields {
            interval: pair(&u.interval),
            models: &u.models,
        };
        Self {
            delays: pair(&sweep.delays),
            undecidable: sweep.undecidable.iter().map(fields).collect(),
            unstable_intervals: pairs(&sweep.unstable),
            samples: sweep.samples,
            moved: sweep.moved.is_finite().then_some(sweep.moved),
            settled: sweep.settled,
            covered: sweep.covered,
        }
    }
}

fn pair(i: &Interval) -> [f64; 2] {
    [i.from, i.to]
}

fn pairs(intervals: &[Interval]) -> Vec<[f64; 2]> {
    intervals.iter().map(pair).collect()
}

/// `[1.152142, 1.158038]`.
fn bracket(i: &Interval) -> String {
    format!("[{}, {}]", significant(i.from, 7), significant(i.to, 7))
}

/// The section on the unmodelled actuator.
pub(super) fn text(out: &mut String, sets: &EipSets) {
    if let Some(robust) = &sets.robust {
        unmodelled(out, sets, robust);
    }
    if let Some(sweep) = &sets.delay_sweep {
        delays(out, sets, sweep);
    }
}

fn unmodelled(out: &mut String, sets: &EipSets, robust: &Robust) {
    out.push('\n');
    let about = match robust.delay {
        0.0 => String::new(),
        delay => format!(" about the delay {}", summary::delay(delay)),
    };
    line(out, &format!("Unmodelled actuator, |Delta(jw)| <= |W(jw)|{about}:"));
    if let Some(peak) = robust.peak {
        let stable = if robust.is_stable() {
            "the loop is stable for every such Delta"
        } else {
            "the loop is NOT stable for every such Delta"
        };
        let at = summary::plant_name(sets, peak.plant);
        let size = significant(peak.size, 5);
        let omega = significant(peak.omega, 4);
        line(out, &format!("{stable}: max |W T| = {size} at {at}, {omega} rad/s."));
    }
    if sets.grid.axes().len() > 1 {
        let certain = robust.guaranteed.iter().flatten().count();
        let all = sets.cases[0].winner.iter().flatten().count();
        line(out, &format!("{certain} of {all} plants have a guaranteed winner."));
        return;
    }
    if !robust.fragile.is_empty() {
        let all: Vec<String> = robust.fragile.iter().map(bracket).collect();
        line(out, &format!("Unstable for some Delta: {}.", all.join(", ")));
    }
    if robust.undecidable.is_empty() {
        line(out, "No plant is undecidable: every stable one has a guaranteed winner.");
        return;
    }
    line(
        out,
        "Outside the sets below the winner is guaranteed; inside the inner ones a causal Delta was found that changes it.",
    );
    let name = &sets.grid.axes()[0].0;
    let mut table = Table::default();
    let head = ["outer", "width", "models", "inner", "share"].map(left);
    table.row([right("set")].into_iter().chain(head).collect());
    for (k, u) in robust.undecidable.iter().enumerate() {
        let width = u.interval.to - u.interval.from;
        let inner: f64 = u.inner.iter().map(|i| i.interval.to - i.interval.from).sum();
        let inners: Vec<String> = u.inner.iter().map(|i| bracket(&i.interval)).collect();
        let share = if width > 0.0 { inner / width } else { 1.0 };
        table.row(vec![
            right(&(k + 1).to_string()),
            left(&format!("{name} in {}", bracket(&u.interval))),
            left(&significant(width, 3)),
            left(&numbers(&u.models, ", ")),
            left(&inners.join(" ")),
            left(&significant(share, 2)),
        ]);
    }
    table.print(out);
}

fn delays(out: &mut String, sets: &EipSets, sweep: &DelaySweep) {
    out.push('\n');
    let [from, to] = [sweep.delays.from, sweep.delays.to].map(summary::delay);
    let rest = if sweep.settled {
        "further ones do not move the sets".into()
    } else if sweep.moved.is_finite() {
        format!("the sets still moved by {}", significant(sweep.moved, 2))
    } else {
        "the sets still changed".into()
    };
    line(
        out,
        &format!(
            "Undecidable for an actuator delay between {from} and {to} ({} delays; {rest}):",
            sweep.samples
        ),
    );
    let name = &sets.grid.axes()[0].0;
    let mut table = Table::default();
    table.row([right("set"), left(name), left("width"), left("models")].into());
    for (k, u) in sweep.undecidable.iter().enumerate() {
        table.row(vec![
            right(&(k + 1).to_string()),
            left(&format!(
                "[{}, {}]",
                significant(u.interval.from, 9),
                significant(u.interval.to, 9)
            )),
            left(&significant(u.interval.to - u.interval.from, 3)),
            left(&numbers(&u.models, ", ")),
        ]);
    }
    if sweep.undecidable.is_empty() {
        line(out, "none.");
    } else {
        table.print(out);
    }
    if !sweep.unstable.is_empty() {
        let all: Vec<String> = sweep.unstable.iter().map(bracket).collect();
        line(out, &format!("Unstable for some of the delays: {}.", all.join(", ")));
    }
    match sweep.covered {
        Some(true) => line(out, "W covers these delays: the sets lie inside those above."),
        Some(false) => line(out, "W does not cover these delays."),
        None => {}
    }
}
