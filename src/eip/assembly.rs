//! Plants in their loops, one after the other, in the same memory.

use faer::Mat;

use crate::eip::Convention;
use crate::eip::setup::{Setup, same_size, varying_noise};
use crate::error::{Error, Result};
use crate::model::{Around, Closing, DelayForm, LoopBlock, Plant, Time, describe, sample};

/// Buffers of [`Setup::assemble`]; what they held before leaves no trace.
pub(crate) struct Assembly {
    /// Parameter vector of `plant`; empty where there is none.
    theta: Vec<f64>,
    plant: Option<Plant>,
    /// The plant with its disturbance filter.
    full: Option<Plant>,
    /// The plant sampled, where the study samples.
    sampled: Option<Plant>,
    closing: Closing,
    block: LoopBlock,
}

impl Assembly {
    pub(crate) fn new() -> Self {
        Self {
            theta: Vec::new(),
            plant: None,
            full: None,
            sampled: None,
            closing: Closing::new(),
            block: LoopBlock::empty(Time::Continuous),
        }
    }
}

impl Setup {
    /// The plant at the parameter vector `theta` in its loop, and its
    /// measurement noise.
    ///
    /// # Errors
    /// `Plant` for what concerns this plant alone, `Conflict` for a mistake in
    /// the study; both name the parameter values.
    pub(crate) fn assemble<'w>(
        &self,
        work: &'w mut Assembly,
        theta: &[f64],
        delay: f64,
        form: DelayForm,
    ) -> Result<(&'w LoopBlock, &'w Mat<f64>)> {
        let parameters = || {
            let names: Vec<String> =
                self.study.grid.axes().iter().map(|(n, _)| n.clone()).collect();
            let values: Vec<f64> = self.places.iter().map(|&p| theta[p]).collect();
            describe(&names, &values)
        };
        let here = |source| Error::Plant { parameters: parameters(), source: Box::new(source) };
        self.build(work, theta).map_err(here)?;
        let Assembly { plant: Some(plant), full, sampled, closing, block, .. } = work else {
            return Err(Error::Empty { what: "the plant".into() }); // it was just built
        };
        self.fits(plant).map_err(|e| match e {
            Error::Conflict { problem, remedy } => {
                Error::Conflict { problem: format!("plant at {}: {problem}", parameters()), remedy }
            }
            e => here(e),
        })?;
        let around = Around { controller: self.controller.as_ref(), input: self.input.as_ref() };
        let plant = match &self.study.surroundings.disturbance {
            None => &*plant,
            Some(filter) => {
                let full = full.get_or_insert_with(|| plant.clone());
                plant.with_disturbance_into(filter, full);
                full
            }
        };
        match self.sampled {
            None => {
                closing.loop_of(plant, around, delay, form, block).map_err(here)?;
                Ok((block, &plant.R))
            }
            Some(dt) => {
                let (plant, line) = sample(plant, dt, delay).map_err(here)?;
                closing.close(&plant, around, Some(&line), block);
                Ok((block, &sampled.insert(plant).R))
            }
        }
    }

    /// The plant at `theta`, into `work`.
    fn build(&self, work: &mut Assembly, theta: &[f64]) -> Result<()> {
        let family = self.study.family.as_ref();
        // taken out, so that a plant that fails half-way is not built upon
        let plant = match work.plant.take() {
            Some(mut plant) => {
                family.update(&mut plant, &work.theta, theta)?;
                plant
            }
            None => family.plant(theta)?,
        };
        work.plant = Some(plant);
        work.theta.clear();
        work.theta.extend_from_slice(theta);
        Ok(())
    }

    /// Checks a plant of the grid by itself and against the nominal one.
    fn fits(&self, plant: &Plant) -> Result<()> {
        if plant.Q == self.nominal.Q && plant.R == self.nominal.R {
            plant.check_matrices()?;
        } else {
            plant.check()?;
            if self.study.convention == Convention::Ito && plant.R != self.nominal.R {
                return Err(varying_noise());
            }
        }
        same_size(plant, &self.nominal)?;
        if plant.time != self.nominal.time {
            return Err(Error::Conflict {
                problem: "the family mixes continuous and discrete plants".into(),
                remedy: "give every plant the same time".into(),
            });
        }
        Ok(())
    }
}
