//! The Monte-Carlo experiment that a scenario describes.

use super::run::Length;
use super::truth::Written;
use super::{Error, Estimator, Scenario};
use crate::model::{Family, Plant, Time};
use crate::sim::{Measurement, MonteCarlo, Truth};

/// A bank, the plant that is really there, and how often it is run.
#[derive(Debug, Clone)]
pub struct Simulation {
    /// The bank with its weighting.
    pub estimator: Estimator,
    /// The plant.
    pub truth: Truth,
    /// Seconds between measurements.
    pub dt: f64,
    /// Measurements of each trial.
    pub steps: u64,
    /// Trials.
    pub trials: u64,
    /// How the observers see the plant.
    pub measurement: Measurement,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Steps between two reports, 0 for the end only.
    pub every: u64,
}

impl Simulation {
    /// The experiment; the courses of the trials in `keep` are kept.
    pub fn experiment(&self, keep: Vec<u64>) -> MonteCarlo {
        MonteCarlo {
            members: self.estimator.members.clone(),
            settings: self.estimator.settings.clone(),
            weighting: self.estimator.weighting.clone(),
            prior: self.estimator.prior.clone(),
            truth: self.truth.clone(),
            steps: self.steps,
            trials: self.trials,
            measurement: self.measurement,
            seed: self.seed,
            every: self.every,
            keep,
            values: self.estimator.values.clone(),
        }
    }
}

impl Scenario {
    /// The experiment that `[bank]`, `[weighting]`, `[truth]` and `[run]` describe.
    ///
    /// `changes` replace parameters of the truth by name; `model` stands for the
    /// number of a model, counted from 1.
    ///
    /// ```
    /// use mmae::par::RunControl;
    /// use mmae::scenario::Scenario;
    /// let text = r#"
    ///     format = 1
    ///     [plant]
    ///     family = "tracker"
    ///     [bank]
    ///     models = { rho = [0.96, 0.97, 1.0, 1.01] }
    ///     x0 = [-100, 2, 200, 20]
    ///     P0 = 0
    ///     [truth]
    ///     model = 3
    ///     [run]
    ///     steps = 50
    ///     trials = 40
    /// "#;
    /// let scenario = Scenario::parse("tracker.toml", text)?;
    /// let summary = scenario.simulation(&[])?.experiment(Vec::new()).run(&RunControl::default())?;
    /// assert!(summary.last().identified[2] > 0.7);
    /// let other = scenario.simulation(&[("rho".into(), 0.96)])?;
    /// let summary = other.experiment(Vec::new()).run(&RunControl::default())?;
    /// assert!(summary.last().identified[0] > 0.7);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As [`Scenario::estimator`]; `Invalid` without `[run]`, for a loop that is
    /// closed, and for a change that names no parameter; `Engine` for a plant
    /// that the family cannot build.
    pub fn simulation(&self, changes: &[(String, f64)]) -> Result<Simulation, Error> {
        let estimator = self.estimator()?;
        let Some(run) = &self.run else {
            return Err(self.missing("run", "add [run] with steps, and perhaps trials and seed"));
        };
        let dt = match (self.family.time(), estimator.settings.dt) {
            (Time::Discrete { dt }, _) => dt,
            (Time::Continuous, dt) => dt.unwrap_or(f64::NAN),
        };
        let steps = match run.length {
            Length::Steps(steps) => steps,
            Length::Duration(seconds) => {
                let steps = (seconds / dt).round();
                if !(1.0..=1e15).contains(&steps) {
                    let message = format!("{seconds} s are {steps} steps of {dt} s");
                    return Err(self.fault("run.duration", &message, "give one step or more"));
                }
                steps as u64
            }
        };
        let mut written = self.truth.clone().unwrap_or_default();
        for (name, value) in changes {
            self.change(&mut written, name, *value)?;
        }
        let phases = self.phases(&written, dt)?;
        let n = phases.first().map_or(0, |(_, plant)| plant.nx());
        // what the observers believe, where it says anything of this plant
        let believed = match (&written.model, &estimator.members.initial[..]) {
            (_, [one]) => Some(&one.x_hat),
            (Some(course), each) => each.get(course[0].1).map(|i| &i.x_hat),
            (None, _) => None,
        };
        let mut x0 = written.x0.clone().or_else(|| believed.cloned()).unwrap_or_default();
        x0.resize(n, 0.0);
        Ok(Simulation {
            truth: Truth {
                phases,
                x0,
                P0: written.p0.clone(),
                controller: self.surroundings.controller.clone(),
                input: self.surroundings.input.clone(),
                delay: self.delay,
                signals: self.signals.clone(),
            },
            estimator,
            dt,
            steps,
            trials: run.trials,
            measurement: run.measurement,
            seed: run.seed,
            every: run.every,
        })
    }

    /// Puts a parameter of the truth, or its model, to one value for ever.
    fn change(&self, written: &mut Written, name: &str, value: f64) -> Result<(), Error> {
        let models = self.bank.as_ref().map_or(0, |b| b.models.len());
        if name == "model" && !self.family.parameters().iter().any(|p| p.name == "model") {
            if !(value >= 1.0 && value <= models as f64 && value.fract() == 0.0) {
                let message = format!("{value} is not the number of a model");
                let remedy = format!("count the models from 1 to {models}");
                return Err(self.fault("truth.model", &message, &remedy));
            }
            written.model = Some(vec![(0.0, value as usize - 1)]);
            return Ok(());
        }
        self.family.theta_with(&[(name, value)]).map_err(|e| {
            let (message, remedy) = super::places::split(&e);
            self.fault(&format!("truth.parameters.{name}"), &message, &remedy)
        })?;
        written.parameters.retain(|(n, _)| n != name);
        written.parameters.push((name.into(), vec![(0.0, value)]));
        Ok(())
    }

    /// The plants of the truth and the first step of each.
    fn phases(&self, written: &Written, dt: f64) -> Result<Vec<(u64, Plant)>, Error> {
        let mut times: Vec<f64> = vec![0.0];
        times.extend(written.parameters.iter().flat_map(|(_, c)| c.iter().map(|p| p.0)));
        times.extend(written.model.iter().flatten().map(|p| p.0));
        times.sort_by(f64::total_cmp);
        times.dedup();
        let mut phases: Vec<(u64, Plant)> = Vec::new();
        for t in times {
            // the first step that begins at the time or later
            let from = (t / dt - 1e-9).ceil().max(0.0) as u64 + 1;
            let plant = self.plant_at(written, t)?;
            match phases.last_mut() {
                // two changes within a step: the later one stands
                Some(last) if last.0 == from => last.1 = plant,
                _ => phases.push((from, plant)),
            }
        }
        Ok(phases)
    }

    fn plant_at(&self, written: &Written, t: f64) -> Result<Plant, Error> {
        let model = written.model.as_ref().map(|course| at(course, t));
        if let Some(explicit) = &self.explicit {
            let Some(model) = model else {
                let remedy = "add model = 1, say, the model that is right";
                return Err(self.missing("truth.model", remedy));
            };
            return Ok(explicit.plants[model].clone());
        }
        let mut values: Vec<(&str, f64)> = Vec::new();
        if let (Some(model), Some(bank)) = (model, &self.bank) {
            let named = bank.parameters.iter().zip(&bank.models[model]);
            values.extend(named.map(|(name, value)| (name.as_str(), *value)));
        }
        values.extend(written.parameters.iter().map(|(name, c)| (name.as_str(), at(c, t))));
        let plant = self
            .family
            .theta_with(&values)
            .and_then(|theta| self.family.plant(&theta))
            .and_then(|plant| plant.check().map(|()| plant))
            .map_err(|e| {
                let (message, remedy) = super::places::split(&e);
                self.fault("truth", &message, &remedy)
            })?;
        Ok(plant.with_disturbance(self.surroundings.disturbance.as_ref()))
    }
}

/// The value that holds at `t`.
fn at<T: Copy>(course: &[(f64, T)], t: f64) -> T {
    let later = course.iter().position(|p| p.0 > t).unwrap_or(course.len());
    course[later.max(1) - 1].1
}
