//! `mmae new`: a commented scenario to start from.

use super::arguments::{Kind, NewArguments};
use super::failure::{Failure, say};
use super::output;
use crate::report::write;
use crate::scenario::{Template, template};

pub(super) fn run(args: &NewArguments) -> Result<(), Failure> {
    let text = template(match args.kind {
        Kind::Pendulum => Template::Pendulum,
        Kind::Oscillator => Template::Oscillator,
        Kind::Blank => Template::Blank,
    });
    match &args.out {
        Some(path) => {
            write::file(path, text.as_bytes(), args.force)?;
            say("note", &format!("wrote {}", path.display()));
            Ok(())
        }
        None => output::print(None, |out| out.write_all(text.as_bytes())),
    }
}
