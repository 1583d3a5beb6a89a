//! Nominal values whose EIP sets are the ones wanted, one parameter.

use crate::eip::Study;
use crate::eip::penalty::state_penalty;
use crate::eip::root::{self, Bracket};
use crate::error::{Error, Result};
use crate::model::{Axis, Grid};
use crate::par::RunControl;

/// Most models that a bound on the excess may ask for.
const MOST: usize = 64;
/// A nominal value is looked for so many cells beyond the edge, at most.
const REACH: f64 = 3.0;
/// Bisections of the range of anchors.
const HALVINGS: usize = 40;

/// The cells that are wanted: from the first to the last value of the grid.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// So many of equal width.
    Count(usize),
    /// Between these inner edges, rising.
    Edges(Vec<f64>),
    /// As few of equal width as keep the largest excess within a bound.
    Within(f64),
    /// As few of equal width as keep the largest state-error penalty within a bound.
    Penalty(f64),
}

/// Nominal values and what they are worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// Name of the parameter.
    pub parameter: String,
    /// First and last value of the parameter.
    pub domain: [f64; 2],
    /// The nominal values.
    pub nominals: Vec<f64>,
    /// The edges that were asked for.
    pub wanted: Vec<f64>,
    /// The boundaries that a study with these nominal values has.
    pub edges: Vec<f64>,
    /// Excess at the start, the edges and the end of the domain: by how much the
    /// best of these models is worse there than a model of the very plant.
    ///
    /// ```text
    /// min_i Upsilon_i(kappa) - Upsilon_kappa(kappa)
    /// ```
    pub excess: Vec<f64>,
    /// State-error penalty at the same points: how much larger the state error of
    /// the winner is than that of a model of the very plant, in the metric of the
    /// latter.
    ///
    /// ```text
    /// tr(P_kappa^-1 E[e_i e_i'])/n - 1,   e_i = x - x_hat_i
    /// ```
    pub penalty: Vec<f64>,
    /// `d kappa_i / d kappa_1` as the edges stay.
    pub sensitivity: Vec<f64>,
    /// The first nominal values for which each nominal value lies in its own cell.
    pub feasible: [f64; 2],
}

/// Upsilon of models at any parameter value with plants at any other.
struct Placer<'a> {
    study: Study,
    name: String,
    control: RunControl<'a>,
    domain: [f64; 2],
}

impl Study {
    /// Nominal values whose sets are the cells wanted, in place of those of the
    /// bank.
    ///
    /// Each edge `e` between models `i` and `i+1` asks for `Upsilon_i(e) =
    /// Upsilon_{i+1}(e)`: a chain from the first nominal value, which is the one
    /// degree of freedom. Either it is given (`anchor`), or it is the one with the
    /// smallest worst excess (the canonical, minimax choice).
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mmae::eip::{Bank, Cells, Study};
    /// use mmae::model::{Grid, systems};
    /// use mmae::observer::ObserverKind;
    /// use mmae::par::RunControl;
    /// let bank = Bank::along(ObserverKind::KalmanBucy, "L", &[1.4]);
    /// let grid = Grid::linear("L", 0.9, 1.9, 41)?;
    /// let mut study = Study::new(Arc::new(systems::pendulum()), bank, grid);
    /// study.surroundings = systems::pendulum_surroundings();
    /// let placed = study.place(&Cells::Count(4), None, &RunControl::default())?;
    /// // the boundaries are the quarters of the grid
    /// for (edge, want) in placed.edges.iter().zip([1.15, 1.4, 1.65]) {
    ///     assert!((edge - want).abs() < 1e-9);
    /// }
    /// assert!((placed.excess[0] - placed.excess[1]).abs() < 1e-6); // and the first cell is even
    /// # Ok::<(), mmae::Error>(())
    /// ```
    ///
    /// # Source
    /// Hassani et al. (2009), section III; the anchor's freedom and the minimax
    /// choice are not there.
    ///
    /// # Errors
    /// `Conflict` for several parameters or delays; `Range` for edges that do not
    /// rise inside the grid, an anchor outside its cell, cells that no nominal
    /// values have, a bound that 64 models do not meet; those of a study.
    pub fn place(
        &self,
        cells: &Cells,
        anchor: Option<f64>,
        control: &RunControl<'_>,
    ) -> Result<Placement> {
        let placer = Placer::new(self, control)?;
        let [from, to] = placer.domain;
        let equal = |count: usize| -> Vec<f64> {
            let at = |k: usize| from + (to - from) * (k as f64 / count as f64);
            (1..count).map(at).collect()
        };
        let (edges, first) = match cells {
            Cells::Count(0) => return Err(range("number of cells", 0.0, "give at least one")),
            Cells::Count(count) => (equal(*count), None),
            Cells::Edges(edges) => (edges.clone(), None),
            Cells::Within(bound) | Cells::Penalty(bound) => {
                let of_state = matches!(cells, Cells::Penalty(_));
                if !(*bound > 0.0 && bound.is_finite()) {
                    let remedy = "give a number above zero";
                    return Err(range("bound on the excess", *bound, remedy));
                }
                // more cells leave less: double, then halve the gap
                let attempt = |count: usize| placer.within(&equal(count), *bound, of_state);
                let (mut few, mut enough) = (0, 1);
                let mut found = attempt(enough)?;
                while found.is_none() && enough < MOST {
                    (few, enough) = (enough, 2 * enough);
                    found = attempt(enough)?;
                }
                let remedy = "give a larger bound, or the number of cells";
                let mut found =
                    found.ok_or_else(|| range("bound on the excess", *bound, remedy))?;
                while enough - few > 1 {
                    let middle = few + (enough - few) / 2;
                    match attempt(middle)? {
                        Some(better) => (enough, found) = (middle, better),
                        None => few = middle,
                    }
                }
                (equal(enough), Some(found))
            }
        };
        placer.check(&edges)?;
        let feasible = placer.feasible(&edges, anchor)?;
        let first = match (anchor, first) {
            (Some(anchor), _) => anchor,
            (None, Some(first)) => first,
            (None, None) => placer.canonical(&edges, feasible)?,
        };
        let outside = || range("anchor", first, "give a value for which every cell has its own");
        let nominals = placer.chain(&edges, first)?.ok_or_else(outside)?;
        let sensitivity = placer.sensitivity(&edges, first, feasible)?;
        Ok(Placement {
            excess: placer.excess(&edges, &nominals)?,
            penalty: placer.penalty(&edges, &nominals)?,
            edges: placer.boundaries(self, &nominals)?,
            parameter: placer.name.clone(),
            domain: placer.domain,
            wanted: edges,
            nominals,
            sensitivity,
            feasible,
        })
    }
}

fn range(what: &str, value: f64, remedy: &str) -> Error {
    Error::Range { what: what.into(), value, remedy: remedy.into() }
}

impl<'a> Placer<'a> {
    fn new(study: &Study, control: &RunControl<'a>) -> Result<Self> {
        let conflict = |problem: &str, remedy: &str| {
            Err(Error::Conflict { problem: problem.into(), remedy: remedy.into() })
        };
        let (axes, delays) = (study.grid.axes(), study.delays.len());
        let (1, [name]) = (axes.len(), &study.bank.parameters[..]) else {
            return conflict("placement in several parameters", "vary one in grid and models");
        };
        if *name != axes[0].0 {
            return conflict(
                "models and grid of different parameters",
                "vary the same one in both",
            );
        }
        if delays > 1 {
            return conflict("placement for several delays", "give one delay");
        }
        let axis = &axes[0].1;
        let domain = [axis.value(0), axis.value(axis.len() - 1)];
        if domain[0] >= domain[1] {
            return conflict("a grid of one value", "give the range of the parameter");
        }
        let study = study.bare();
        let control = RunControl { progress: None, ..*control };
        Ok(Self { study, name: name.clone(), control, domain })
    }

    fn check(&self, edges: &[f64]) -> Result<()> {
        let mut last = self.domain[0];
        for &edge in edges {
            if !(edge > last && edge < self.domain[1]) {
                let remedy = "let the edges rise, inside the range of the grid";
                return Err(range("edge", edge, remedy));
            }
            last = edge;
        }
        Ok(())
    }

    /// The study of one plant with models at `nominals`.
    fn with(&self, plant: f64, nominals: &[f64]) -> Study {
        let mut study = self.study.clone();
        study.bank.models = nominals.iter().map(|&v| vec![v]).collect();
        study.bank.labels = Vec::new();
        if let Ok(grid) = Grid::new(vec![(self.name.clone(), Axis::Explicit(vec![plant]))]) {
            study.grid = grid; // one finite value is a grid
        }
        study
    }

    /// Upsilon of models at `nominals` with the plant at `plant`; nothing where
    /// there is no number.
    fn upsilon(&self, plant: f64, nominals: &[f64]) -> Result<Vec<Option<f64>>> {
        let sets = match self.with(plant, nominals).run(&self.control) {
            Err(Error::AllFailed { .. }) => return Ok(vec![None; nominals.len()]),
            sets => sets?,
        };
        let values = sets.cases.first().map_or(&[][..], |case| &case.upsilon);
        Ok(values.iter().map(|v| v.is_finite().then_some(*v)).collect())
    }

    fn one(&self, plant: f64, nominal: f64) -> Result<Option<f64>> {
        Ok(self.upsilon(plant, &[nominal])?.first().copied().flatten())
    }

    /// Nominal values that follow from the first; nothing where there are none.
    fn chain(&self, edges: &[f64], first: f64) -> Result<Option<Vec<f64>>> {
        let mut nominals = vec![first];
        let mut last = first;
        for &edge in edges {
            let (Some(level), Some(least)) = (self.one(edge, last)?, self.one(edge, edge)?) else {
                return Ok(None);
            };
            let width = edge - last;
            if !(width > 0.0 && least < level) {
                return Ok(None);
            }
            let low = (edge, least - level);
            // Upsilon of the models beyond the edge rises with their distance
            let mut high = None;
            let ahead: Vec<f64> =
                [0.5, 0.8, 1.0, 1.2, 1.5, 2.0, REACH].map(|r| edge + r * width).to_vec();
            for (&at, value) in ahead.iter().zip(self.upsilon(edge, &ahead)?) {
                let Some(value) = value else { break };
                if value > level {
                    high = Some((at, value - level));
                    break;
                }
            }
            let Some(high) = high else { return Ok(None) };
            let f = |points: &[f64]| -> Result<Vec<Option<f64>>> {
                let values = self.upsilon(edge, points)?;
                Ok(values.into_iter().map(|v| v.map(|v| v - level)).collect())
            };
            let Bracket::Root(a, b) = root::bracket(low, high, 0.0, f)? else { return Ok(None) };
            last = 0.5 * (a.0 + b.0);
            nominals.push(last);
        }
        Ok(Some(nominals))
    }

    /// The canonical first nominal value, if it keeps the excess within `bound`.
    fn within(&self, edges: &[f64], bound: f64, of_state: bool) -> Result<Option<f64>> {
        let first = self.canonical(edges, self.feasible(edges, None)?)?;
        let Some(nominals) = self.chain(edges, first)? else { return Ok(None) };
        let cost =
            if of_state { self.penalty(edges, &nominals)? } else { self.excess(edges, &nominals)? };
        Ok(cost.iter().all(|e| *e <= bound).then_some(first))
    }

    /// True if each nominal value lies in its own cell.
    fn fits(&self, edges: &[f64], first: f64) -> Result<bool> {
        let Some(nominals) = self.chain(edges, first)? else { return Ok(false) };
        let ends = |i: usize| {
            let low = if i == 0 { self.domain[0] } else { edges[i - 1] };
            [low, edges.get(i).copied().unwrap_or(self.domain[1])]
        };
        let inside = |(i, v): (usize, &f64)| ends(i)[0] <= *v && *v <= ends(i)[1];
        Ok(nominals.iter().enumerate().all(inside))
    }

    /// The first nominal values for which all fit, around `near` if it is given.
    fn feasible(&self, edges: &[f64], near: Option<f64>) -> Result<[f64; 2]> {
        let cell = [self.domain[0], edges.first().copied().unwrap_or(self.domain[1])];
        let at = |share: f64| cell[0] + share * (cell[1] - cell[0]);
        let tries = near.into_iter().chain(
            [8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15].map(|k| at(f64::from(k) / 16.0)),
        );
        for start in tries {
            if !(cell[0] < start && start < cell[1] && self.fits(edges, start)?) {
                continue;
            }
            let mut found = [0.0; 2];
            for (found, end) in found.iter_mut().zip(cell) {
                let (mut good, mut bad) = (start, end);
                if self.fits(edges, end)? {
                    good = end;
                }
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (good + bad);
                    if middle == good
                        || middle == bad
                        || (bad - good).abs() < 1e-9 * (cell[1] - cell[0])
                    {
                        break;
                    }
                    if self.fits(edges, middle)? { good = middle } else { bad = middle }
                }
                *found = good;
            }
            return Ok(found);
        }
        let remedy = "no nominal values have these cells: choose cells of more equal width";
        Err(range("first edge", cell[1], remedy))
    }

    /// The ends of the cells.
    fn ends(&self, edges: &[f64]) -> Vec<f64> {
        [&self.domain[..1], edges, &self.domain[1..]].concat()
    }

    /// State-error penalty at the ends of the cells: an edge is charged for the
    /// worse of its two models.
    fn penalty(&self, edges: &[f64], nominals: &[f64]) -> Result<Vec<f64>> {
        let delay = self.study.delays.first().copied().unwrap_or(0.0);
        let last = nominals.len() - 1;
        let at = |(k, plant): (usize, f64)| -> Result<f64> {
            let sides = [k.saturating_sub(1).min(last), k.min(last)];
            let setup =
                self.with(plant, &[nominals[sides[0]], nominals[sides[1]], plant]).prepare()?;
            let theta = setup.theta_at(&[plant]);
            let one = |i: usize| state_penalty(&setup, &theta, delay, [i, 2]);
            Ok(one(0)?.max(one(1)?))
        };
        self.ends(edges).into_iter().enumerate().map(at).collect()
    }

    /// Excess at the ends of the cells.
    fn excess(&self, edges: &[f64], nominals: &[f64]) -> Result<Vec<f64>> {
        let points = self.ends(edges);
        let last = nominals.len() - 1;
        let at = |(i, &plant): (usize, &f64)| {
            let values = self.upsilon(plant, &[nominals[i.min(last)], plant])?;
            match values[..] {
                [Some(model), Some(own)] => Ok(model - own),
                _ => Err(range("plant without a number", plant, "narrow the grid")),
            }
        };
        points.iter().enumerate().map(at).collect()
    }

    /// The first nominal value with the smallest worst excess: as it grows, so do
    /// the excesses at every other point from the start on, and the others fall.
    fn canonical(&self, edges: &[f64], [low, high]: [f64; 2]) -> Result<f64> {
        let balance = |first: f64| -> Result<Option<f64>> {
            let Some(nominals) = self.chain(edges, first)? else { return Ok(None) };
            let excess = self.excess(edges, &nominals)?;
            let worst = |odd: usize| {
                excess.iter().skip(odd).step_by(2).fold(f64::NEG_INFINITY, |m, e| m.max(*e))
            };
            Ok(Some(worst(0) - worst(1)))
        };
        let undefined = || range("anchor", low, "narrow the grid");
        let at_low = balance(low)?.ok_or_else(undefined)?;
        let at_high = balance(high)?.ok_or_else(undefined)?;
        if at_low >= 0.0 {
            return Ok(low);
        }
        if at_high <= 0.0 {
            return Ok(high);
        }
        let f = |points: &[f64]| -> Result<Vec<Option<f64>>> {
            points.iter().map(|p| balance(*p)).collect()
        };
        let width = 1e-12 * high.abs().max(low.abs());
        match root::bracket((low, at_low), (high, at_high), width, f)? {
            Bracket::Root(a, b) => Ok(0.5 * (a.0 + b.0)),
            Bracket::Undefined(at) => Err(range("anchor", at, "narrow the grid")),
        }
    }

    /// `d kappa_i / d kappa_1` by a central difference.
    fn sensitivity(&self, edges: &[f64], first: f64, feasible: [f64; 2]) -> Result<Vec<f64>> {
        let step = 1e-4 * (feasible[1] - feasible[0]).max(1e-6 * first.abs());
        let (Some(above), Some(below)) =
            (self.chain(edges, first + step)?, self.chain(edges, first - step)?)
        else {
            return Ok(vec![f64::NAN; edges.len() + 1]);
        };
        Ok(above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * step)).collect())
    }

    /// The boundaries of the whole study with these nominal values.
    fn boundaries(&self, study: &Study, nominals: &[f64]) -> Result<Vec<f64>> {
        let mut study = Study { verify: study.verify, ..study.bare() };
        study.bank.models = nominals.iter().map(|&v| vec![v]).collect();
        study.bank.labels = Vec::new();
        let sets = study.run(&self.control)?;
        let first = sets.cases.first().map_or(&[][..], |case| &case.boundaries);
        Ok(first.iter().map(|b| b.value).collect())
    }
}
