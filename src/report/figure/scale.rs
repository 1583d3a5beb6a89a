//! From values to points of the picture.

use crate::model::Axis;
use crate::report::number::{Tick, linear_ticks, log_ticks};

/// An axis: values `[from, to]` on pixels `[start, end]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) log: bool,
    pub(super) start: f64,
    pub(super) end: f64,
}

impl Scale {
    /// A single value is given some room on both sides.
    pub(super) fn new(from: f64, to: f64, log: bool, start: f64, end: f64) -> Self {
        let log = log && from > 0.0;
        let (from, to) = if from < to {
            (from, to)
        } else {
            let room = if from == 0.0 { 0.5 } else { 0.05 * from.abs() };
            (from - room, from + room)
        };
        Self { from, to, log, start, end }
    }

    /// The scale of a grid axis: logarithmic if the grid is, or if listed
    /// values span two decades.
    pub(super) fn of_axis(axis: &Axis, start: f64, end: f64) -> Self {
        let (from, to) = crate::report::summary::ends(axis);
        let log = match axis {
            Axis::Linear { .. } => false,
            Axis::Logarithmic { .. } => true,
            Axis::Explicit(_) => from > 0.0 && to / from >= 100.0,
        };
        Self::new(from, to, log, start, end)
    }

    /// Pixel of value `v`.
    pub(super) fn at(&self, v: f64) -> f64 {
        let share = if self.log {
            (v / self.from).ln() / (self.to / self.from).ln()
        } else {
            (v - self.from) / (self.to - self.from)
        };
        self.start + share * (self.end - self.start)
    }

    /// Value `share` of the way from one neighbour to the other on this scale.
    pub(super) fn middle(&self, a: f64, b: f64) -> f64 {
        if self.log { (a * b).sqrt() } else { a / 2.0 + b / 2.0 }
    }

    /// Round numbers, about one every `spacing` pixels.
    pub(super) fn ticks(&self, spacing: f64) -> Vec<Tick> {
        let wanted = ((self.end - self.start).abs() / spacing).floor().max(2.0) as usize;
        if self.log {
            log_ticks(self.from, self.to, wanted)
        } else {
            linear_ticks(self.from, self.to, wanted)
        }
    }
}
