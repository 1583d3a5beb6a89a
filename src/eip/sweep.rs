//! A delay that is only known to lie in an interval.

use crate::eip::engine::Engine;
use crate::eip::run::{self, Line};
use crate::eip::sets::{self, Verdict};
use crate::eip::setup::Setup;
use crate::eip::{Interval, Undecidable};
use crate::error::{Error, Result};
use crate::par::RunControl;

/// Ends of sets that move by less than this share of the grid's span rest.
const RESTS: f64 = 1e-9;
/// Delays at first and at most.
const FIRST: usize = 3;
const MOST: usize = 129;

/// Where the winner depends on a delay in an interval.
///
/// Delays are sampled evenly, both ends included, and halved until the sets stop
/// moving; that is no proof for the delays between.
#[derive(Debug, Clone, PartialEq)]
pub struct DelaySweep {
    /// Shortest and longest delay in seconds.
    pub delays: Interval,
    /// Where not all delays have the same winner.
    pub undecidable: Vec<Undecidable>,
    /// Where the loop is unstable for some delay.
    pub unstable: Vec<Interval>,
    /// Number of delays that were computed.
    pub samples: usize,
    /// By how much any end moved at the last halving; infinite if the sets still
    /// changed in number.
    pub moved: f64,
    /// Whether `moved` is below 1e-9 of the grid's span.
    pub settled: bool,
    /// Whether the bound on the unmodelled actuator, if there is one, covers every
    /// delay of the interval.
    pub covered: Option<bool>,
}

/// Fails unless a delay interval can be swept in a study.
pub(crate) fn check(setup: &Setup, interval: [f64; 2]) -> Result<()> {
    let [from, to] = interval;
    if !(from >= 0.0 && to > from && to.is_finite()) {
        return Err(Error::Range {
            what: "end of the delay interval".into(),
            value: to,
            remedy: "give two delays in seconds, the shorter first".into(),
        });
    }
    let conflict = |problem: &str, remedy: &str| {
        Err(Error::Conflict { problem: problem.into(), remedy: remedy.into() })
    };
    if setup.study.grid.axes().len() != 1 {
        return conflict("a delay interval on a grid of several parameters", "use delays");
    }
    if !setup.time.is_continuous() {
        return conflict("a delay interval in a sampled study", "list whole samples in delays");
    }
    Ok(())
}

/// Sweeps the delays of `interval`, whose study has `nominal` as its first delay.
///
/// # Errors
/// A mistake in the study, `Cancelled`.
pub(crate) fn run(
    setup: &Setup,
    [from, to]: [f64; 2],
    nominal: f64,
    control: &RunControl<'_>,
) -> Result<DelaySweep> {
    let axis = &setup.study.grid.axes()[0].1;
    let span = (axis.value(axis.len() - 1) - axis.value(0)).abs();
    let line = |k: usize, cells: usize| {
        let tau = from + (to - from) * (k as f64 / cells as f64);
        run::line(setup, tau, control)
    };
    let mut cells = FIRST - 1;
    // in the order of their delays
    let mut lines = (0..=cells).map(|k| line(k, cells)).collect::<Result<Vec<Line>>>()?;
    let mut undecidable = sets::undecidable(&lines);
    let mut moved = f64::INFINITY;
    while moved > RESTS * span && 2 * cells < MOST {
        cells *= 2;
        let mut known = std::mem::take(&mut lines).into_iter();
        for k in 0..=cells {
            // every other one was there before
            let before = if k % 2 == 0 { known.next() } else { None };
            lines.push(before.map_or_else(|| line(k, cells), Ok)?);
        }
        let finer = sets::undecidable(&lines);
        moved = movement(&undecidable, &finer);
        undecidable = finer;
    }
    let unstable = merged(lines.iter().flat_map(|l| sets::intervals(l, Verdict::Unstable)));
    let covered = setup.study.unmodelled.as_ref().map(|bound| {
        let reach = (to - nominal).abs().max((from - nominal).abs());
        reach <= bound.covered_delay(Engine::new(setup, nominal).map_or(1.0, |e| e.gamma))
    });
    Ok(DelaySweep {
        delays: Interval { from, to },
        undecidable,
        unstable,
        samples: lines.len(),
        moved,
        settled: moved <= RESTS * span,
        covered,
    })
}

/// The largest move of an end; infinite if the sets are others.
fn movement(before: &[Undecidable], after: &[Undecidable]) -> f64 {
    let same = |(a, b): (&Undecidable, &Undecidable)| a.models == b.models;
    if before.len() != after.len() || !before.iter().zip(after).all(same) {
        return f64::INFINITY;
    }
    before.iter().zip(after).fold(0.0, |most, (a, b)| {
        let (a, b) = (&a.interval, &b.interval);
        most.max((a.from - b.from).abs()).max((a.to - b.to).abs())
    })
}

/// Intervals joined where they overlap.
fn merged(intervals: impl Iterator<Item = Interval>) -> Vec<Interval> {
    let mut all: Vec<Interval> = intervals.collect();
    all.sort_by(|a, b| a.from.total_cmp(&b.from));
    let mut joined: Vec<Interval> = Vec::new();
    for i in all {
        match joined.last_mut() {
            Some(last) if i.from <= last.to => last.to = last.to.max(i.to),
            _ => joined.push(i),
        }
    }
    joined
}
