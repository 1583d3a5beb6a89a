//! The command `mmae`: `eip`, `merge`, `place`, `check`, `estimate`, `new`, `run`, `solve` and `bench`.
//!
//! Results go to the standard output, everything else to the standard error,
//! one line a message. Exit codes: 0 done, 2 usage, 3 scenario, 4 numerical
//! failure, 5 missing parts, 6 files, 7 limits, 130 and 143 after SIGINT and SIGTERM. The guide,
//! page "command", describes all of it.

mod adaptive;
mod arguments;
mod bench;
mod check;
mod clock;
mod course;
mod eip;
mod estimate;
mod failure;
mod merge;
mod new;
mod output;
mod place;
mod progress;
mod run;
mod shard;
mod signals;
mod solve;

use std::process::ExitCode;

use clap::Parser;

use arguments::{Arguments, Command};

/// Runs the command of this process and returns its exit code.
pub fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        // help, version, or a usage error
        Err(e) => {
            // nobody is left to read it if this fails
            let _ = e.print();
            return ExitCode::from(u8::try_from(e.exit_code()).unwrap_or(2));
        }
    };
    let signals = signals::Signals::install();
    let done = match &arguments.command {
        Command::Eip(args) => eip::run(args, &signals),
        Command::Merge(args) => merge::run(args),
        Command::Place(args) => place::run(args, &signals),
        Command::Check(args) => check::run(args),
        Command::New(args) => new::run(args),
        Command::Estimate(args) => estimate::run(args, &signals),
        Command::Run(args) => run::run(args, &signals),
        Command::Solve(args) => solve::run(args, &signals),
        Command::Bench(args) => bench::run(args, &signals),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.print();
            failure.code(&signals)
        }
    }
}
