//! What an observer found in a case or along a record, as it is reported.

use serde::Serialize;

use crate::adaptive::Estimate;
use crate::scenario::{AdaptiveCase, AdaptiveObserver};
use crate::sim::{AdaptiveSummary, AdaptiveTrials};

/// Numbers; `null` where there is none.
pub(super) type Numbers = Vec<Option<f64>>;

pub(super) fn number(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

pub(super) fn numbers(list: &[f64]) -> Numbers {
    list.iter().map(|v| number(*v)).collect()
}

/// An observer that cannot be used.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Refused {
    #[serde(skip)]
    pub(super) index: usize,
    pub(super) observer: String,
    pub(super) code: &'static str,
    pub(super) message: String,
}

impl Refused {
    pub(super) fn new(index: usize, observer: &AdaptiveObserver, error: &crate::Error) -> Self {
        let (code, message) = (error.code(), error.to_string());
        Self { index, observer: observer.name.clone(), code, message }
    }
}

/// A time that is reported.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Row {
    /// Samples since the start.
    pub(super) k: u64,
    pub(super) t: f64,
    pub(super) theta_hat: Numbers,
    pub(super) theta_std: Numbers,
    /// Over the trials, where there are several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) theta_quantiles: Vec<[f64; 5]>,
    pub(super) x_hat: Numbers,
    pub(super) x_std: Numbers,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) x_quantiles: Vec<[f64; 5]>,
    /// The plant's state, where it is known.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) x: Vec<f64>,
    #[serde(skip)]
    pub(super) y: Vec<f64>,
}

/// Parameters behind the estimated ones.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Behind {
    pub(super) parameters: Vec<String>,
    pub(super) value: Numbers,
    pub(super) std: Numbers,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) truth: Option<Vec<f64>>,
    /// Why there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) failure: Option<String>,
}

/// The end of a window.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Judged {
    t: Option<f64>,
    pub(super) condition: Option<f64>,
    pub(super) residual: Option<f64>,
    pub(super) drift: Option<f64>,
}

/// One observer in one case.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Answer {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) case: Option<String>,
    pub(super) observer: String,
    pub(super) reading: &'static str,
    pub(super) lambda: f64,
    pub(super) parameters: Vec<String>,
    pub(super) theta_hat: Numbers,
    pub(super) theta_std: Numbers,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) theta: Option<Vec<f64>>,
    /// Standard deviation over the trials.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) theta_spread: Numbers,
    pub(super) correlation: Vec<Numbers>,
    pub(super) at_bound: Vec<bool>,
    pub(super) window: Judged,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) physical: Option<Behind>,
    pub(super) states: Vec<String>,
    pub(super) x_hat: Numbers,
    #[serde(skip)]
    pub(super) plant_states: Vec<String>,
    #[serde(skip)]
    pub(super) outputs: Vec<String>,
    pub(super) trials: u64,
    pub(super) failed: u64,
    /// Runge-Kutta steps of an interval of the plant.
    #[serde(skip_serializing_if = "Option::is_none")]
    truth_steps: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    truth_error: Option<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) record: Vec<Row>,
    #[serde(skip)]
    last: Option<(Vec<f64>, Vec<f64>, crate::Mat<f64>)>,
}

impl Answer {
    /// After an estimate; nothing of trials or truth.
    pub(super) fn of_estimate(observer: &AdaptiveObserver, e: &Estimate) -> Self {
        let p = e.theta.len();
        let unknown = &observer.structure.unknown;
        let window = &e.window;
        Self {
            case: None,
            observer: observer.name.clone(),
            reading: observer.settings.reading.name(),
            lambda: observer.tuning.lambda,
            parameters: unknown.iter().map(|u| u.name.clone()).collect(),
            theta_hat: numbers(&e.theta),
            theta_std: numbers(&e.std),
            theta: None,
            theta_spread: Vec::new(),
            correlation: (0..p)
                .map(|i| (0..p).map(|j| number(e.correlation[(i, j)])).collect())
                .collect(),
            at_bound: e.at_bound.clone(),
            window: Judged {
                t: number(window.t),
                condition: number(window.condition),
                residual: number(window.residual),
                drift: number(window.drift),
            },
            physical: None,
            states: observer.structure.states.clone(),
            x_hat: numbers(&e.x_hat),
            plant_states: Vec::new(),
            outputs: observer.structure.outputs.clone(),
            trials: 1,
            failed: 0,
            truth_steps: None,
            truth_error: None,
            record: Vec::new(),
            last: Some((e.theta.clone(), e.std.clone(), e.correlation.clone())),
        }
    }

    /// The end of the trials of observer `i` in a case.
    pub(super) fn of_trials(
        case: &AdaptiveCase,
        i: usize,
        observer: &AdaptiveObserver,
        trials: &AdaptiveTrials,
        summary: &AdaptiveSummary,
    ) -> Self {
        let many = trials.trials > 1;
        let dt = trials.settings.dt;
        let rows = summary.record.iter().zip(&summary.course).map(|(moment, first)| Row {
            k: (first.t / dt).round() as u64,
            t: first.t,
            theta_hat: numbers(&moment.mean),
            theta_std: numbers(&first.estimate.std),
            theta_quantiles: if many { moment.quantiles.clone() } else { Vec::new() },
            x_hat: numbers(&first.estimate.x_hat),
            x_std: numbers(&first.estimate.x_std),
            x_quantiles: if many { moment.x_quantiles.clone() } else { Vec::new() },
            x: first.x.clone(),
            y: first.y.clone(),
        });
        let record: Vec<Row> = rows.collect();
        let mut answer = match summary.course.last() {
            Some(last) => Self::of_estimate(observer, &last.estimate),
            None => Self::of_estimate(observer, &empty(observer)),
        };
        if let (true, Some(last)) = (many, summary.record.last()) {
            answer.theta_hat = numbers(&last.mean);
            answer.theta_spread = numbers(&last.spread);
            if let Some((theta, _, _)) = &mut answer.last {
                theta.clone_from(&last.mean);
            }
        }
        Self {
            case: Some(case.name.clone()),
            theta: case.theta[i].clone(),
            physical: observer.physical.as_ref().map(|physical| Behind {
                parameters: physical.names.clone(),
                value: Vec::new(),
                std: Vec::new(),
                truth: case.physical[i].clone(),
                failure: None,
            }),
            plant_states: case.states.clone(),
            trials: trials.trials,
            failed: summary.failed,
            truth_steps: Some(summary.parts),
            truth_error: number(summary.truth_error),
            record,
            ..answer
        }
    }

    /// Finds the parameters behind the estimated ones.
    pub(super) fn explain(&mut self, observer: &AdaptiveObserver) {
        let (Some(physical), Some((theta, std, correlation))) = (&observer.physical, &self.last)
        else {
            return;
        };
        let truth = self.physical.take().and_then(|b| b.truth);
        let (value, std, failure) = match physical.solve(theta, std, correlation) {
            Ok((value, std)) => (numbers(&value), numbers(&std), None),
            Err(e) => (vec![None; theta.len()], vec![None; theta.len()], Some(e.to_string())),
        };
        let parameters = physical.names.clone();
        self.physical = Some(Behind { parameters, value, std, truth, failure });
    }

    /// The rows that were asked for: every `every`-th, none for 0.
    pub(super) fn thin(&self, every: u64) -> Self {
        let wanted = |row: &&Row| every > 0 && row.k > 0 && row.k.is_multiple_of(every);
        let record = self.record.iter().filter(wanted).cloned().collect();
        Self { record, ..self.clone() }
    }
}

/// The estimate of an observer that has seen nothing.
fn empty(observer: &AdaptiveObserver) -> Estimate {
    let (n, p) = (observer.structure.states.len(), observer.tuning.theta.len());
    Estimate {
        theta: observer.tuning.theta.clone(),
        std: vec![f64::NAN; p],
        correlation: crate::Mat::identity(p, p),
        at_bound: vec![false; p],
        x_hat: observer.tuning.x_hat.clone(),
        x_std: vec![f64::NAN; n],
        window: crate::adaptive::Window::default(),
        sound: true,
    }
}
