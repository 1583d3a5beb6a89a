//! The result directory of `mmae run`.

use super::super::arguments::RunArguments;
use super::super::clock::Clock;
use super::super::failure::Failure;
use super::super::output::Watch;
use super::super::signals::Signals;
use super::show;
use crate::report::figure;
use crate::report::timeline::{Timeline, Track};
use crate::report::write::{MANIFEST, Output};
use crate::scenario::Simulation;
use crate::sim::Summary;

pub(super) const FILES: [&str; 3] = ["run.json", "weights.svg", MANIFEST];

pub(super) fn save(
    args: &RunArguments,
    title: Option<&str>,
    simulation: &Simulation,
    summary: &Summary,
    mut output: Output,
    signals: &Signals,
    clock: &Clock,
) -> Result<(), Failure> {
    let written = output.add(FILES[0], |out| {
        show::json(&mut Watch { out, signals: Some(signals) }, simulation, summary)
    });
    if signals.raised() {
        return Err(Failure::Cancelled);
    }
    written.map_err(Failure::from)?;
    let run = timeline(title, simulation, summary);
    output.add(FILES[1], |out| figure::write_timeline(&run, out))?;
    let threads = match args.threads {
        0 => std::thread::available_parallelism().map_or(1, Into::into),
        n => n.into(),
    };
    let manifest = clock.manifest(&args.file, threads, output.written())?;
    output.add(MANIFEST, |out| manifest.write(out))?;
    if signals.raised() {
        return Err(Failure::Cancelled);
    }
    Ok(output.commit()?)
}

/// Mean weights with their spread over the trials.
fn timeline(title: Option<&str>, simulation: &Simulation, summary: &Summary) -> Timeline {
    let estimator = &simulation.estimator;
    let record = &summary.record;
    let models = estimator.labels.len();
    let (law, trials) = (estimator.weighting.law.name(), summary.trials);
    let track = |k: usize| Track {
        name: estimator.parameters[k].clone(),
        mean: record.iter().map(|m| estimator.theta_hat(&m.p)[k]).collect(),
        models: estimator.values.iter().map(|v| v[k]).collect(),
        truth: Some(record.iter().map(|m| simulation.theta(m.step)[k]).collect()),
    };
    Timeline {
        title: title.unwrap_or("Weights of the models").into(),
        subtitle: format!(
            "{models} models, law {law}, mean of {trials} trials, bands of one standard deviation"
        ),
        time: "time, s".into(),
        t: record.iter().map(|m| m.step as f64 * simulation.dt).collect(),
        labels: estimator.labels.clone(),
        p: (0..models).map(|i| record.iter().map(|m| m.p[i]).collect()).collect(),
        spread: (0..models).map(|i| record.iter().map(|m| m.p_std[i]).collect()).collect(),
        parameters: (0..estimator.parameters.len()).map(track).collect(),
    }
}
