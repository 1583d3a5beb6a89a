//! Why a command failed: message and exit code.

use std::io::Write;
use std::process::ExitCode;

use super::signals::Signals;
use crate::error::Error;
use crate::report::write;
use crate::scenario;
use crate::sweep;

const SCENARIO: u8 = 3;
const NUMERICAL: u8 = 4;
const PARTS: u8 = 5;
const FILES: u8 = 6;
const LIMITS: u8 = 7;

/// A command that did not do what it was asked.
#[derive(Debug)]
pub(super) enum Failure {
    /// The scenario, or the engine on a key of it.
    Scenario(scenario::Error),
    /// Nothing could be computed; one message a cause.
    Numerical(Vec<String>),
    /// Something does not fit in memory.
    Limit(String),
    /// Parts that are missing, damaged or of another study.
    Parts(Vec<String>),
    /// A signal came during a run in parts.
    Stopped(String),
    /// A result directory.
    Files(write::Error),
    /// A result stands in the way of parts.
    Present(String),
    /// The standard output.
    Output(std::io::Error),
    /// A signal came.
    Cancelled,
}

impl From<scenario::Error> for Failure {
    fn from(e: scenario::Error) -> Self {
        match e {
            scenario::Error::Engine { source: Error::Cancelled, .. } => Failure::Cancelled,
            e => Failure::Scenario(e),
        }
    }
}

impl From<write::Error> for Failure {
    fn from(e: write::Error) -> Self {
        Failure::Files(e)
    }
}

impl From<sweep::Error> for Failure {
    fn from(e: sweep::Error) -> Self {
        match e {
            sweep::Error::Files(e) => Failure::Files(e),
            sweep::Error::Incomplete { problems } => Failure::Parts(problems),
            e @ sweep::Error::Present { .. } => Failure::Present(e.to_string()),
            e @ sweep::Error::Stopped { .. } => Failure::Stopped(e.to_string()),
            e => Failure::Parts(vec![e.to_string()]),
        }
    }
}

impl Failure {
    /// The exit code, see the help.
    pub(super) fn code(&self, signals: &Signals) -> ExitCode {
        ExitCode::from(match self {
            Failure::Scenario(scenario::Error::Read { .. }) => FILES,
            Failure::Scenario(scenario::Error::TooLarge { .. }) => LIMITS,
            Failure::Scenario(scenario::Error::Engine { source, .. }) => code_of(source),
            Failure::Scenario(_) => SCENARIO,
            Failure::Numerical(_) => NUMERICAL,
            Failure::Limit(_) => LIMITS,
            Failure::Parts(_) => PARTS,
            Failure::Files(_) | Failure::Present(_) | Failure::Output(_) => FILES,
            Failure::Cancelled | Failure::Stopped(_) => signals.code(),
        })
    }

    /// The messages, one a line, on the standard error.
    pub(super) fn print(&self) {
        let lines: Vec<String> = match self {
            // a diagnostic never holds a line break
            Failure::Scenario(e @ scenario::Error::Invalid(_)) => {
                e.to_string().lines().map(String::from).collect()
            }
            Failure::Scenario(e) => vec![e.to_string()],
            Failure::Numerical(messages) | Failure::Parts(messages) => messages.clone(),
            Failure::Limit(message) | Failure::Present(message) | Failure::Stopped(message) => {
                vec![message.clone()]
            }
            Failure::Files(e) => vec![e.to_string()],
            Failure::Output(e) => vec![format!(
                "cannot write to the standard output: {e}: check the free space where it goes"
            )],
            Failure::Cancelled => vec!["stopped by a signal: nothing was written".into()],
        };
        for line in lines {
            say("error", &line);
        }
    }
}

/// One line `kind: message` on the standard error.
pub(super) fn say(kind: &str, message: &str) {
    let message: String = message
        .chars()
        .map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() })
        .collect();
    // nobody is left to tell if this fails
    let _ = writeln!(std::io::stderr().lock(), "{kind}: {message}");
}

/// Where an error of the engine belongs: to the sizes, to the numbers, or to
/// what the scenario says.
fn code_of(error: &Error) -> u8 {
    match error {
        Error::Limit { .. } => LIMITS,
        Error::Model { source, .. } | Error::Plant { source, .. } => code_of(source),
        Error::AllFailed { .. }
        | Error::Undetectable { .. }
        | Error::Unstabilizable { .. }
        | Error::NoStabilizingSolution { .. }
        | Error::NotStable { .. }
        | Error::NotObservable { .. }
        | Error::ObserverUnstable { .. }
        | Error::NotIdentifiable { .. }
        | Error::UnstablePlant { .. }
        | Error::Quadrature { .. } => NUMERICAL,
        _ => SCENARIO,
    }
}
