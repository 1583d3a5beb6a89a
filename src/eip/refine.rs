//! Where the verdict changes along one parameter, between the grid points.
//!
//! Every cell of the grid is searched on its own, cells in parallel. Probes go
//! eight at a time, the lanes of one plant group, and between two winners with
//! these two models only; all models are looked at where a boundary is accepted.

use crate::eip::collect::Plants;
use crate::eip::dips::Dips;
use crate::eip::engine::{Engine, Flaw};
use crate::eip::judge::DIFFER;
use crate::eip::root::{self, Bracket};
use crate::eip::sets::{self, Break, TIE, Verdict};
use crate::eip::setup::Setup;
use crate::eip::study::Verify;
use crate::error::{Error, Result};
use crate::par::{RunControl, map_chunks, try_map_chunks};
use crate::simd::LANES;

/// Boundaries are bracketed to this share of the grid's span or of the values
/// there, whichever is smaller.
const BRACKET: f64 = 1e-13;
/// Rounding of a Lyapunov route that is in order, in units of the last place.
const ROUNDING: f64 = 64.0;
/// A relative difference of the routes at a boundary above which the frequency
/// integral knows better; with a delay, where the Pade approximation differs by
/// its nature and the integral is dear, [`DIFFER`].
const WORSE: f64 = 1e-9;
/// Cells looked at in one go for a search.
const CHUNK: usize = 1024;
/// Boundaries that are looked at together, at most: the separable form takes as many plants
/// at once.
const PROBES: usize = 2 * LANES;
/// Parts that the cells make if there are enough: for the threads.
const TASKS: usize = 32;
/// Searches inside each other, at most.
const DEPTH: u32 = 40;

/// What a cell's search needs.
pub(crate) struct Refiner<'a, 'e> {
    pub(crate) setup: &'a Setup,
    pub(crate) engine: &'a Engine<'e>,
    pub(crate) control: &'a RunControl<'a>,
    /// Grid values, and what was found there.
    pub(crate) values: &'a [f64],
    pub(crate) plants: &'a Plants,
    pub(crate) duplicate_of: &'a [Option<usize>],
}

/// A parameter value that was looked at.
#[derive(Clone)]
struct Probe {
    x: f64,
    /// Upsilon of every model, empty where there is none.
    row: Vec<f64>,
    verdict: Verdict,
}

/// A cell that needs a search: the left grid point, and rivals that may dip
/// below the winner of both ends.
struct Cell {
    at: usize,
    rivals: Vec<usize>,
}

impl Refiner<'_, '_> {
    /// Every change of verdict, in increasing order.
    ///
    /// # Errors
    /// A mistake in the study, `Cancelled`.
    pub(crate) fn breaks(&self) -> Result<Vec<Break>> {
        let silent = RunControl { progress: None, ..*self.control };
        let last = self.values.len().saturating_sub(1);
        let cells = map_chunks(&silent, last, CHUNK, |range| -> Vec<Cell> {
            range.filter_map(|at| self.cell(at)).collect()
        })?;
        let cells: Vec<Cell> = cells.into_iter().flatten().collect();
        let together = (cells.len() / TASKS).clamp(1, PROBES);
        let found = try_map_chunks(self.control, cells.len(), together, |range| {
            let cells = &cells[range];
            let mut found = Vec::new();
            for (cell, first) in cells.iter().zip(self.crossings(cells)?) {
                let exact = self.is_exact(cell);
                let mut search = Search { refiner: self, exact, first, found: Vec::new() };
                if search.run(cell)? == Trust::Lost && !exact {
                    search = Search { refiner: self, exact: true, first: None, found: Vec::new() };
                    search.run(cell)?;
                }
                found.append(&mut search.found);
            }
            Ok(found)
        })?;
        Ok(found.concat())
    }

    /// Where the winners of the two ends of each cell meet, and what is known there; `None`
    /// for a cell that has other ends.
    fn crossings(&self, cells: &[Cell]) -> Result<Vec<Option<(Crossing, Probe)>>> {
        let search = Search { refiner: self, exact: false, first: None, found: Vec::new() };
        let (mut places, mut known, mut wanted) = (Vec::new(), Vec::new(), Vec::new());
        for (place, cell) in cells.iter().enumerate() {
            let (a, b) = (self.grid_probe(cell.at), self.grid_probe(cell.at + 1));
            if let (Some(i), Some(j)) = (a.verdict.winner(), b.verdict.winner())
                && i != j
                && !self.is_exact(cell)
            {
                places.push(place);
                known.push(search.meet(&a, &b, [i, j])?);
                wanted.push([i, j]);
            }
        }
        let mut all = vec![None; cells.len()];
        let xs: Vec<f64> = known.iter().map(|c| c.x).collect();
        let wanted: Vec<&[usize]> = wanted.iter().map(|w| &w[..]).collect();
        for ((place, crossing), probe) in
            places.into_iter().zip(known).zip(search.probes(&xs, &wanted)?)
        {
            all[place] = Some((crossing, probe));
        }
        Ok(all)
    }

    /// True if the Lyapunov route has lost its digits at an end of the cell.
    fn is_exact(&self, cell: &Cell) -> bool {
        [cell.at, cell.at + 1].iter().any(|&k| self.plants.by_frequency[k])
    }

    /// The cell to the right of grid point `at`, if there is something to look
    /// for.
    fn cell(&self, at: usize) -> Option<Cell> {
        let (a, b) = (self.plants.verdict[at], self.plants.verdict[at + 1]);
        if a != b {
            return Some(Cell { at, rivals: Vec::new() });
        }
        let w = a.winner()?;
        let row = |k: usize| Some((*self.values.get(k)?, self.plants.row(k)));
        let dips = Dips {
            winner: w,
            before: at.checked_sub(1).and_then(row),
            left: row(at)?,
            right: row(at + 1)?,
            after: row(at + 2),
        };
        if !dips.any() {
            return None;
        }
        let rivals = self.engine.designed.iter().copied();
        let rivals: Vec<usize> =
            rivals.filter(|&j| !sets::is_same(w, j, self.duplicate_of) && dips.of(j)).collect();
        (!rivals.is_empty()).then_some(Cell { at, rivals })
    }

    fn grid_probe(&self, k: usize) -> Probe {
        let (x, verdict) = (self.values[k], self.plants.verdict[k]);
        Probe { x, row: self.plants.row(k).to_vec(), verdict }
    }

    fn width(&self, a: f64, b: f64) -> f64 {
        let span = self.values[self.values.len() - 1] - self.values[0];
        BRACKET * span.min(a.abs().max(b.abs()))
    }
}

/// Where the Upsilon of two models are equal, as far as can be told.
#[derive(Clone, Copy)]
struct Crossing {
    x: f64,
    width: f64,
    /// One of them has no value there.
    undefined: bool,
}

/// Whether the Lyapunov route was good enough for a cell.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Trust {
    Kept,
    Lost,
}

/// The search of one cell.
struct Search<'a, 'e> {
    refiner: &'a Refiner<'a, 'e>,
    /// Upsilon by the frequency integral: the Lyapunov route has lost its
    /// digits here.
    exact: bool,
    /// The crossing of a cell with one winner at either end, and what is known there.
    first: Option<(Crossing, Probe)>,
    found: Vec<Break>,
}

impl Search<'_, '_> {
    fn run(&mut self, cell: &Cell) -> Result<Trust> {
        let mut probes = vec![self.refiner.grid_probe(cell.at)];
        let end = self.refiner.grid_probe(cell.at + 1);
        if let Some(w) = end.verdict.winner() {
            for &j in &cell.rivals {
                let lead = |p: &Probe| (p.x, p.row[j] - p.row[w]);
                let (a, b) = (lead(&probes[0]), lead(&end));
                if let Some(x) = root::negative_point(a, b, |xs| self.differences(xs, j, w))? {
                    probes.push(self.probe(x, &[j, w])?);
                }
            }
        }
        probes.push(end);
        probes.sort_by(|p, q| p.x.total_cmp(&q.x));
        for pair in probes.windows(2) {
            if self.split(&pair[0], &pair[1], 0)? == Trust::Lost {
                return Ok(Trust::Lost);
            }
        }
        Ok(Trust::Kept)
    }

    /// Finds the changes of verdict between two probes, in order.
    fn split(&mut self, a: &Probe, b: &Probe, depth: u32) -> Result<Trust> {
        let (left, right) = (a.verdict, b.verdict);
        match (left, right) {
            _ if left == right => Ok(Trust::Kept),
            // what is withheld stays so up to the next value that is not
            (_, Verdict::Undecided) => {
                self.found.push(Break { value: a.x, uncertainty: b.x - a.x, left, right });
                Ok(Trust::Kept)
            }
            (Verdict::Undecided, _) => {
                self.found.push(Break { value: b.x, uncertainty: b.x - a.x, left, right });
                Ok(Trust::Kept)
            }
            (Verdict::Winner(i), Verdict::Winner(j)) => self.crossing(a, b, [i, j], depth),
            _ => self.edge(a, b, depth),
        }
    }

    /// The boundary between a plant that `i` wins and one that `j` wins.
    fn crossing(&mut self, a: &Probe, b: &Probe, [i, j]: [usize; 2], depth: u32) -> Result<Trust> {
        let (crossing, middle) = match self.first.take() {
            Some(known) => known,
            None => {
                let crossing = self.meet(a, b, [i, j])?;
                (crossing, self.probe(crossing.x, &[i, j])?)
            }
        };
        let Crossing { x, width, undefined } = crossing;
        if undefined {
            return self.both(a, &middle, b, depth);
        }
        let third = middle.verdict.winner().is_some_and(|w| {
            let least = middle.row[i].min(middle.row[j]);
            w != i && w != j && middle.row[w] < least - TIE * least.abs()
        });
        if third && x > a.x && x < b.x && depth < DEPTH {
            // a third model wins where these two meet
            return self.both(a, &middle, b, depth);
        }
        let Some(error) = self.error(&middle, i, j)? else { return Ok(Trust::Lost) };
        let refiner = self.refiner;
        let ends = (refiner.values[0], refiner.values[refiner.values.len() - 1]);
        let reach = root::reach(x, error, b.x - a.x, ends, |xs| self.differences(xs, i, j))?;
        let (left, right) = (a.verdict, b.verdict);
        self.found.push(Break { value: x, uncertainty: width + reach, left, right });
        Ok(Trust::Kept)
    }

    /// Where Upsilon of `i`, which wins at `a`, and of `j`, which wins at `b`, are equal.
    fn meet(&self, a: &Probe, b: &Probe, [i, j]: [usize; 2]) -> Result<Crossing> {
        let (fa, fb) = (a.row[i] - a.row[j], b.row[i] - b.row[j]);
        if !(fa < 0.0 && fb > 0.0) {
            // a winner by a tie may be behind by rounding: the boundary is there
            let x = if fa < 0.0 { b.x } else { a.x };
            return Ok(Crossing { x, width: 0.0, undefined: false });
        }
        let ends = root::bracket((a.x, fa), (b.x, fb), self.refiner.width(a.x, b.x), |xs| {
            self.differences(xs, i, j)
        })?;
        Ok(match ends {
            Bracket::Root(low, high) => {
                // the end with the smaller difference is nearer to the root
                let x = if low.1.abs() <= high.1.abs() { low.0 } else { high.0 };
                Crossing { x, width: high.0 - low.0, undefined: false }
            }
            Bracket::Undefined(x) => Crossing { x, width: 0.0, undefined: true },
        })
    }

    fn both(&mut self, a: &Probe, middle: &Probe, b: &Probe, depth: u32) -> Result<Trust> {
        if depth >= DEPTH || middle.x <= a.x || middle.x >= b.x {
            let (left, right) = (a.verdict, b.verdict);
            self.found.push(Break { value: middle.x, uncertainty: b.x - a.x, left, right });
            return Ok(Trust::Kept);
        }
        if self.split(a, middle, depth + 1)? == Trust::Lost {
            return Ok(Trust::Lost);
        }
        self.split(middle, b, depth + 1)
    }

    /// The end of a stretch that is unstable or cannot be built.
    fn edge(&mut self, a: &Probe, b: &Probe, depth: u32) -> Result<Trust> {
        let start = kind(a.verdict);
        let (mut low, mut high) = (a.x, b.x);
        while high - low
            > self.refiner.width(a.x, b.x).max(4.0 * f64::EPSILON * low.abs().max(high.abs()))
        {
            let points = root::sections(low, high);
            for (&x, found) in points.iter().zip(self.kinds(&points)?) {
                if found != start {
                    high = x;
                    break;
                }
                low = x;
            }
        }
        let known =
            |end: &Probe, x: f64| if end.x == x { Ok(end.clone()) } else { self.probe(x, &[]) };
        let (p, q) = (known(a, low)?, known(b, high)?);
        // the stable side may change winner on its way to the edge
        if self.split(a, &p, depth + 1)? == Trust::Lost {
            return Ok(Trust::Lost);
        }
        let (value, uncertainty) = (0.5 * (low + high), high - low);
        self.found.push(Break { value, uncertainty, left: p.verdict, right: q.verdict });
        if depth >= DEPTH { Ok(Trust::Kept) } else { self.split(&q, b, depth + 1) }
    }

    /// Error of the difference of two models at a boundary; `None` if the
    /// Lyapunov route turns out to have lost its digits there.
    fn error(&self, at: &Probe, i: usize, j: usize) -> Result<Option<f64>> {
        let rounding = ROUNDING * f64::EPSILON * (at.row[i].abs() + at.row[j].abs());
        let rounding = if rounding.is_nan() { 0.0 } else { rounding };
        if !self.exact && self.refiner.setup.study.verify == Verify::None {
            return Ok(Some(rounding));
        }
        let theta = self.refiner.setup.theta_at(&[at.x]);
        let (second, quadrature) =
            self.refiner.engine.frequency_row(&theta, &[i.min(j), i.max(j)])?;
        if at.row.is_empty() {
            return Ok(Some(rounding));
        }
        let both = quadrature[i] + quadrature[j];
        if self.exact {
            return Ok(Some(rounding + both));
        }
        let limit = if self.refiner.engine.delay > 0.0 { DIFFER } else { WORSE };
        for k in [i, j] {
            let relative = (at.row[k] - second[k]).abs() / at.row[k].abs();
            if relative > limit {
                return Ok(None);
            }
        }
        let difference = (at.row[i] - at.row[j]) - (second[i] - second[j]);
        Ok(Some(rounding + both + difference.abs()))
    }

    fn thetas(&self, xs: &[f64]) -> Result<Vec<Vec<f64>>> {
        if self.refiner.control.is_cancelled() {
            return Err(Error::Cancelled);
        }
        Ok(xs.iter().map(|&x| self.refiner.setup.theta_at(&[x])).collect())
    }

    /// Upsilon of `i` less that of `j`, `None` where there is none.
    fn differences(&self, xs: &[f64], i: usize, j: usize) -> Result<Vec<Option<f64>>> {
        let thetas = self.thetas(xs)?;
        let two = [i.min(j), i.max(j)];
        let engine = self.refiner.engine;
        let mut all = Vec::with_capacity(xs.len());
        for (outcome, theta) in engine.accurate_rows(&thetas, &two)?.into_iter().zip(&thetas) {
            let Ok(mut row) = outcome else {
                all.push(None);
                continue;
            };
            if self.exact || (row[i] - row[j]).is_nan() {
                row = engine.frequency_row(theta, &two)?.0;
            }
            let difference = row[i] - row[j];
            all.push((!difference.is_nan()).then_some(difference));
        }
        Ok(all)
    }

    /// Whether the plants are stable, unstable or cannot be built.
    fn kinds(&self, xs: &[f64]) -> Result<Vec<Kind>> {
        let thetas = self.thetas(xs)?;
        let engine = self.refiner.engine;
        let one = &engine.designed[..1.min(engine.designed.len())];
        let rows = engine.accurate_rows(&thetas, one)?;
        Ok(rows
            .into_iter()
            .map(|row| match row {
                Ok(_) => Kind::Stable,
                // on the limit: the unstable stretch ends beside it
                Err(Flaw::Unstable(_) | Flaw::Unknown) => Kind::Unstable,
                Err(Flaw::Unbuilt(_)) => Kind::Failed,
            })
            .collect())
    }

    /// All models at `x`, `wanted` as accurately as can be.
    fn probe(&self, x: f64, wanted: &[usize]) -> Result<Probe> {
        let none = Probe { x, row: Vec::new(), verdict: Verdict::Undecided };
        Ok(self.probes(&[x], &[wanted])?.pop().unwrap_or(none))
    }

    /// All models at each of `xs`, `wanted` of each as accurately as can be.
    fn probes(&self, xs: &[f64], wanted: &[&[usize]]) -> Result<Vec<Probe>> {
        let thetas = self.thetas(xs)?;
        let (engine, same) = (self.refiner.engine, self.refiner.duplicate_of);
        let outcomes = engine.probe(&thetas, wanted)?.into_iter();
        let mut probes = Vec::with_capacity(xs.len());
        for ((&x, theta), outcome) in xs.iter().zip(&thetas).zip(outcomes) {
            let none = |verdict| Probe { x, row: Vec::new(), verdict };
            probes.push(match outcome {
                Err(Flaw::Unstable(_) | Flaw::Unknown) => none(Verdict::Unstable),
                Err(Flaw::Unbuilt(_)) => none(Verdict::Failed),
                Ok(mut row) => {
                    let mut error = Vec::new();
                    if self.exact || engine.lost(&row) {
                        (row, error) = engine.frequency_row(theta, &engine.designed)?;
                    }
                    let decided = sets::decide(&row, &error, &engine.designed, same);
                    let verdict = decided.map_or(Verdict::Undecided, Verdict::Winner);
                    Probe { x, row, verdict }
                }
            });
        }
        Ok(probes)
    }
}

/// A verdict as the stability test sees it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Stable,
    Unstable,
    Failed,
}

fn kind(verdict: Verdict) -> Kind {
    match verdict {
        Verdict::Winner(_) | Verdict::Undecided => Kind::Stable,
        Verdict::Unstable => Kind::Unstable,
        Verdict::Failed => Kind::Failed,
    }
}
