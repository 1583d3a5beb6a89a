//! Plants judged: Upsilon of every model by one route or both.
//!
//! What is found of a plant depends on the study alone: not on the other plants
//! asked for in the same call, so that a study in blocks has the bits of the
//! study at once.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::eip::engine::{Engine, Flaw};
use crate::eip::sets::{self, Verdict};
use crate::eip::setup::Setup;
use crate::eip::study::Verify;
use crate::error::Result;
use crate::par::{RunControl, try_map_chunks, try_map_parts};

/// Plants of one chunk: about a millisecond of work.
pub(crate) const CHUNK: usize = 128;
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

/// What is known of the Upsilon of a plant.
#[derive(Clone, Default)]
pub(crate) struct Facts {
    /// Empty where nothing is known of the errors.
    pub(crate) error: Vec<f64>,
    /// Largest relative difference of the routes: of all pairs (infinite where
    /// the Lyapunov route has no number), and of those that kept its value.
    found: f64,
    pub(crate) kept: f64,
    pub(crate) compared: usize,
    pub(crate) replaced: usize,
}

impl Facts {
    /// Takes the second route, and its value where the first has lost its
    /// digits or leaves the winner in doubt.
    pub(crate) fn check(
        &mut self,
        row: &mut [f64],
        engine: &Engine<'_>,
        theta: &[f64],
        same: &[Option<usize>],
    ) -> Result<()> {
        let (second, quadrature) = engine.frequency_row(theta, &engine.designed)?;
        let mut differences = vec![0.0_f64; row.len()];
        self.error.resize(row.len(), f64::NAN);
        for &i in &engine.designed {
            let difference = (row[i] - second[i]).abs();
            if row[i].is_nan() {
                differences[i] = f64::INFINITY;
            } else if !difference.is_nan() {
                differences[i] = difference / row[i].abs().max(f64::MIN_POSITIVE);
                self.compared += 1;
            }
            self.error[i] = difference + quadrature[i];
            self.found = self.found.max(differences[i]);
        }
        let decided = sets::decide(row, &self.error, &engine.designed, same);
        // a decision within the errors is left to the route that knows more
        let mut doubtful = self.found > DIFFER || decided.is_err();
        for i in sets::contenders(row, &self.error, &engine.designed, same) {
            doubtful |= self.error[i] > 2.0 * quadrature[i];
        }
        for &i in &engine.designed {
            let sound = quadrature[i] <= TRUST * second[i].abs();
            if doubtful && (sound || row[i].is_nan()) && !second[i].is_nan() {
                row[i] = second[i];
                self.error[i] = quadrature[i];
                self.replaced += 1;
            } else if !row[i].is_nan() {
                self.kept = self.kept.max(differences[i]);
            }
        }
        Ok(())
    }
}

/// What is known of a plant.
pub(crate) type Judged = std::result::Result<Facts, Flaw>;

/// Upsilon of plants, plants by models (NaN where there is none), and what is known of
/// each plant.
pub(crate) struct Judgement {
    pub(crate) upsilon: Vec<f64>,
    pub(crate) plants: Vec<Judged>,
}

/// Judges the plants of one case.
pub(crate) struct Judge<'a> {
    setup: &'a Setup,
    pub(crate) engine: Engine<'a>,
    pub(crate) same: Vec<Option<usize>>,
    /// Differences found at checked plants, `None` at those without Upsilon.
    found: BTreeMap<usize, Option<f64>>,
}

impl<'a> Judge<'a> {
    pub(crate) fn new(setup: &'a Setup, delay: f64) -> Result<Self> {
        let same = setup.models.iter().map(|m| m.duplicate_of).collect();
        Ok(Self { setup, engine: Engine::new(setup, delay)?, same, found: BTreeMap::new() })
    }

    /// Parameter values of plant `k` of the grid.
    pub(crate) fn point(&self, k: usize) -> Vec<f64> {
        self.setup.study.grid.point(k)
    }

    /// Every so many plants both routes are taken, from the first on.
    fn every(&self) -> Option<usize> {
        match self.setup.study.verify {
            Verify::All => Some(1),
            Verify::None => None,
            Verify::Auto => Some(self.sample()),
        }
    }

    /// Those of `plants` that are computed by both routes.
    pub(crate) fn checked(&self, plants: Range<usize>) -> Vec<usize> {
        let Some(every) = self.every() else { return Vec::new() };
        (plants.start.next_multiple_of(every)..plants.end).step_by(every).collect()
    }

    /// Who wins at a plant with Upsilon in `row`, if anybody does.
    pub(crate) fn verdict(&self, row: &[f64], judged: &Judged) -> Verdict {
        match judged {
            Ok(facts) => sets::decide(row, &facts.error, &self.engine.designed, &self.same)
                .map_or(Verdict::Undecided, Verdict::Winner),
            Err(Flaw::Unstable(_)) => Verdict::Unstable,
            Err(Flaw::Unbuilt(_)) => Verdict::Failed,
            Err(Flaw::Unknown) => Verdict::Undecided,
        }
    }

    fn sample(&self) -> usize {
        self.setup.study.grid.len().div_ceil(SAMPLE)
    }

    /// Judges the grid's `plants`, in increasing order.
    ///
    /// # Errors
    /// A mistake in the study, `Cancelled`.
    pub(crate) fn judge(
        &mut self,
        plants: &[usize],
        control: &RunControl<'_>,
    ) -> Result<Judgement> {
        let mut every = self.every();
        let mut judged = self.first_pass(plants, every, control)?;
        let silent = RunControl { progress: None, ..*control };
        if every.is_none() && judged.plants.iter().flatten().any(|plant| plant.found > 0.0) {
            // where some numbers are lost others are wrong: look after all
            every = Some(self.sample());
            judged = self.first_pass(plants, every, &silent)?;
        }
        if let Some(every) = every.filter(|every| *every > 1) {
            self.look_around(plants, every, &judged.plants, &silent)?;
            self.second_pass(plants, every, &silent, &mut judged)?;
        }
        Ok(judged)
    }

    /// All plants, some of them by both routes, and those by the second one
    /// where a model has no number.
    fn first_pass(
        &self,
        plants: &[usize],
        every: Option<usize>,
        control: &RunControl<'_>,
    ) -> Result<Judgement> {
        let (setup, engine) = (self.setup, &self.engine);
        let (grid, models) = (&setup.study.grid, setup.pairs.len());
        // written where it stays
        let mut upsilon = vec![0.0; plants.len() * models];
        let parts: Vec<_> = plants.chunks(CHUNK).zip(upsilon.chunks_mut(CHUNK * models)).collect();
        let chunks = try_map_parts(
            control,
            parts,
            |(plants, _)| plants.len(),
            |(plants, out)| {
                let thetas: Vec<Vec<f64>> =
                    plants.iter().map(|&k| setup.theta_at(&grid.point(k))).collect();
                let found = engine.fill(&thetas, out)?;
                let mut judged: Vec<Judged> = Vec::with_capacity(thetas.len());
                let rows = out.chunks_mut(models);
                for (((plant, theta), found), row) in
                    plants.iter().zip(&thetas).zip(found).zip(rows)
                {
                    let mut facts = found.map(|()| Facts::default());
                    if let Ok(facts) = &mut facts
                        && (engine.lost(row) || every.is_some_and(|every| plant % every == 0))
                    {
                        facts.check(row, engine, theta, &self.same)?;
                    }
                    judged.push(facts);
                }
                Ok(judged)
            },
        )?;
        Ok(Judgement { upsilon, plants: chunks.into_iter().flatten().collect() })
    }

    /// Differences at the checked plants before and after each of `plants`,
    /// also those that are not among them.
    fn look_around(
        &mut self,
        plants: &[usize],
        every: usize,
        judged: &[Judged],
        control: &RunControl<'_>,
    ) -> Result<()> {
        for (&k, plant) in plants.iter().zip(judged).filter(|(k, _)| *k % every == 0) {
            self.found.insert(k, plant.as_ref().ok().map(|c| c.found));
        }
        let between = plants.iter().filter(|k| *k % every != 0);
        let bases = between.flat_map(|k| checked_around(*k, every));
        let len = self.setup.study.grid.len();
        let mut more: Vec<usize> =
            bases.filter(|k| *k < len && !self.found.contains_key(k)).collect();
        more.sort_unstable();
        more.dedup();
        let outside = self.first_pass(&more, Some(every), control)?;
        let outside = outside.plants.iter();
        self.found.extend(more.into_iter().zip(outside.map(|c| Some(c.as_ref().ok()?.found))));
        Ok(())
    }

    /// The plants between checked ones where the routes differ: they take the
    /// difference found there as their error, and the second route if that
    /// leaves the winner in doubt.
    fn second_pass(
        &self,
        plants: &[usize],
        every: usize,
        control: &RunControl<'_>,
        judged: &mut Judgement,
    ) -> Result<()> {
        let (setup, engine, same) = (self.setup, &self.engine, &self.same);
        let (grid, models) = (&setup.study.grid, setup.pairs.len());
        let Judgement { upsilon, plants: judged } = judged;
        let mut doubtful = Vec::new();
        for (place, &k) in plants.iter().enumerate() {
            let near = checked_around(k, every).into_iter().filter_map(|k| *self.found.get(&k)?);
            let difference = near.fold(0.0, f64::max);
            let Ok(plant) = &mut judged[place] else { continue };
            let row = &upsilon[place * models..][..models];
            if k % every == 0 || plant.compared > 0 || difference == 0.0 {
                continue;
            }
            let error: Vec<f64> = row.iter().map(|u| CAUTION * difference * u.abs()).collect();
            if !sets::contenders(row, &error, &engine.designed, same).is_empty() {
                doubtful.push(place);
            } else if difference > DIFFER {
                (plant.error, plant.kept) = (error, difference);
            }
        }
        let again = try_map_chunks(control, doubtful.len(), 4, |range| {
            let mut again = Vec::with_capacity(range.len());
            for &place in &doubtful[range] {
                let mut row = upsilon[place * models..][..models].to_vec();
                let mut facts = Facts::default();
                let theta = setup.theta_at(&grid.point(plants[place]));
                facts.check(&mut row, engine, &theta, same)?;
                again.push((place, row, facts));
            }
            Ok(again)
        })?;
        for (place, row, facts) in again.into_iter().flatten() {
            upsilon[place * models..][..models].copy_from_slice(&row);
            judged[place] = Ok(facts);
        }
        Ok(())
    }
}

/// The plants that both routes are taken for, before and after plant `k`.
fn checked_around(k: usize, every: usize) -> [usize; 2] {
    let base = k - k % every;
    [base, base + every]
}
