//! A run: the cases one after the other, each over the grid in chunks.

use crate::eip::engine::{Engine, Flaw, Outcome};
use crate::eip::setup::Setup;
use crate::eip::study::Verify;
use crate::eip::{Case, EipSets, Interval, Unstable, sets};
use crate::error::Result;
use crate::model::Grid;
use crate::par::{RunControl, try_map_chunks};

/// Plants of one chunk: about a millisecond of work.
const CHUNK: usize = 128;
/// Plants whose pairs are computed by both routes where not all are.
pub(crate) const SAMPLE: usize = 512;
/// Boundaries are bracketed to this share of the grid's span.
const BRACKET: f64 = 1e-13;

/// Runs a prepared study.
pub(crate) fn run(setup: &Setup, control: &RunControl<'_>) -> Result<EipSets> {
    let study = &setup.study;
    let delays = if study.delays.is_empty() { vec![0.0] } else { study.delays.clone() };
    let total = study.grid.len() as u64 * delays.len() as u64;
    let (mut cases, mut lines) = (Vec::new(), Vec::new());
    let mut first_engine = None;
    for (k, &delay) in delays.iter().enumerate() {
        let engine = Engine::new(setup, delay)?;
        let before = k as u64 * study.grid.len() as u64;
        let report = |done: u64, _: u64| {
            if let Some(progress) = control.progress {
                progress(before + done, total);
            }
        };
        let control = RunControl { progress: control.progress.map(|_| &report as _), ..*control };
        let (case, line) = run_case(setup, &engine, delay, &control)?;
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
        at_nominals = matched(setup, engine, control)?;
        method = engine.method;
    }
    Ok(EipSets {
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

type Line = Vec<(Interval, Option<usize>)>;

/// What a chunk of plants returns.
struct Chunk {
    outcomes: Vec<Outcome>,
    /// Differences of the routes, NaN where only one was taken.
    error: Vec<f64>,
    /// Largest relative difference and number of pairs compared.
    worst: f64,
    compared: usize,
}

fn run_case(
    setup: &Setup,
    engine: &Engine<'_>,
    delay: f64,
    control: &RunControl<'_>,
) -> Result<(Case, Line)> {
    let grid = &setup.study.grid;
    let (plants, models) = (grid.len(), setup.models.len());
    let every = match setup.study.verify {
        Verify::All => 1,
        Verify::None => usize::MAX,
        Verify::Auto => plants.div_ceil(SAMPLE),
    };
    let chunks = try_map_chunks(control, plants, CHUNK, |range| {
        let thetas: Vec<Vec<f64>> = range.clone().map(|k| setup.theta_at(&grid.point(k))).collect();
        let outcomes = engine.rows(&thetas)?;
        let mut chunk = Chunk {
            error: vec![f64::NAN; outcomes.len() * models],
            outcomes,
            worst: 0.0,
            compared: 0,
        };
        for (k, plant) in range.enumerate() {
            let Ok(row) = &chunk.outcomes[k] else { continue };
            if plant % every != 0 {
                continue;
            }
            let (second, quadrature) = engine.frequency_row(&thetas[k], &engine.designed)?;
            for i in (0..models).filter(|&i| !row[i].is_nan()) {
                let difference = (row[i] - second[i]).abs();
                chunk.error[k * models + i] = difference + quadrature[i];
                chunk.worst = chunk.worst.max(difference / row[i].abs().max(f64::MIN_POSITIVE));
                chunk.compared += 1;
            }
        }
        Ok(chunk)
    })?;

    let mut case = Case {
        delay,
        upsilon: Vec::with_capacity(plants * models),
        error: Vec::with_capacity(plants * models),
        winner: Vec::with_capacity(plants),
        margin: Vec::with_capacity(plants),
        boundaries: Vec::new(),
        sets: vec![Vec::new(); models],
        unstable_intervals: Vec::new(),
        unstable: Vec::new(),
        route_difference: 0.0,
        checked_pairs: 0,
    };
    let duplicate_of: Vec<Option<usize>> = setup.models.iter().map(|m| m.duplicate_of).collect();
    for chunk in chunks {
        case.error.extend(chunk.error);
        case.route_difference = case.route_difference.max(chunk.worst);
        case.checked_pairs += chunk.compared;
        for outcome in chunk.outcomes {
            let plant = case.winner.len();
            let row = match outcome {
                Ok(row) => row,
                Err(Flaw::Unbuilt(e)) => return Err(e),
                Err(Flaw::Unstable(mode)) => {
                    case.unstable.push(Unstable {
                        plant,
                        values: grid.point(plant),
                        mode: mode.eigenvalue,
                        states: mode.states(Some(&engine.states)),
                    });
                    vec![f64::NAN; models]
                }
            };
            let winner = sets::winner(&row);
            case.margin.push(winner.map_or(f64::NAN, |w| sets::margin(&row, w, &duplicate_of)));
            case.winner.push(winner);
            case.upsilon.extend(row);
        }
    }
    let line = if grid.axes().len() == 1 {
        refine(setup, engine, grid, &mut case, control)?
    } else {
        Line::new()
    };
    Ok((case, line))
}

/// Boundaries and sets of one parameter.
fn refine(
    setup: &Setup,
    engine: &Engine<'_>,
    grid: &Grid,
    case: &mut Case,
    control: &RunControl<'_>,
) -> Result<Line> {
    let models = setup.models.len();
    let values: Vec<f64> = grid.axes()[0].1.values();
    let unstable: Vec<usize> = case.unstable.iter().map(|u| u.plant).collect();
    let rows: Vec<sets::Row> = (0..values.len())
        .map(|k| {
            let stable = unstable.binary_search(&k).is_err();
            stable.then(|| case.upsilon[k * models..(k + 1) * models].to_vec())
        })
        .collect();
    let evaluate = |x: f64| -> Result<sets::Row> {
        if control.is_cancelled() {
            return Err(crate::Error::Cancelled);
        }
        let row = engine.accurate_rows(&[setup.theta_at(&[x])], &engine.designed)?;
        Ok(row.into_iter().next().and_then(|row| row.ok()))
    };
    let span = values[values.len() - 1] - values[0];
    let breaks = sets::breaks(&values, &rows, span * BRACKET, evaluate)?;
    let line = sets::stretches(&values, case.winner[0], &breaks);
    (case.sets, case.unstable_intervals) = sets::sets(&line, models);
    case.boundaries = sets::boundaries(&breaks);
    if setup.study.verify != Verify::None {
        let between = breaks.iter().filter(|b| b.left.is_some() && b.right.is_some());
        for (boundary, b) in case.boundaries.iter_mut().zip(between) {
            let (i, j) = (boundary.left, boundary.right);
            let theta = setup.theta_at(&[boundary.value]);
            let (second, _) = engine.frequency_row(&theta, &[i.min(j), i.max(j)])?;
            if let Ok(row) = &engine.accurate_rows(&[theta], &[i.min(j), i.max(j)])?[0] {
                let difference = (row[i] - row[j]) - (second[i] - second[j]);
                boundary.uncertainty += (difference / b.slope).abs();
            }
        }
    }
    Ok(line)
}

/// Upsilon of model `i` (column) with the plant at the nominal value of model
/// `j` (row), for the first delay; NaN rows for models that failed.
fn matched(setup: &Setup, engine: &Engine<'_>, control: &RunControl<'_>) -> Result<Vec<f64>> {
    let models = setup.models.len();
    let control = RunControl { progress: None, ..*control };
    let rows = try_map_chunks(&control, models, CHUNK, |range| {
        let thetas: Vec<Vec<f64>> = range.clone().filter_map(|j| setup.model_theta(j)).collect();
        let mut outcomes = engine.rows(&thetas)?.into_iter();
        let mut out = Vec::with_capacity(range.len() * models);
        for j in range {
            let row = setup.pairs[j].as_ref().and_then(|_| outcomes.next());
            out.extend(match row {
                Some(Ok(row)) => row,
                _ => vec![f64::NAN; models],
            });
        }
        Ok(out)
    })?;
    Ok(rows.concat())
}
