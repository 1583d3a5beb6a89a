//! The bank re-centred by an adaptive observer, beside the bank alone.

use std::io::{self, Write};

use serde::Serialize;

use super::super::arguments::RunArguments;
use super::super::failure::Failure;
use super::super::signals::Signals;
use super::FEW;
use crate::error::Error;
use crate::par::RunControl;
use crate::report::significant;
use crate::scenario::{Scenario, Simulation};
use crate::sim::{RecentringTrial, RecentringTrials};

/// A member that was replaced.
#[derive(Debug, Serialize)]
struct Moved {
    t: f64,
    /// From 0, as everywhere in this document.
    member: usize,
    /// Values of the parameters of the bank.
    values: Vec<f64>,
    /// Mean NIS of the best member before.
    nis: f64,
}

/// One trial.
#[derive(Debug, Serialize)]
struct Each {
    trial: u64,
    moves: Vec<Moved>,
    theta_hat_alone: Vec<f64>,
    theta_hat: Vec<f64>,
    x_error_alone: Option<f64>,
    x_error: Option<f64>,
}

/// All trials.
#[derive(Debug, Serialize)]
pub(super) struct Recentring {
    parameters: Vec<String>,
    /// Share of the trials in which a member was replaced.
    moved: f64,
    /// Mean time of the first move.
    first_move: Option<f64>,
    /// Root mean square errors of bank alone and re-centred, after the first move.
    x_error_rms_alone: Option<f64>,
    x_error_rms: Option<f64>,
    /// At the end, one a parameter.
    theta_error_rms_alone: Vec<Option<f64>>,
    theta_error_rms: Vec<Option<f64>>,
    theta_hat_alone: Vec<Option<f64>>,
    theta_hat: Vec<Option<f64>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    per_trial: Vec<Each>,
}

/// Runs the trials of `simulation` with the adaptive observer beside the bank.
pub(super) fn run(
    scenario: &Scenario,
    simulation: &Simulation,
    trials: RecentringTrials,
    args: &RunArguments,
    signals: &Signals,
) -> Result<Recentring, Failure> {
    let control = RunControl::default().threads(args.threads.into()).cancel(signals.cancel());
    let all = trials.run(&control).map_err(|e| match e {
        Error::Cancelled => Failure::Cancelled,
        e => Failure::from(scenario.explain_run(e)),
    })?;
    Ok(Recentring::of(simulation, &trials, &all))
}

fn number(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

impl Recentring {
    fn of(simulation: &Simulation, trials: &RecentringTrials, all: &[RecentringTrial]) -> Self {
        let count = all.len() as f64;
        let truth = simulation.theta(simulation.steps);
        let mean = |pick: &dyn Fn(&RecentringTrial) -> f64| {
            number(all.iter().map(pick).sum::<f64>() / count)
        };
        let rms =
            |pick: &dyn Fn(&RecentringTrial) -> f64| mean(&|t| pick(t) * pick(t)).map(f64::sqrt);
        let width = truth.len();
        let theta = |which: usize| -> Vec<Option<f64>> {
            (0..width).map(|k| mean(&|t| t.theta_hat[which][k])).collect()
        };
        let error = |which: usize| -> Vec<Option<f64>> {
            (0..width).map(|k| rms(&|t| t.theta_hat[which][k] - truth[k])).collect()
        };
        let firsts: Vec<f64> =
            all.iter().filter_map(|t| Some(t.moves.first()?.step as f64 * simulation.dt)).collect();
        let each = |t: &RecentringTrial| Each {
            trial: t.trial,
            moves: (t.moves.iter())
                .map(|m| Moved {
                    t: m.step as f64 * simulation.dt,
                    member: m.member,
                    values: (trials.values)(&m.theta),
                    nis: m.nis,
                })
                .collect(),
            theta_hat_alone: t.theta_hat[0].clone(),
            theta_hat: t.theta_hat[1].clone(),
            x_error_alone: number(t.x_error[0]),
            x_error: number(t.x_error[1]),
        };
        Self {
            parameters: simulation.estimator.parameters.clone(),
            moved: firsts.len() as f64 / count,
            first_move: number(firsts.iter().sum::<f64>() / firsts.len() as f64),
            x_error_rms_alone: rms(&|t| t.x_error[0]),
            x_error_rms: rms(&|t| t.x_error[1]),
            theta_error_rms_alone: error(0),
            theta_error_rms: error(1),
            theta_hat_alone: theta(0),
            theta_hat: theta(1),
            per_trial: if all.len() as u64 <= FEW {
                all.iter().map(each).collect()
            } else {
                Vec::new()
            },
        }
    }

    /// A few lines.
    pub(super) fn text(&self, out: &mut dyn Write) -> io::Result<()> {
        let shown = |v: Option<f64>| v.map_or_else(|| "-".into(), |v| significant(v, 5));
        writeln!(
            out,
            "\nre-centred in {} % of the trials, first at t = {} s on average",
            significant(100.0 * self.moved, 3),
            shown(self.first_move)
        )?;
        for (k, name) in self.parameters.iter().enumerate() {
            writeln!(
                out,
                "{name} = {} (rms error {}), alone {} (rms error {})",
                shown(self.theta_hat[k]),
                shown(self.theta_error_rms[k]),
                shown(self.theta_hat_alone[k]),
                shown(self.theta_error_rms_alone[k])
            )?;
        }
        writeln!(
            out,
            "rms error of the fused state after the move: {}, alone {}",
            shown(self.x_error_rms),
            shown(self.x_error_rms_alone)
        )
    }
}
