//! A run: the cases one after the other, each over the grid in chunks.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::eip::engine::{Engine, Flaw};
use crate::eip::refine::Refiner;
use crate::eip::sets::{self, Verdict};
use crate::eip::setup::Setup;
use crate::eip::study::Verify;
use crate::eip::{Case, Doubt, EipSets, Failed, Interval, Undecided, Unstable};
use crate::error::Result;
use crate::par::{RunControl, try_map_chunks};

/// Plants of one chunk: about a millisecond of work.
const CHUNK: usize = 128;
/// Plants whose pairs are computed by both routes where not all are.
pub(crate) const SAMPLE: usize = 512;
/// Routes that differ by more, relative, differ by more than rounding: the
/// Lyapunov route has lost digits, or the Pade approximation is too coarse.
pub(crate) const DIFFER: f64 = 1e-6;
/// Between two checked plants the routes are taken to differ by this multiple of
/// what was found there.
const CAUTION: f64 = 10.0;
/// A frequency integral with a relative error estimate below this may replace
/// the Lyapunov route.
const TRUST: f64 = 1e-8;

/// Runs a prepared study.
pub(crate) fn run(setup: &Setup, control: &RunControl<'_>) -> Result<EipSets> {
    let study = &setup.study;
    let delays = if study.delays.is_empty() { vec![0.0] } else { study.delays.clone() };
    let (mut cases, mut lines) = (Vec::new(), Vec::new());
    let mut first_engine = None;
    let progress = Progress::new(setup, control, delays.len());
    for (k, &delay) in delays.iter().enumerate() {
        let engine = Engine::new(setup, delay)?;
        let of_case = CaseProgress { of: &progress, case: k as u64 };
        let (case, line) = run_case(setup, &engine, delay, &of_case)?;
        progress.report((k as u64 + 1) * (progress.plants + progress.search));
        cases.push(case);
        lines.push(line);
        first_engine.get_or_insert(engine);
    }
    let undecidable = if study.grid.axes().len() == 1 && delays.len() > 1 {
        sets::undecidable(&lines)
    } else {
        Vec::new()
    };
    let (mut at_nominals, mut method) = (Vec::new(), crate::eip::Method::Doubling);
    if let Some(engine) = &first_engine {
        let doubt = cases[0].replaced > 0 || !cases[0].undecided.is_empty();
        at_nominals = matched(setup, engine, doubt, control)?;
        method = engine.method;
    }
    Ok(EipSets {
        title: study.title.clone(),
        parameters: setup.parameters.clone(),
        models: setup.models.clone(),
        convention: study.convention,
        grid: study.grid.clone(),
        cases,
        undecidable,
        at_nominals,
        method,
    })
}

type Line = Vec<(Interval, Verdict)>;

/// Progress of a run in plants: those of the grid, and as many as the search
/// for boundaries costs.
struct Progress<'a> {
    control: &'a RunControl<'a>,
    plants: u64,
    search: u64,
    cases: u64,
    /// What was reported last: what is reported rises.
    last: AtomicU64,
}

/// The two parts of a case.
struct CaseProgress<'a> {
    of: &'a Progress<'a>,
    case: u64,
}

impl<'a> Progress<'a> {
    fn new(setup: &Setup, control: &'a RunControl<'a>, cases: usize) -> Self {
        let plants = setup.study.grid.len() as u64;
        let search = setup.study.search_in_plants(setup.orders);
        Self { control, plants, search, cases: cases as u64, last: AtomicU64::new(0) }
    }

    fn report(&self, done: u64) {
        let last = self.last.fetch_max(done, Ordering::Relaxed);
        if let Some(progress) = self.control.progress.filter(|_| done > last) {
            progress(done, (self.plants + self.search) * self.cases);
        }
    }
}

impl CaseProgress<'_> {
    /// Runs `work` with a control that reports as the grid's part of this case.
    fn grid<R>(&self, work: impl FnOnce(&RunControl<'_>) -> R) -> R {
        self.part(0, self.of.plants, work)
    }

    /// As [`CaseProgress::grid`], as the search for boundaries.
    fn search<R>(&self, work: impl FnOnce(&RunControl<'_>) -> R) -> R {
        self.part(self.of.plants, self.of.search, work)
    }

    fn part<R>(&self, from: u64, size: u64, work: impl FnOnce(&RunControl<'_>) -> R) -> R {
        let of = self.of;
        let each = of.plants + of.search;
        let report = |done: u64, total: u64| {
            let share = (done as f64 / total.max(1) as f64 * size as f64) as u64;
            of.report(self.case * each + from + share.min(size));
        };
        let progress = of.control.progress.map(|_| &report as _);
        work(&RunControl { progress, ..*of.control })
    }
}

/// What is known of the plants of the grid.
pub(crate) struct Plants {
    models: usize,
    pub(crate) verdict: Vec<Verdict>,
    /// Plants whose Upsilon is the frequency integral's.
    pub(crate) by_frequency: Vec<bool>,
    /// Plants by models.
    upsilon: Vec<f64>,
    error: Vec<f64>,
}

impl Plants {
    /// Upsilon of every model at plant `k`.
    pub(crate) fn row(&self, k: usize) -> &[f64] {
        &self.upsilon[k * self.models..(k + 1) * self.models]
    }
}

/// A plant with Upsilon of every model, as far as it could be computed.
#[derive(Clone)]
struct Checked {
    row: Vec<f64>,
    error: Vec<f64>,
    /// Largest relative difference of the routes: of all pairs (infinite where
    /// the Lyapunov route has no number), and of those that kept its value.
    found: f64,
    kept: f64,
    compared: usize,
    replaced: usize,
}

impl Checked {
    /// A plant that only the Lyapunov route has seen.
    fn unchecked(row: Vec<f64>) -> Self {
        let error = vec![f64::NAN; row.len()];
        Self { row, error, found: 0.0, kept: 0.0, compared: 0, replaced: 0 }
    }

    /// Takes the second route, and its value where the first has lost its
    /// digits or leaves the winner in doubt.
    fn check(&mut self, engine: &Engine<'_>, theta: &[f64], same: &[Option<usize>]) -> Result<()> {
        let (second, quadrature) = engine.frequency_row(theta, &engine.designed)?;
        let mut differences = vec![0.0_f64; self.row.len()];
        for &i in &engine.designed {
            let difference = (self.row[i] - second[i]).abs();
            if self.row[i].is_nan() {
                differences[i] = f64::INFINITY;
            } else if !difference.is_nan() {
                differences[i] = difference / self.row[i].abs().max(f64::MIN_POSITIVE);
                self.compared += 1;
            }
            self.error[i] = difference + quadrature[i];
            self.found = self.found.max(differences[i]);
        }
        let decided = sets::decide(&self.row, &self.error, &engine.designed, same);
        // a decision within the errors is left to the route that knows more
        let mut doubtful = self.found > DIFFER || decided.is_err();
        for i in sets::contenders(&self.row, &self.error, &engine.designed, same) {
            doubtful |= self.error[i] > 2.0 * quadrature[i];
        }
        for &i in &engine.designed {
            let sound = quadrature[i] <= TRUST * second[i].abs();
            if doubtful && (sound || self.row[i].is_nan()) && !second[i].is_nan() {
                self.row[i] = second[i];
                self.error[i] = quadrature[i];
                self.replaced += 1;
            } else if !self.row[i].is_nan() {
                self.kept = self.kept.max(differences[i]);
            }
        }
        Ok(())
    }
}

type Judged = std::result::Result<Checked, Flaw>;

fn run_case(
    setup: &Setup,
    engine: &Engine<'_>,
    delay: f64,
    progress: &CaseProgress<'_>,
) -> Result<(Case, Line)> {
    let grid = &setup.study.grid;
    let same: Vec<Option<usize>> = setup.models.iter().map(|m| m.duplicate_of).collect();
    let mut every = every(setup.study.verify, grid.len());
    let pass = |control: &RunControl<'_>, every| first_pass(setup, engine, &same, every, control);
    let mut judged = progress.grid(|control| pass(control, every))?;
    let silent = RunControl { progress: None, ..*progress.of.control };
    if every.is_none() && judged.iter().flatten().any(|plant| plant.found > 0.0) {
        // where some numbers are lost others are wrong: look after all
        every = self::every(Verify::Auto, grid.len());
        judged = pass(&silent, every)?;
    }
    if let Some(every) = every {
        second_pass(setup, engine, &same, every, &silent, &mut judged)?;
    }
    let (mut case, plants) = collect(setup, engine, delay, &same, judged);
    let mut line = Line::new();
    if let [(_, axis)] = grid.axes() {
        let values = axis.values();
        let breaks = progress.search(|control| {
            let (values, plants, duplicate_of) = (&values[..], &plants, &same[..]);
            Refiner { setup, engine, control, values, plants, duplicate_of }.breaks()
        })?;
        line = sets::stretches(&values, plants.verdict[0], &breaks);
        case.sets = sets::sets(&line, setup.models.len());
        case.unstable_intervals = sets::intervals(&line, Verdict::Unstable);
        case.failed_intervals = sets::intervals(&line, Verdict::Failed);
        case.undecided_intervals = sets::intervals(&line, Verdict::Undecided);
        case.boundaries = sets::boundaries(&breaks);
    }
    (case.upsilon, case.error) = (plants.upsilon, plants.error);
    Ok((case, line))
}

/// Every `n`-th plant is computed by both routes, from the first on.
fn every(verify: Verify, plants: usize) -> Option<usize> {
    match verify {
        Verify::All => Some(1),
        Verify::None => None,
        Verify::Auto => Some(plants.div_ceil(SAMPLE)),
    }
}

/// All plants, some of them by both routes, and those by the second one where
/// a model has no number.
fn first_pass(
    setup: &Setup,
    engine: &Engine<'_>,
    same: &[Option<usize>],
    every: Option<usize>,
    control: &RunControl<'_>,
) -> Result<Vec<Judged>> {
    let grid = &setup.study.grid;
    let chunks = try_map_chunks(control, grid.len(), CHUNK, |range| {
        let thetas: Vec<Vec<f64>> = range.clone().map(|k| setup.theta_at(&grid.point(k))).collect();
        let mut judged: Vec<Judged> = Vec::with_capacity(thetas.len());
        for ((plant, theta), outcome) in range.zip(&thetas).zip(engine.rows(&thetas)?) {
            let mut checked = outcome.map(Checked::unchecked);
            if let Ok(c) = &mut checked {
                let lost = engine.designed.iter().any(|&i| c.row[i].is_nan());
                if lost || every.is_some_and(|every| plant % every == 0) {
                    c.check(engine, theta, same)?;
                }
            }
            judged.push(checked);
        }
        Ok(judged)
    })?;
    Ok(chunks.into_iter().flatten().collect())
}

/// The plants between checked ones where the routes differ: they take the
/// difference found there as their error, and the second route if that leaves
/// the winner in doubt.
fn second_pass(
    setup: &Setup,
    engine: &Engine<'_>,
    same: &[Option<usize>],
    every: usize,
    control: &RunControl<'_>,
    judged: &mut [Judged],
) -> Result<()> {
    let grid = &setup.study.grid;
    let mut doubtful = Vec::new();
    for k in 0..judged.len() {
        let base = k - k % every;
        let near = [base, base + every].into_iter().filter_map(|k| judged.get(k)?.as_ref().ok());
        let difference = near.map(|c| c.found).fold(0.0, f64::max);
        let Ok(plant) = &mut judged[k] else { continue };
        if k == base || plant.compared > 0 || difference == 0.0 {
            continue;
        }
        let error: Vec<f64> = plant.row.iter().map(|u| CAUTION * difference * u.abs()).collect();
        if !sets::contenders(&plant.row, &error, &engine.designed, same).is_empty() {
            doubtful.push(k);
        } else if difference > DIFFER {
            (plant.error, plant.kept) = (error, difference);
        }
    }
    let again = try_map_chunks(control, doubtful.len(), 4, |range| {
        let mut again = Vec::with_capacity(range.len());
        for &k in &doubtful[range] {
            if let Ok(plant) = &judged[k] {
                let mut plant = Checked::unchecked(plant.row.clone());
                plant.check(engine, &setup.theta_at(&grid.point(k)), same)?;
                again.push((k, plant));
            }
        }
        Ok(again)
    })?;
    for (k, plant) in again.into_iter().flatten() {
        judged[k] = Ok(plant);
    }
    Ok(())
}

/// Verdicts, and what a result says of each plant.
fn collect(
    setup: &Setup,
    engine: &Engine<'_>,
    delay: f64,
    same: &[Option<usize>],
    judged: Vec<Judged>,
) -> (Case, Plants) {
    let (grid, models) = (&setup.study.grid, setup.models.len());
    let mut case = Case::empty(delay, judged.len(), models);
    let mut plants = Plants {
        models,
        verdict: Vec::with_capacity(judged.len()),
        by_frequency: Vec::with_capacity(judged.len()),
        upsilon: Vec::with_capacity(judged.len() * models),
        error: Vec::with_capacity(judged.len() * models),
    };
    for (plant, judged) in judged.into_iter().enumerate() {
        let values = || grid.point(plant);
        let checked = judged.unwrap_or_else(|flaw| {
            plants.verdict.push(match flaw {
                Flaw::Unstable(mode) => {
                    let states = mode.states(Some(&engine.states));
                    let mode = mode.eigenvalue;
                    case.unstable.push(Unstable { plant, values: values(), mode, states });
                    Verdict::Unstable
                }
                Flaw::Unbuilt(error) => {
                    case.failed.push(Failed { plant, values: values(), error });
                    Verdict::Failed
                }
                Flaw::Unknown => {
                    let doubt = Doubt::NoNumber { models: engine.designed.clone() };
                    case.undecided.push(Undecided { plant, values: values(), doubt });
                    Verdict::Undecided
                }
            });
            Checked::unchecked(vec![f64::NAN; models])
        });
        if plants.verdict.len() == plant {
            let decided = sets::decide(&checked.row, &checked.error, &engine.designed, same);
            plants.verdict.push(decided.map_or_else(
                |doubt| {
                    case.undecided.push(Undecided { plant, values: values(), doubt });
                    Verdict::Undecided
                },
                Verdict::Winner,
            ));
        }
        let winner = plants.verdict[plant].winner();
        case.margin.push(winner.map_or(f64::NAN, |w| sets::margin(&checked.row, w, same)));
        case.winner.push(winner);
        case.route_difference = case.route_difference.max(checked.kept);
        case.checked_pairs += checked.compared;
        case.replaced += checked.replaced;
        plants.by_frequency.push(checked.replaced > 0);
        plants.upsilon.extend(checked.row);
        plants.error.extend(checked.error);
    }
    (case, plants)
}

/// Upsilon of model `i` (column) with the plant at the nominal value of model
/// `j` (row), for the first delay; NaN rows for models that failed. By both
/// routes where a number is missing or the Lyapunov route is in `doubt`.
fn matched(
    setup: &Setup,
    engine: &Engine<'_>,
    doubt: bool,
    control: &RunControl<'_>,
) -> Result<Vec<f64>> {
    let models = setup.models.len();
    let same: Vec<Option<usize>> = setup.models.iter().map(|m| m.duplicate_of).collect();
    let control = RunControl { progress: None, ..*control };
    let rows = try_map_chunks(&control, models, CHUNK, |range| {
        let thetas: Vec<Vec<f64>> = range.clone().filter_map(|j| setup.model_theta(j)).collect();
        let mut outcomes = engine.rows(&thetas)?.into_iter().zip(&thetas);
        let mut out = Vec::with_capacity(range.len() * models);
        for j in range {
            let row = setup.pairs[j].as_ref().and_then(|_| outcomes.next());
            out.extend(match row {
                Some((Ok(row), theta)) => {
                    let lost = engine.designed.iter().any(|&i| row[i].is_nan());
                    let mut checked = Checked::unchecked(row);
                    if lost || doubt {
                        checked.check(engine, theta, &same)?;
                    }
                    checked.row
                }
                _ => vec![f64::NAN; models],
            });
        }
        Ok(out)
    })?;
    Ok(rows.concat())
}
