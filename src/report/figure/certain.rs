//! What holds for every unmodelled actuator: a strip of guaranteed winners, and
//! the undecidable sets magnified, each with what the search for causal ones found.

use svg::node::element::Group;

use super::canvas::{self, Area, LABEL, NOTE, TICK, WIDTH};
use super::decisions::least;
use super::palette::{Color, GREY, INK};
use super::scale::Scale;
use crate::eip::{EipSets, Interval, Robust, Uncertain};
use crate::report::number::to_uncertainty;

/// Height of a strip.
const ROW: f64 = 26.0;
/// Boxes side by side, in all, and the room between them.
const COLUMNS: usize = 3;
const BOXES: usize = 12;
const GAP: f64 = 34.0;
/// Height of a box with its numbers.
const CELL: f64 = 3.0 * ROW + 44.0;

/// The strip below the winners; nothing where the study has no bound.
pub(super) fn strip(sets: &EipSets, x: &Scale, area: Area) -> Option<(Group, Area)> {
    let robust = sets.robust.as_ref()?;
    let area = Area { h: ROW, ..area };
    let name = canvas::text(area.x - 10.0, area.y + ROW / 2.0 + 0.35 * NOTE, NOTE, "certain");
    let group = row(robust, x, area).add(name.set("text-anchor", "end")).add(area.frame());
    Some((group, area))
}

/// Guaranteed winners in their colours, the rest hatched.
fn row(robust: &Robust, x: &Scale, area: Area) -> Group {
    let mut group = Group::new();
    for (i, set) in robust.sets.iter().enumerate() {
        for interval in set.iter().filter(|i| x.from <= i.to && i.from <= x.to) {
            let part = area.between(x.at(interval.from), x.at(interval.to), least(interval));
            group = group.add(part.rectangle().set("fill", Color::of(i)));
            let number = (i + 1).to_string();
            if canvas::width(&number, NOTE) + 4.0 < part.w {
                let y = part.y + part.h / 2.0 + 0.36 * NOTE;
                group = group.add(
                    canvas::centered(part.x + part.w / 2.0, y, NOTE, &number)
                        .set("fill", Color::of(i).contrast()),
                );
            }
        }
    }
    let hatched = |group: Group, interval: &Interval, fill: &str| {
        if interval.to < x.from || interval.from > x.to {
            return group;
        }
        let part = area.between(x.at(interval.from), x.at(interval.to), 3.0);
        group.add(part.rectangle().set("fill", "#ffffff")).add(part.rectangle().set("fill", fill))
    };
    let group = robust
        .undecidable
        .iter()
        .fold(group, |group, u| hatched(group, &u.interval, canvas::UNDECIDABLE));
    robust.fragile.iter().fold(group, |group, i| hatched(group, i, canvas::UNSTABLE))
}

/// Undecidable sets too narrow for the strip, each on its own scale.
pub(super) struct Magnified<'a> {
    sets: &'a EipSets,
    shown: Vec<&'a Uncertain>,
    top: f64,
    left: f64,
}

impl<'a> Magnified<'a> {
    pub(super) fn new(sets: &'a EipSets, x: &Scale, top: f64, left: f64) -> Self {
        let narrow = |u: &&Uncertain| x.at(u.interval.to) - x.at(u.interval.from) < 60.0;
        let all = sets.robust.iter().flat_map(|r| &r.undecidable);
        Self { sets, shown: all.filter(narrow).take(BOXES).collect(), top, left }
    }

    pub(super) fn bottom(&self) -> f64 {
        if self.shown.is_empty() {
            return self.top - 24.0;
        }
        self.top + 22.0 + CELL * self.shown.len().div_ceil(COLUMNS) as f64
    }

    pub(super) fn draw(&self) -> Group {
        let mut group = Group::new();
        if self.shown.is_empty() {
            return group;
        }
        let heading = "Undecidable for some |Delta| <= |W|, magnified";
        group = group.add(canvas::text(self.left, self.top + 4.0, LABEL, heading));
        let columns = self.shown.len().min(COLUMNS) as f64;
        let w = ((WIDTH - 30.0 - self.left - GAP * (columns - 1.0)) / columns).min(400.0);
        for (k, u) in self.shown.iter().enumerate() {
            let (row, column) = (k / COLUMNS, k % COLUMNS);
            let area = Area {
                x: self.left + column as f64 * (w + GAP),
                y: self.top + 18.0 + row as f64 * CELL,
                w,
                h: 3.0 * ROW,
            };
            group = group.add(self.magnified(u, area, column == 0));
        }
        group
    }

    /// Nominal winners, guaranteed winners, and where a causal `Delta` is known.
    fn magnified(&self, u: &Uncertain, area: Area, first: bool) -> Group {
        let Interval { from, to } = u.interval;
        let room = (0.4 * (to - from)).max(1e-9 * from.abs().max(1e-300));
        let x = Scale::new(from - room, to + room, false, area.x, area.right());
        let part = |k: usize| Area { y: area.y + k as f64 * ROW, h: ROW, ..area };
        let mut group = Group::new();
        if let Some(case) = self.sets.cases.first() {
            group = group.add(super::decisions::strip(case, &x, part(0), false, &[]));
        }
        if let Some(robust) = &self.sets.robust {
            group = group.add(row(robust, &x, part(1)));
        }
        for inner in &u.inner {
            let Interval { from, to } = inner.interval;
            let bar = part(2).between(x.at(from), x.at(to), 2.0);
            let bar = Area { y: bar.y + 6.0, h: ROW - 12.0, ..bar };
            group = group.add(bar.rectangle().set("fill", GREY));
        }
        for (k, name) in ["winner", "certain", "found"].iter().enumerate().filter(|_| first) {
            let y = part(k).y + ROW / 2.0 + 0.35 * NOTE;
            let text = canvas::text(area.x - 10.0, y, NOTE, name);
            group = group.add(text.set("text-anchor", "end"));
        }
        group = group.add(area.frame());
        for (v, anchor, shift) in [(from, "end", 16.0), (to, "start", -16.0)] {
            let at = x.at(v);
            let text = to_uncertainty(v, 0.01 * (to - from).abs());
            let number = canvas::text(at + shift, area.bottom() + 6.0 + TICK, NOTE, &text);
            group = group
                .add(canvas::line(at, area.y - 4.0, at, area.bottom() + 6.0, INK, 1.6))
                .add(number.set("text-anchor", anchor).set("fill", GREY));
        }
        group
    }
}
