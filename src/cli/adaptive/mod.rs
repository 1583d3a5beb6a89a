//! Adaptive observers on the command line: trials and records.

mod answer;
mod picture;
mod record;
mod show;

use super::arguments::RunArguments;
use super::clock::Clock;
use super::failure::{Failure, say};
use super::output;
use super::progress::Progress;
use super::signals::Signals;
use crate::error::Error;
use crate::par::RunControl;
use crate::report::figure;
use crate::report::write::{MANIFEST, Output};
use crate::scenario::{AdaptiveObserver, Scenario};
use answer::{Answer, Refused};
pub(super) use record::run as estimate;
use show::Header;

/// Times that a picture wants at least.
const POINTS: u64 = 300;

/// `mmae run` on a scenario of adaptive observers.
pub(super) fn run(
    args: &RunArguments,
    scenario: &Scenario,
    signals: &Signals,
    clock: &Clock,
) -> Result<(), Failure> {
    if args.weighting.is_some() {
        say("warning", "--weighting has no effect: nothing is weighed without a bank");
    }
    let observers = scenario.adaptive_observers();
    let cases = scenario.adaptive_cases(&args.truth)?;
    let refused = refused(scenario, &observers)?;
    let usable = |i: usize| !refused.iter().any(|r| r.index == i);
    let drawn = args.out.is_some();
    let names: Vec<String> = cases
        .iter()
        .flat_map(|case| {
            let used = (0..observers.len()).filter(|i| usable(*i));
            used.map(|i| (case.name.as_str(), observers[i].name.as_str())).collect::<Vec<_>>()
        })
        .map(|(case, observer)| format!("{}-{}", file_name(case), file_name(observer)))
        .collect();
    let files = files("run.json", &names);
    let output = open(args.out.as_deref(), &files, args.force)?;
    let progress = Progress::of("trials");
    let mut answers = Vec::new();
    let total: u64 = cases.iter().map(|c| c.trials.len() as u64).sum();
    let mut done_before = 0;
    let mut every = 0;
    let mut header = Header::default();
    for case in &cases {
        for (i, observer) in observers.iter().enumerate() {
            let mut trials = case.trials[i].clone();
            trials.trials = args.trials.unwrap_or(trials.trials);
            trials.seed = args.seed.unwrap_or(trials.seed);
            every = trials.every;
            header = Header::of(scenario, &trials);
            if usable(i) {
                if drawn {
                    trials.every = stride(trials.samples - 1, every);
                }
                let all = total * trials.trials;
                let report = |done: u64, _| progress.update(done_before + done, all);
                let control = RunControl::default()
                    .threads(args.threads.into())
                    .cancel(signals.cancel())
                    .progress(&report);
                let summary = trials.run(&control).map_err(|e| match e {
                    Error::Cancelled => Failure::Cancelled,
                    e @ (Error::AllFailed { .. } | Error::Limit { .. }) => {
                        named(&observer.name, &e)
                    }
                    e => scenario.explain_adaptive(e, &observer.name).into(),
                })?;
                let mut answer = Answer::of_trials(case, i, observer, &trials, &summary);
                if summary.failed > 0 {
                    let (failed, all) = (summary.failed, trials.trials);
                    let what = format!("{} ran away in {failed} of {all} trials", observer.name);
                    say("warning", &format!("{what}, which are left out"));
                }
                answer.explain(observer);
                answers.push(answer);
            }
            done_before += trials.trials;
        }
    }
    progress.finish();
    if let Some(mut output) = output {
        let dir = output.dir().to_path_buf();
        let thinned: Vec<Answer> = answers.iter().map(|a| a.thin(every)).collect();
        output.add(&files[0], |out| show::json(out, &header, &refused, &thinned))?;
        draw(&mut output, scenario, &answers, &names, "time, s")?;
        finish(output, clock, &args.file, args.threads.into(), signals)?;
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

/// The observers that cannot be used, told on the standard error; a failure if that is
/// all of them.
fn refused(scenario: &Scenario, observers: &[AdaptiveObserver]) -> Result<Vec<Refused>, Failure> {
    let built = scenario.build_adaptive();
    let mut refused = Vec::new();
    let mut first = None;
    for (index, (result, observer)) in built.into_iter().zip(observers).enumerate() {
        let Err(error) = result else { continue };
        refused.push(Refused::new(index, observer, &error));
        first.get_or_insert((error, observer.name.clone()));
    }
    match first {
        Some((error, name)) if refused.len() == observers.len() => {
            Err(scenario.explain_adaptive(error, &name).into())
        }
        _ => {
            for Refused { observer, message, .. } in &refused {
                say("warning", &format!("observer {observer} cannot be used: {message}"));
            }
            Ok(refused)
        }
    }
}

fn named(name: &str, error: &Error) -> Failure {
    match error {
        Error::Limit { .. } => Failure::Limit(error.to_string()),
        _ => Failure::Numerical(vec![format!("observer {name}: {error}")]),
    }
}

/// Steps between two points of a picture, a divisor of `every`.
fn stride(steps: u64, every: u64) -> u64 {
    let most = (steps / POINTS).max(1);
    match every {
        0 => most,
        every => (1..=every.min(most)).rev().find(|d| every.is_multiple_of(*d)).unwrap_or(1),
    }
}

/// Letters, digits, `_` and `-`; anything else becomes `_`.
fn file_name(name: &str) -> String {
    let keep = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    name.chars().map(|c| if keep(c) { c } else { '_' }).collect()
}

/// The files of a result: pictures by name, plain where there is one of each.
fn files(json: &str, names: &[String]) -> Vec<String> {
    let mut files = vec![json.to_string()];
    files.extend(pictures(names).into_iter().flatten());
    files.push(MANIFEST.into());
    files
}

/// Names of the pictures of parameters and of states.
fn pictures(names: &[String]) -> Vec<[String; 2]> {
    if let [_] = names {
        return vec![["parameters.svg".into(), "states.svg".into()]];
    }
    let of = |name: &String| ["parameters", "states"].map(|what| format!("{what}-{name}.svg"));
    names.iter().map(of).collect()
}

fn open(
    dir: Option<&std::path::Path>,
    files: &[String],
    force: bool,
) -> Result<Option<Output>, Failure> {
    let names: Vec<&str> = files.iter().map(String::as_str).collect();
    Ok(match dir {
        Some(dir) => Some(Output::open(dir, &names, force)?),
        None => None,
    })
}

fn draw(
    output: &mut Output,
    scenario: &Scenario,
    answers: &[Answer],
    names: &[String],
    time: &str,
) -> Result<(), Failure> {
    let title = scenario.title().unwrap_or("Adaptive observer");
    for (answer, [parameters, states]) in answers.iter().zip(pictures(names)) {
        let stack = picture::parameters(answer, title, time);
        output.add(&parameters, |out| figure::write_stack(&stack, out))?;
        let stack = picture::states(answer, title, time);
        output.add(&states, |out| figure::write_stack(&stack, out))?;
    }
    Ok(())
}

fn finish(
    mut output: Output,
    clock: &Clock,
    file: &std::path::Path,
    threads: usize,
    signals: &Signals,
) -> Result<(), Failure> {
    let threads = match threads {
        0 => std::thread::available_parallelism().map_or(1, Into::into),
        n => n,
    };
    let manifest = clock.manifest(file, threads, output.written())?;
    output.add(MANIFEST, |out| manifest.write(out))?;
    if signals.raised() {
        return Err(Failure::Cancelled);
    }
    Ok(output.commit()?)
}
