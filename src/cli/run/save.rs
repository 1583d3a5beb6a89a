//! The result directory of `mmae run`.

use super::super::arguments::RunArguments;
use super::super::clock::Clock;
use super::super::course::{self, Course};
use super::super::failure::Failure;
use super::super::output::{self, Watch};
use super::super::signals::Signals;
use super::page;
use super::recentring::Recentring;
use super::show;
use crate::engine::Mmae;
use crate::par::RunControl;
use crate::report::figure;
use crate::report::html::{self, Page};
use crate::report::timeline::{Bands, Layer, Panel, Stack, Timeline, Track};
use crate::report::write::{MANIFEST, Output, REPORT};
use crate::scenario::{Scenario, Simulation};
use crate::sim::{Measurement, Moment, MonteCarlo, Summary};

pub(super) const FILES: [&str; 6] =
    ["run.json", "weights.svg", "errors.svg", "trial.svg", REPORT, MANIFEST];

/// Times that a picture wants at least.
const POINTS: u64 = 100;
/// Bytes that the reports of a trial may take that is drawn in full.
const LARGE: u64 = 1 << 28;
/// States whose errors are drawn.
const STATES: usize = 6;

/// Steps between two points of a picture: a divisor of `every`, so that what was
/// asked for is among them.
pub(super) fn stride(steps: u64, every: u64) -> u64 {
    let most = (steps / POINTS).max(1);
    match every {
        0 => most,
        every => (1..=every.min(most)).rev().find(|d| every.is_multiple_of(*d)).unwrap_or(1),
    }
}

/// The reports that were asked for.
pub(super) fn thin(summary: &Summary, every: u64) -> Summary {
    let wanted =
        |m: &&Moment| m.step == summary.steps || (every > 0 && m.step.is_multiple_of(every));
    let record = summary.record.iter().filter(wanted).cloned().collect();
    Summary { record, ..summary.clone() }
}

/// What there is to save.
pub(super) struct Results<'a> {
    pub(super) args: &'a RunArguments,
    pub(super) scenario: &'a Scenario,
    pub(super) simulation: &'a Simulation,
    /// With the reports of the pictures.
    pub(super) fine: &'a Summary,
    /// With those that were asked for.
    pub(super) summary: &'a Summary,
    /// Beside an adaptive observer.
    pub(super) recentring: Option<&'a Recentring>,
}

impl Results<'_> {
    pub(super) fn save(
        &self,
        mut output: Output,
        signals: &Signals,
        clock: &Clock,
    ) -> Result<(), Failure> {
        let control =
            RunControl::default().threads(self.args.threads.into()).cancel(signals.cancel());
        let written = output.add(FILES[0], |out| {
            let mut watch = Watch { out, signals: Some(signals) };
            show::json(&mut watch, self.simulation, self.summary, self.recentring)
        });
        if signals.raised() {
            return Err(Failure::Cancelled);
        }
        written.map_err(Failure::from)?;
        let pictures = [
            figure::timeline_to_string(&self.weights(&control)),
            figure::stack_to_string(&self.errors()),
            figure::stack_to_string(&self.trial(&control)?),
        ];
        for (name, picture) in FILES[1..].iter().zip(&pictures) {
            output.add(name, |out| out.write_all(picture.as_bytes()))?;
        }
        let threads = match self.args.threads {
            0 => std::thread::available_parallelism().map_or(1, Into::into),
            n => n.into(),
        };
        let (subtitle, text) = (self.bank(), output::scenario(&self.args.file));
        let manifest = clock.manifest(&self.args.file, threads, output.written())?;
        let page = Page {
            title: self.title(),
            subtitle: &subtitle,
            figures: page::figures(pictures),
            tables: page::tables(self.simulation, self.summary),
            scenario: &text,
            manifest: &manifest,
        };
        output.add(REPORT, |out| html::write(&page, out))?;
        let manifest = clock.manifest(&self.args.file, threads, output.written())?;
        output.add(MANIFEST, |out| manifest.write(out))?;
        if signals.raised() {
            return Err(Failure::Cancelled);
        }
        Ok(output.commit()?)
    }

    fn title(&self) -> &str {
        self.scenario.title().unwrap_or("Multiple-model estimation")
    }

    fn times(&self) -> Vec<f64> {
        self.fine.record.iter().map(|m| m.step as f64 * self.simulation.dt).collect()
    }

    /// "4 models, law bayes".
    fn bank(&self) -> String {
        let estimator = &self.simulation.estimator;
        format!("{} models, law {}", estimator.labels.len(), estimator.weighting.law.name())
    }

    /// Medians of weights and parameters with bands.
    fn weights(&self, control: &RunControl<'_>) -> Timeline {
        let (estimator, record) = (&self.simulation.estimator, &self.fine.record);
        let models = estimator.labels.len();
        let boundaries = course::boundaries(self.scenario, &estimator.parameters, control);
        let truth = |k: usize| -> Option<Vec<f64>> {
            record.iter().map(|m| self.simulation.theta(m.step).get(k).copied()).collect()
        };
        let track = |k: usize| Track {
            name: estimator.parameters[k].clone(),
            mean: record.iter().map(|m| m.theta_hat_quantiles[k][2]).collect(),
            bands: Bands::of(record.iter().map(|m| &m.theta_hat_quantiles[k])),
            models: estimator.values.iter().map(|v| v[k]).collect(),
            boundaries: boundaries.clone(),
            truth: truth(k),
        };
        let trials = self.fine.trials;
        let what = if trials > 1 {
            format!("medians of {trials} trials, bands of 50 % and 90 % of them")
        } else {
            "one trial".into()
        };
        let legend = course::legend(&estimator.parameters, true, &boundaries);
        Timeline {
            title: self.title().into(),
            subtitle: format!("{}; {what}{legend}", self.bank()),
            time: "time, s".into(),
            t: self.times(),
            labels: estimator.labels.clone(),
            p: (0..models).map(|i| record.iter().map(|m| m.p_quantiles[i][2]).collect()).collect(),
            bands: match trials {
                1 => Vec::new(),
                _ => (0..models)
                    .map(|i| Bands::of(record.iter().map(|m| &m.p_quantiles[i])))
                    .collect(),
            },
            parameters: (0..estimator.parameters.len()).map(track).collect(),
        }
    }

    /// Errors of the states over the trials.
    fn errors(&self) -> Stack {
        let record = &self.fine.record;
        let states = &self.simulation.estimator.names.states;
        let layers = |pick: &dyn Fn(&Moment) -> &[f64; 5]| {
            let Bands([low, quarter, three, high]) = Bands::of(record.iter().map(pick));
            let middle = record.iter().map(|m| pick(m)[2]).collect();
            vec![Layer::Wide(low, high), Layer::Narrow(quarter, three), Layer::Estimate(middle)]
        };
        let mut norm = layers(&|m| &m.x_error_norm_quantiles);
        norm.insert(2, Layer::Truth(record.iter().map(|m| m.x_error_rms).collect()));
        let mut panels = vec![Panel { name: "norm".into(), layers: norm }];
        let count = self.fine.last().x_error_quantiles.len();
        for j in 0..count.min(STATES) {
            let mut layers = layers(&|m| &m.x_error_quantiles[j]);
            layers.insert(2, Layer::Level(0.0));
            panels.push(Panel { name: states.get(j).cloned().unwrap_or_default(), layers });
        }
        let key = [
            (Layer::Wide(Vec::new(), Vec::new()), "90 % of the trials"),
            (Layer::Narrow(Vec::new(), Vec::new()), "50 %"),
            (Layer::Estimate(Vec::new()), "median"),
            (Layer::Truth(Vec::new()), "root mean square"),
        ];
        Stack {
            title: self.title().into(),
            subtitle: format!(
                "{}; errors of the fused state in {}",
                self.bank(),
                if self.fine.trials == 1 {
                    "one trial".into()
                } else {
                    format!("{} trials", self.fine.trials)
                }
            ),
            time: "time, s".into(),
            t: self.times(),
            key: key.map(|(layer, text)| (layer, text.into())).to_vec(),
            panels,
        }
    }

    /// The first trial, measured and judged step by step.
    fn trial(&self, control: &RunControl<'_>) -> Result<Stack, Failure> {
        let simulation = self.simulation;
        let estimator = &simulation.estimator;
        // sums of weights, consistency and errors in lanes, see the tally of trials
        let each = 72 * (10 * estimator.labels.len() + 4 * estimator.names.states.len() + 8);
        let every = (simulation.steps.saturating_mul(each as u64)).div_ceil(LARGE);
        let whole = every == 1;
        let one = MonteCarlo { trials: 1, every, ..simulation.experiment(vec![0]) };
        let summary = one.run(control).map_err(|e| Failure::from(self.scenario.explain_run(e)))?;
        let mut course = Course::default();
        // residuals come from the engine on the measurements of the trial
        let judged = whole && simulation.measurement == Measurement::Sampled;
        let mut engine: Option<Mmae> = if judged { estimator.start().ok() } else { None };
        for trial in &summary.kept {
            let count = summary.record.len();
            let row = |all: &[f64], k: usize| {
                let width = all.len() / count;
                all[k * width..][..width].to_vec()
            };
            for (k, moment) in summary.record.iter().enumerate() {
                let y = row(&trial.y, k);
                let t = moment.step as f64 * simulation.dt;
                course.push(t, &y, &row(&trial.x_hat, k), &row(&trial.x, k));
                let Some(mmae) = &mut engine else { continue };
                let [_, m, _] = mmae.bank().sizes();
                let mut u = row(&trial.u, k);
                u.resize(m, 0.0);
                match mmae.step(&u, &y) {
                    Ok(_) => course.judge(mmae),
                    Err(_) => engine = None,
                }
            }
        }
        let subtitle = format!("{}; first trial, seed {}", self.bank(), simulation.seed);
        Ok(course.stack(self.title(), subtitle, "time, s", &estimator.names))
    }
}
