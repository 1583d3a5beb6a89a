//! The Monte-Carlo experiment that a scenario describes.

use super::course::{Clock, Course};
use super::run::Length;
use super::truth::Written;
use super::{Error, Estimator, Scenario};
use crate::model::{Family, Plant, Time};
use crate::sim::{Measurement, MonteCarlo, Truth};

/// Most bytes of plants that follow each other.
const LIMIT: u128 = 1 << 30;

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
    /// Values of the parameters in which the models differ, one list a phase of
    /// the truth.
    pub schedule: Vec<Vec<f64>>,
}

impl Simulation {
    /// True values of the parameters in which the models differ, at a step
    /// counted from 1; empty for models that are given by matrices.
    pub fn theta(&self, step: u64) -> &[f64] {
        let later = self.truth.phases.partition_point(|p| p.0 <= step);
        self.schedule.get(later.max(1) - 1).map_or(&[], Vec::as_slice)
    }

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
        let clock = Clock { dt, steps };
        let phases = self.phases(&written, clock)?;
        let schedule = match &self.explicit {
            Some(_) => Vec::new(),
            None => {
                let of = |step: u64| self.theta_of(&written, clock, step, &estimator.parameters);
                phases.iter().map(|p| of(p.0)).collect()
            }
        };
        let n = phases.first().map_or(0, |(_, plant)| plant.nx());
        // what the observers believe, where it says anything of this plant
        let believed = match (&written.model, &estimator.members.initial[..]) {
            (_, [one]) => Some(&one.x_hat),
            (Some(course), each) => each.get(model_at(course, clock, 1)).map(|i| &i.x_hat),
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
            schedule,
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
            written.model = Some(Course::constant(value));
            return Ok(());
        }
        self.family.theta_with(&[(name, value)]).map_err(|e| {
            let (message, remedy) = super::places::split(&e);
            self.fault(&format!("truth.parameters.{name}"), &message, &remedy)
        })?;
        written.parameters.retain(|(n, _)| n != name);
        written.parameters.push((name.into(), Course::constant(value)));
        Ok(())
    }

    /// The plants of the truth and the first step of each.
    fn phases(&self, written: &Written, clock: Clock) -> Result<Vec<(u64, Plant)>, Error> {
        let courses = written.parameters.iter().map(|(_, course)| course).chain(&written.model);
        let runs: Vec<[u64; 2]> = courses.flat_map(|course| course.changes(clock)).collect();
        let count = runs.iter().fold(1, |sum: u64, [a, b]| sum.saturating_add(b - a + 1));
        let nominal = self.plant_at(written, clock, 1)?;
        let bytes = u128::from(count) * size(&nominal);
        if bytes > LIMIT {
            return Err(self.explain(crate::Error::Limit {
                what: format!("a truth of {count} phases"),
                bytes,
                limit: LIMIT,
                remedy: "simulate fewer steps, or let the parameters vary in steps",
            }));
        }
        let mut from: Vec<u64> = vec![1];
        from.extend(runs.into_iter().flat_map(|[a, b]| a..=b));
        from.sort_unstable();
        from.dedup();
        from.into_iter().map(|k| Ok((k, self.plant_at(written, clock, k)?))).collect()
    }

    /// Values that a step gives to parameters, later ones stand.
    fn values<'a>(
        &'a self,
        written: &'a Written,
        clock: Clock,
        step: u64,
    ) -> impl Iterator<Item = (&'a str, f64)> {
        let model = written.model.as_ref().map(|course| model_at(course, clock, step));
        let of_model = model.zip(self.bank.as_ref()).into_iter().flat_map(|(model, bank)| {
            bank.parameters.iter().map(String::as_str).zip(bank.models[model].iter().copied())
        });
        let own = written.parameters.iter();
        of_model.chain(own.map(move |(name, c)| (name.as_str(), c.at(clock, step))))
    }

    /// The true values of the parameters `names` at a step.
    fn theta_of(&self, written: &Written, clock: Clock, step: u64, names: &[String]) -> Vec<f64> {
        let nominal = |name: &String| {
            let known = self.family.parameters().iter().find(|p| p.name == *name);
            known.map_or(f64::NAN, |p| p.nominal)
        };
        let given = |name: &String| {
            let found = self.values(written, clock, step).filter(|(n, _)| n == name).last();
            found.map(|(_, value)| value)
        };
        names.iter().map(|name| given(name).unwrap_or_else(|| nominal(name))).collect()
    }

    fn plant_at(&self, written: &Written, clock: Clock, step: u64) -> Result<Plant, Error> {
        if let Some(explicit) = &self.explicit {
            let Some(course) = &written.model else {
                let remedy = "add model = 1, say, the model that is right";
                return Err(self.missing("truth.model", remedy));
            };
            return Ok(explicit.plants[model_at(course, clock, step)].clone());
        }
        let values: Vec<(&str, f64)> = self.values(written, clock, step).collect();
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

/// Number of the model of a step, from 0.
fn model_at(course: &Course, clock: Clock, step: u64) -> usize {
    // whole numbers from 1, checked where they were read
    course.at(clock, step) as usize - 1
}

/// Bytes of a plant, columns padded to whole cache lines.
fn size(plant: &Plant) -> u128 {
    let all = [&plant.A, &plant.B, &plant.G, &plant.C, &plant.Q, &plant.R];
    all.map(|m| (m.ncols() * m.nrows().next_multiple_of(8) * 8 + 96) as u128).iter().sum()
}
