//! A run: the cases one after the other, each over the grid in chunks.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::eip::collect::collect;
use crate::eip::judge::{CHUNK, Facts, Judge};
use crate::eip::refine::Refiner;
use crate::eip::sets::{self, Verdict};
use crate::eip::setup::Setup;
use crate::eip::{Case, EipSets, Interval, identify, robust, sweep};
use crate::error::Result;
use crate::par::{RunControl, try_map_chunks};

/// Runs a prepared study.
pub(crate) fn run(setup: &Setup, control: &RunControl<'_>) -> Result<EipSets> {
    let study = &setup.study;
    let delays = if study.delays.is_empty() { vec![0.0] } else { study.delays.clone() };
    if let Some(bound) = &study.unmodelled {
        robust::check(setup, bound)?;
    }
    if let Some(interval) = study.delay_interval {
        sweep::check(setup, interval)?;
    }
    if let Some(law) = study.law {
        identify::check(setup, law)?;
    }
    let (mut cases, mut lines) = (Vec::new(), Vec::new());
    let mut first_judge = None;
    let progress = Progress::new(setup, control, delays.len());
    for (k, &delay) in delays.iter().enumerate() {
        let mut judge = Judge::new(setup, delay)?;
        let of_case = CaseProgress { of: &progress, case: k as u64 };
        let (case, line) = run_case(setup, &mut judge, &of_case)?;
        progress.report((k as u64 + 1) * (progress.plants + progress.search));
        cases.push(case);
        lines.push(line);
        first_judge.get_or_insert(judge);
    }
    let undecidable = if study.grid.axes().len() == 1 && delays.len() > 1 {
        sets::undecidable(&lines)
    } else {
        Vec::new()
    };
    let silent = RunControl { progress: None, ..*control };
    let (mut robust, mut delay_sweep) = (None, None);
    if let (Some(bound), Some(judge)) = (&study.unmodelled, &first_judge) {
        robust = Some(robust::analyse(setup, &judge.engine, &cases[0], bound, &silent)?);
    }
    if let Some(interval) = study.delay_interval {
        delay_sweep = Some(sweep::run(setup, interval, delays[0], &silent)?);
    }
    let identification = match study.law {
        Some(law) => Some(identify::analyse(setup, &cases[0], law, &silent)?),
        None => None,
    };
    let (mut at_nominals, mut method) = (Vec::new(), crate::eip::Method::Doubling);
    if let Some(judge) = &first_judge {
        let doubt = cases[0].replaced > 0 || !cases[0].undecided.is_empty();
        at_nominals = matched(setup, judge, doubt, control)?;
        method = judge.engine.method;
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
        robust,
        delay_sweep,
        identification,
    })
}

/// Stretches of one parameter with their verdict.
pub(crate) type Line = Vec<(Interval, Verdict)>;

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

/// The stretches of one delay alone.
pub(crate) fn line(setup: &Setup, delay: f64, control: &RunControl<'_>) -> Result<Line> {
    let progress = Progress::new(setup, control, 1);
    let of_case = CaseProgress { of: &progress, case: 0 };
    Ok(run_case(setup, &mut Judge::new(setup, delay)?, &of_case)?.1)
}

fn run_case(
    setup: &Setup,
    judge: &mut Judge<'_>,
    progress: &CaseProgress<'_>,
) -> Result<(Case, Line)> {
    let grid = &setup.study.grid;
    let all: Vec<usize> = (0..grid.len()).collect();
    let judged = progress.grid(|control| judge.judge(&all, control))?;
    let silent = RunControl { progress: None, ..*progress.of.control };
    let (mut case, plants) = collect(judge, 0, judged.into(), &silent)?;
    let mut line = Line::new();
    if let [(_, axis)] = grid.axes() {
        let values = axis.values();
        let breaks = progress.search(|control| {
            let (values, plants) = (&values[..], &plants);
            let (engine, duplicate_of) = (&judge.engine, &judge.same[..]);
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

/// Upsilon of model `i` (column) with the plant at the nominal value of model
/// `j` (row), for the first delay; NaN rows for models that failed. By both
/// routes where a number is missing or the Lyapunov route is in `doubt`.
fn matched(
    setup: &Setup,
    judge: &Judge<'_>,
    doubt: bool,
    control: &RunControl<'_>,
) -> Result<Vec<f64>> {
    let models = setup.models.len();
    let engine = &judge.engine;
    let control = RunControl { progress: None, ..*control };
    let rows = try_map_chunks(&control, models, CHUNK, |range| {
        let thetas: Vec<Vec<f64>> = range.clone().filter_map(|j| setup.model_theta(j)).collect();
        let mut outcomes = engine.rows(&thetas)?.into_iter().zip(&thetas);
        let mut out = Vec::with_capacity(range.len() * models);
        for j in range {
            let row = setup.pairs[j].as_ref().and_then(|_| outcomes.next());
            out.extend(match row {
                Some((Ok(mut row), theta)) => {
                    if engine.lost(&row) || doubt {
                        Facts::default().check(&mut row, engine, theta, &judge.same)?;
                    }
                    row
                }
                _ => vec![f64::NAN; models],
            });
        }
        Ok(out)
    })?;
    Ok(rows.concat())
}
