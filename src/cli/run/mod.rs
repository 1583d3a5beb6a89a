//! `mmae run`: Monte-Carlo trials of a bank.

mod page;
mod recentring;
mod save;
mod show;

use super::arguments::RunArguments;
use super::clock::Clock;
use super::estimate::law;
use super::failure::{Failure, say};
use super::output;
use super::progress::Progress;
use super::signals::Signals;
use crate::error::Error;
use crate::par::RunControl;
use crate::report::write::Output;
use crate::scenario::{Scenario, Simulation};
use crate::sim::Summary;

/// Up to so many trials are also told one by one.
const FEW: u64 = 16;

pub(super) fn run(args: &RunArguments, signals: &Signals) -> Result<(), Failure> {
    let clock = Clock::start();
    let scenario = Scenario::from_file(&args.file)?;
    for warning in scenario.warnings() {
        say("warning", &warning.to_string());
    }
    if scenario.is_adaptive() {
        return super::adaptive::run(args, &scenario, signals, &clock);
    }
    let mut simulation = scenario.simulation(&args.truth)?;
    if let Some(name) = args.weighting {
        simulation.estimator.weighting.law = law(name, &simulation.estimator);
    }
    simulation.trials = args.trials.unwrap_or(simulation.trials);
    simulation.seed = args.seed.unwrap_or(simulation.seed);
    let beside = scenario.recentring(&simulation)?;
    let output = match &args.out {
        Some(dir) => Some(Output::open(dir, &save::FILES, args.force)?),
        None => None,
    };
    let progress = Progress::of("trials");
    let report = |done, total| progress.update(done, total);
    let control = RunControl::default()
        .threads(args.threads.into())
        .cancel(signals.cancel())
        .progress(&report);
    let keep = if simulation.trials <= FEW { (0..simulation.trials).collect() } else { Vec::new() };
    let every = simulation.every;
    if output.is_some() {
        simulation.every = save::stride(simulation.steps, every);
    }
    let result = simulation.experiment(keep).run(&control);
    progress.finish();
    let fine = result.map_err(|e| match e {
        Error::Cancelled => Failure::Cancelled,
        e => scenario.explain_run(e).into(),
    })?;
    // pictures have more points than were asked for
    let summary = save::thin(&fine, every);
    if summary.last().failed.iter().all(|failed| *failed == 1.0) {
        let what = "every member has run away in every trial";
        let remedy = "stabilise the loop of the plant, or simulate fewer steps";
        return Err(Failure::Numerical(vec![format!("{what}: {remedy}")]));
    }
    let beside = match beside {
        Some(trials) => Some(recentring::run(&scenario, &simulation, trials, args, signals)?),
        None => None,
    };
    warn(&simulation, &summary);
    if let Some(output) = output {
        let dir = output.dir().to_path_buf();
        let results = save::Results {
            args,
            scenario: &scenario,
            simulation: &simulation,
            fine: &fine,
            summary: &summary,
            recentring: beside.as_ref(),
        };
        results.save(output, signals, &clock)?;
        say("note", &format!("wrote {} to {}", save::FILES.join(", "), dir.display()));
    }
    output::print(Some(signals), |out| {
        if args.json {
            show::json(out, &simulation, &summary, beside.as_ref())
        } else {
            show::text(out, &simulation, &summary)?;
            beside.as_ref().map_or(Ok(()), |b| b.text(out))
        }
    })
}

/// What a result lacks, on the standard error.
fn warn(simulation: &Simulation, summary: &Summary) {
    let label = |i: usize| &simulation.estimator.labels[i];
    for (i, failure) in summary.failures.iter().enumerate() {
        let failed = summary.last().failed[i];
        match failure {
            Some(failure) => {
                say("warning", &format!("model {} ({}) is unusable: {failure}", i + 1, label(i)));
            }
            None if failed > 0.0 => {
                let percent = 100.0 * failed;
                let what = format!("model {} ({}) ran away in {percent} %", i + 1, label(i));
                say("warning", &format!("{what} of the trials"));
            }
            None => {}
        }
    }
}
