//! The study as a picture (SVG): one parameter as curves over bands, two as a
//! map of winners.
//!
//! Text keeps a size that is legible at 600 pixels of width; colours follow
//! Okabe and Ito (2008), so that they stay apart for colour-blind readers, and
//! every colour is doubled by a number or a label.

mod canvas;
mod certain;
mod contour;
mod curves;
mod decisions;
mod key;
mod labels;
mod map;
mod margin;
mod palette;
mod panel;
mod place;
mod placement;
mod scale;
mod shade;
mod stack;
mod trace;
mod weights;

use std::io::{self, Write};

use crate::eip::EipSets;
use crate::report::timeline::{Stack, Timeline};

/// Writes the picture as a stand-alone SVG file that scales to any width.
///
/// With more than two parameters the first two are shown, the others at the
/// middle of their axis, and the subtitle says so.
///
/// # Errors
/// Whatever `out` reports.
pub fn write(sets: &EipSets, mut out: impl Write) -> io::Result<()> {
    let drawing = if sets.grid.axes().len() == 1 { curves::draw(sets) } else { map::draw(sets) };
    out.write_all(b"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n")?;
    svg::write(&mut out, &drawing)?;
    out.write_all(b"\n")
}

/// Writes the sets before and after a placement, studies of one parameter and one
/// grid, as a stand-alone SVG file.
///
/// # Errors
/// Whatever `out` reports.
pub fn write_placement(before: &EipSets, after: &EipSets, mut out: impl Write) -> io::Result<()> {
    out.write_all(b"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n")?;
    svg::write(&mut out, &placement::draw(before, after))?;
    out.write_all(b"\n")
}

/// Writes the weights of a bank along a record, and the parameters that follow,
/// as a stand-alone SVG file.
///
/// # Errors
/// Whatever `out` reports.
pub fn write_timeline(run: &Timeline, mut out: impl Write) -> io::Result<()> {
    out.write_all(b"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n")?;
    svg::write(&mut out, &weights::draw(run))?;
    out.write_all(b"\n")
}

/// Writes panels over one time axis as a stand-alone SVG file.
///
/// # Errors
/// Whatever `out` reports.
pub fn write_stack(run: &Stack, mut out: impl Write) -> io::Result<()> {
    out.write_all(b"<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n")?;
    svg::write(&mut out, &stack::draw(run))?;
    out.write_all(b"\n")
}

/// The picture as text, as [`write_timeline`] writes it.
pub fn timeline_to_string(run: &Timeline) -> String {
    text(|bytes| write_timeline(run, bytes))
}

/// The picture as text, as [`write_stack`] writes it.
pub fn stack_to_string(run: &Stack) -> String {
    text(|bytes| write_stack(run, bytes))
}

/// The picture as text, as [`write()`] writes it.
pub fn to_string(sets: &EipSets) -> String {
    text(|bytes| write(sets, bytes))
}

fn text(fill: impl FnOnce(&mut Vec<u8>) -> io::Result<()>) -> String {
    let mut bytes = Vec::new();
    // writing to memory does not fail, and SVG text is UTF-8
    let _ = fill(&mut bytes);
    String::from_utf8(bytes).unwrap_or_default()
}
