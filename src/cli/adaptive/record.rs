//! `mmae estimate` on a scenario of adaptive observers.

use super::super::arguments::EstimateArguments;
use super::super::clock::Clock;
use super::super::estimate::data::{self, Record};
use super::super::failure::{Failure, say};
use super::super::output;
use super::super::signals::Signals;
use super::answer::{Answer, Row, numbers};
use super::{draw, file_name, files, finish, open, refused, show, stride};
use crate::adaptive::{Adaptive, Settings};
use crate::scenario::{AdaptiveObserver, Diagnostic, Error, Scenario, Since};

pub(in super::super) fn run(
    args: &EstimateArguments,
    scenario: &Scenario,
    signals: &Signals,
    clock: &Clock,
) -> Result<(), Failure> {
    if args.weighting.is_some() {
        say("warning", "--weighting has no effect: nothing is weighed without a bank");
    }
    let observers = scenario.adaptive_observers();
    let names = scenario.adaptive_names().cloned().unwrap_or_default();
    let record = data::read(&args.data, &names)?;
    let refused = refused(scenario, &observers)?;
    let used: Vec<&AdaptiveObserver> = (observers.iter().enumerate())
        .filter(|(i, _)| !refused.iter().any(|r| r.index == *i))
        .map(|(_, o)| o)
        .collect();
    let labels: Vec<String> = used.iter().map(|o| file_name(&o.name)).collect();
    let files = files("estimate.json", &labels);
    let output = open(args.out.as_deref(), &files, args.force)?;
    let dt = used.first().map_or(1.0, |o| o.settings.dt);
    let steps = intervals(args, &record, dt)?;
    let total: u64 = steps.iter().sum();
    let every = if output.is_some() { stride(record.len as u64, args.every) } else { args.every };
    let mut answers = Vec::new();
    for observer in used {
        answers.push(follow(scenario, observer, &record, &steps, every, signals)?);
    }
    let header = show::Header::record(scenario, dt, total);
    if let Some(mut output) = output {
        let dir = output.dir().to_path_buf();
        let thinned: Vec<Answer> = answers.iter().map(|a| a.thin(args.every)).collect();
        output.add(&files[0], |out| show::json(out, &header, &refused, &thinned))?;
        let time = if record.t.is_some() { "t" } else { "time, s" };
        draw(&mut output, scenario, &answers, &labels, time)?;
        finish(output, clock, &args.file, 1, signals)?;
        say("note", &format!("wrote {} to {}", files.join(", "), dir.display()));
        answers = thinned;
    }
    output::print(Some(signals), |out| {
        if args.json {
            show::json(out, &header, &refused, &answers)
        } else {
            show::text(out, &header, &refused, &answers)
        }
    })
}

/// Sampling intervals up to each row; 1 for the first.
fn intervals(args: &EstimateArguments, record: &Record, dt: f64) -> Result<Vec<u64>, Failure> {
    let Some(t) = &record.t else { return Ok(vec![1; record.len]) };
    let one = |(k, since): (usize, Since)| match since {
        Since::Steps(steps) => Ok(steps),
        Since::Seconds(seconds) => Err(Failure::from(Error::Invalid(vec![Diagnostic {
            file: args.data.display().to_string(),
            line: k + 2,
            column: 1,
            key: "t".into(),
            message: format!("{seconds} s after the sample before, not a multiple of dt = {dt} s"),
            remedy: "give the interval of the record as adaptive.dt".into(),
        }]))),
    };
    Since::all(t, dt).enumerate().map(one).collect()
}

/// Runs an observer along the record.
fn follow(
    scenario: &Scenario,
    observer: &AdaptiveObserver,
    record: &Record,
    steps: &[u64],
    every: u64,
    signals: &Signals,
) -> Result<Answer, Failure> {
    let [_, m, q, _] = observer.structure.sizes();
    let t0 = record.t.as_ref().map_or(0.0, |t| t[0]);
    let settings = Settings { t0, rank_test: false, ..observer.settings.clone() };
    let structure = observer.structure.clone();
    let mut adaptive = Adaptive::new(structure, settings, vec![observer.tuning.clone()])
        .map_err(|e| Failure::from(scenario.explain_adaptive(e, &observer.name)))?;
    let mut rows = Vec::new();
    for k in 0..record.len {
        if signals.raised() {
            return Err(Failure::Cancelled);
        }
        let failed = |e: crate::Error| Failure::Numerical(vec![format!("sample {}: {e}", k + 1)]);
        let (u, y) = (&record.u[k * m..][..m], &record.y[k * q..][..q]);
        // a gap in the times is so many measurements that are missing
        let before = &record.u[k.saturating_sub(1) * m..][..m];
        adaptive.step_after(steps[k], before, u, y).map_err(failed)?;
        let row = k as u64 + 1;
        if every > 0 && row.is_multiple_of(every) {
            let e = adaptive.estimate(0);
            rows.push(Row {
                k: row,
                t: record.t.as_ref().map_or(adaptive.time(), |t| t[k]),
                theta_hat: numbers(&e.theta),
                theta_std: numbers(&e.std),
                theta_quantiles: Vec::new(),
                x_hat: numbers(&e.x_hat),
                x_std: numbers(&e.x_std),
                x_quantiles: Vec::new(),
                x: Vec::new(),
                y: y.to_vec(),
            });
        }
    }
    if !adaptive.is_sound(0) {
        let what = format!("observer {} ran away", observer.name);
        let remedy = "bound its parameters with min and max, or give a smaller P0";
        return Err(Failure::Numerical(vec![format!("{what}: {remedy}")]));
    }
    let mut answer = Answer::of_estimate(observer, &adaptive.estimate(0));
    answer.explain(observer);
    answer.record = rows;
    Ok(answer)
}
