//! Nominal values of several parameters: a Lloyd iteration whose distance is
//! Upsilon.

use crate::eip::Study;
use crate::error::{Error, Result};
use crate::par::RunControl;

/// Plants that may be nominal values at most: every pair is computed.
const CANDIDATES: usize = 2500;
/// Iterations at most; each one lowers a sum of finitely many values.
const ITERATIONS: usize = 500;

/// Nominal values on the grid of several parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Scatter {
    /// Names of the parameters.
    pub parameters: Vec<String>,
    /// One point a model.
    pub nominals: Vec<Vec<f64>>,
    /// The same as indices on the grid.
    pub plants: Vec<usize>,
    /// The model that each plant of the grid is identified as; `None` for a plant
    /// without a number.
    pub cells: Vec<Option<usize>>,
    /// Largest excess in the cell of each model.
    ///
    /// ```text
    /// excess = Upsilon_i(kappa) - Upsilon_kappa(kappa)
    /// ```
    pub excess: Vec<f64>,
    /// Mean excess over the plants before each iteration and at the end: it never
    /// rises.
    pub descent: Vec<f64>,
    /// Whether the last iteration moved no nominal value.
    pub converged: bool,
}

impl Study {
    /// Nominal values of `models` models (of the bank's, where `None`) that lower
    /// the mean excess over the plants of the grid.
    ///
    /// ```text
    /// cells:     model of plant kappa = argmin_i Upsilon_i(kappa)
    /// centroids: nominal value of a cell = argmin over its plants of the cell's mean Upsilon
    /// ```
    ///
    /// repeated until no nominal value moves (Lloyd's iteration, with Upsilon as the
    /// distance and plants of the grid as centroids). Neither step raises the mean
    /// excess and there are finitely many choices, so that it ends; where it ends is
    /// a local minimum, to the step of the grid. It starts at the bank's models,
    /// moved to the plants of the grid that they explain best, or at the best single
    /// plant and, one after the other, the plants with the largest excess.
    ///
    /// ```
    /// use std::sync::Arc;
    /// use mmae::eip::{Bank, Study};
    /// use mmae::model::{Axis, Grid, systems};
    /// use mmae::observer::ObserverKind;
    /// use mmae::par::RunControl;
    /// let bank = Bank::along(ObserverKind::KalmanBucy, "wn", &[1.0]);
    /// let axis = |from, to| Axis::Linear { from, to, points: 6 };
    /// let grid = Grid::new(vec![("wn".into(), axis(0.7, 3.0)), ("zeta".into(), axis(0.1, 0.4))])?;
    /// let study = Study::new(Arc::new(systems::oscillator()), bank, grid);
    /// let placed = study.scatter(Some(4), &RunControl::default())?;
    /// assert!(placed.converged && placed.nominals.len() == 4);
    /// assert!(placed.descent.windows(2).all(|w| w[1] <= w[0]));
    /// # Ok::<(), mmae::Error>(())
    /// ```
    ///
    /// # Errors
    /// `Range` for no models or more than plants; `Limit` for a grid of over 2500
    /// plants; `Conflict` for several delays; those of a study.
    pub fn scatter(&self, models: Option<usize>, control: &RunControl<'_>) -> Result<Scatter> {
        let plants = self.grid.len();
        if plants > CANDIDATES {
            return Err(Error::Limit {
                what: format!("placement among {plants} plants"),
                bytes: (plants as u128).pow(2) * 32,
                limit: (CANDIDATES as u128).pow(2) * 32,
                remedy: "use a coarser grid: nominal values are taken from it",
            });
        }
        if self.delays.len() > 1 {
            return Err(Error::Conflict {
                problem: "placement for several delays".into(),
                remedy: "give one delay".into(),
            });
        }
        if let Some(count) = models.filter(|n| !(1..=plants).contains(n)) {
            return Err(Error::Range {
                what: "number of cells".into(),
                value: count as f64,
                remedy: format!("give 1 to {plants}, the plants of the grid"),
            });
        }
        let names: Vec<String> = self.grid.axes().iter().map(|(n, _)| n.clone()).collect();
        let mut all = self.bare();
        all.bank.parameters = names.clone();
        all.bank.models = (0..plants).map(|k| self.grid.point(k)).collect();
        all.bank.labels = Vec::new();
        let sets = all.run(control)?;
        let table = Table { upsilon: &sets.cases[0].upsilon, n: plants };
        let mut chosen = match models {
            Some(count) => table.spread(count),
            None => self.nearest(&table, control)?,
        };
        let mut descent = vec![table.mean(&chosen)];
        let mut converged = false;
        for _ in 0..ITERATIONS {
            let next = table.centroids(&chosen);
            converged = next == chosen;
            chosen = next;
            if converged {
                break;
            }
            descent.push(table.mean(&chosen));
        }
        chosen.sort_unstable();
        let cells: Vec<Option<usize>> = (0..plants).map(|p| table.cell(p, &chosen)).collect();
        let mut excess = vec![0.0_f64; chosen.len()];
        for (p, cell) in cells.iter().enumerate() {
            if let Some(i) = *cell {
                excess[i] = excess[i].max(table.excess(p, chosen[i]));
            }
        }
        Ok(Scatter {
            parameters: names,
            nominals: chosen.iter().map(|&k| self.grid.point(k)).collect(),
            plants: chosen,
            cells,
            excess,
            descent,
            converged,
        })
    }

    /// The plants of the grid that the bank's models explain best, all different.
    fn nearest(&self, table: &Table<'_>, control: &RunControl<'_>) -> Result<Vec<usize>> {
        let sets = self.bare().run(control)?;
        let models = self.bank.models.len();
        let mut chosen: Vec<usize> = Vec::new();
        for i in 0..models {
            let over = |p: usize| sets.cases[0].upsilon[p * models + i] - table.at(p, p);
            let free = (0..table.n).filter(|p| over(*p).is_finite() && !chosen.contains(p));
            chosen.extend(free.min_by(|&p, &q| over(p).total_cmp(&over(q))));
        }
        Ok(chosen)
    }
}

/// Upsilon of every candidate at every plant.
struct Table<'a> {
    upsilon: &'a [f64],
    n: usize,
}

impl Table<'_> {
    fn at(&self, plant: usize, model: usize) -> f64 {
        self.upsilon[plant * self.n + model]
    }

    fn excess(&self, plant: usize, model: usize) -> f64 {
        self.at(plant, model) - self.at(plant, plant)
    }

    /// Plants that have a model of their own.
    fn sound(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.n).filter(|&p| self.at(p, p).is_finite())
    }

    /// The place among `chosen` of the best model of a plant; the first of equals.
    fn cell(&self, plant: usize, chosen: &[usize]) -> Option<usize> {
        let sound = (0..chosen.len()).filter(|&i| self.excess(plant, chosen[i]).is_finite());
        sound.min_by(|&i, &j| self.at(plant, chosen[i]).total_cmp(&self.at(plant, chosen[j])))
    }

    fn mean(&self, chosen: &[usize]) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for p in self.sound() {
            if let Some(i) = self.cell(p, chosen) {
                sum += self.excess(p, chosen[i]);
                count += 1;
            }
        }
        sum / f64::from(count.max(1))
    }

    /// The plant among `cell` with the smallest sum over it; `now` unless another is
    /// better.
    fn centroid(&self, cell: &[usize], now: Option<usize>) -> Option<usize> {
        let sum = |c: usize| cell.iter().map(|&p| self.excess(p, c)).sum::<f64>();
        let mut best = now.map(|c| (c, sum(c)));
        for &c in cell {
            let value = sum(c);
            if value.is_finite() && best.is_none_or(|(_, b)| b.is_nan() || b > value) {
                best = Some((c, value));
            }
        }
        best.map(|b| b.0)
    }

    fn centroids(&self, chosen: &[usize]) -> Vec<usize> {
        let mut cells = vec![Vec::new(); chosen.len()];
        for p in self.sound() {
            if let Some(i) = self.cell(p, chosen) {
                cells[i].push(p);
            }
        }
        let each = chosen.iter().zip(&cells);
        each.map(|(&c, cell)| self.centroid(cell, Some(c)).unwrap_or(c)).collect()
    }

    /// The best single plant, then those with the largest excess.
    fn spread(&self, count: usize) -> Vec<usize> {
        let all: Vec<usize> = self.sound().collect();
        let mut chosen: Vec<usize> = self.centroid(&all, None).into_iter().collect();
        while chosen.len() < count {
            let over = |p: usize| self.cell(p, &chosen).map_or(0.0, |i| self.excess(p, chosen[i]));
            let free = all.iter().copied().filter(|p| !chosen.contains(p));
            let Some(next) = free.max_by(|&p, &q| over(p).total_cmp(&over(q)).then(q.cmp(&p)))
            else {
                break;
            };
            chosen.push(next);
        }
        chosen
    }
}
