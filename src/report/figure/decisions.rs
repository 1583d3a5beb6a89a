//! The sets as strips, one a delay, and undecidable sets magnified.

use svg::node::element::Group;

use super::canvas::{self, Area, LABEL, NOTE, TICK, WIDTH};
use super::palette::{Color, GREY, INK, WHITE};
use super::scale::Scale;
use crate::eip::{Case, EipSets, Interval, Undecidable};
use crate::report::number::to_uncertainty;
use crate::report::summary;

/// One strip a delay, coloured by winner.
pub(super) struct Strips<'a> {
    pub(super) sets: &'a EipSets,
    pub(super) x: Scale,
    /// Top and horizontal extent; the height follows from the delays.
    pub(super) area: Area,
}

impl Strips<'_> {
    fn row(&self) -> f64 {
        (200.0 / self.sets.cases.len().max(1) as f64).clamp(4.0, 26.0)
    }

    /// Room that the names of the rows take, left of them.
    pub(super) fn names_width(sets: &EipSets) -> f64 {
        if sets.cases.len() < 2 {
            return 0.0;
        }
        let widths = sets.cases.iter().map(|c| canvas::width(&summary::delay(c.delay), NOTE));
        widths.fold(0.0, f64::max) + 16.0
    }

    pub(super) fn height(&self) -> f64 {
        self.row() * self.sets.cases.len() as f64
    }

    pub(super) fn draw(&self) -> Group {
        let several = self.sets.cases.len() > 1;
        let mut group = Group::new();
        let mut free = f64::NEG_INFINITY;
        for (k, case) in self.sets.cases.iter().enumerate() {
            let area = Area { y: self.area.y + k as f64 * self.row(), h: self.row(), ..self.area };
            group = group.add(strip(case, &self.x, area, self.row() > 17.0, &[]));
            if several && area.y + self.row() / 2.0 - free >= NOTE {
                let y = area.y + self.row() / 2.0;
                let text =
                    canvas::text(area.x - 10.0, y + 0.35 * NOTE, NOTE, &summary::delay(case.delay));
                group = group.add(text.set("text-anchor", "end"));
                free = y;
            }
        }
        let all = Area { h: self.height(), ..self.area };
        if several {
            group = group.add(canvas::y_label(24.0, all, if all.h > 48.0 { "delay" } else { "" }));
        } else {
            let y = all.y + all.h / 2.0 + 0.35 * NOTE;
            group =
                group.add(canvas::text(all.x - 10.0, y, NOTE, "winner").set("text-anchor", "end"));
        }
        group.add(all.frame())
    }
}

/// Pixels that a set takes at least: a narrow one must not vanish.
pub(super) fn least(interval: &Interval) -> f64 {
    if interval.from < interval.to { 1.0 } else { 9.0 }
}

/// The sets of one case on `area`, numbered where there is room between the
/// pixel columns `marks`.
pub(super) fn strip(case: &Case, x: &Scale, area: Area, numbered: bool, marks: &[f64]) -> Group {
    let mut group = Group::new();
    for interval in &case.unstable_intervals {
        let part = area.between(x.at(interval.from), x.at(interval.to), 2.0);
        group = group.add(part.rectangle().set("fill", canvas::UNSTABLE));
    }
    for (i, set) in case.sets.iter().enumerate() {
        for interval in set {
            if interval.to < x.from || interval.from > x.to {
                continue;
            }
            let part = area.between(x.at(interval.from), x.at(interval.to), least(interval));
            let color = Color::of(i);
            group = group.add(part.rectangle().set("fill", color));
            let number = (i + 1).to_string();
            let (from, to) = widest(part, marks);
            if numbered && part.h > 14.0 && canvas::width(&number, NOTE) + 4.0 < to - from {
                let y = part.y + part.h / 2.0 + 0.36 * NOTE;
                group = group.add(
                    canvas::centered((from + to) / 2.0, y, NOTE, &number)
                        .set("fill", color.contrast()),
                );
            }
        }
    }
    if area.h > 8.0 {
        let edge = canvas::line(area.x, area.y, area.right(), area.y, WHITE, 1.0);
        group = group.add(edge);
    }
    // seams, so that neighbours of like colour stay apart
    for b in &case.boundaries {
        if (x.from..=x.to).contains(&b.value) {
            let at = x.at(b.value);
            let seam = canvas::line(at, area.y, at, area.bottom(), INK, 1.0);
            group = group.add(seam);
        }
    }
    group
}

/// The widest stretch of `part` that no mark crosses.
fn widest(part: Area, marks: &[f64]) -> (f64, f64) {
    let inside = marks.iter().copied().filter(|m| (part.x..=part.right()).contains(m));
    let cuts: Vec<f64> = [part.x].into_iter().chain(inside).chain([part.right()]).collect();
    let stretches = cuts.windows(2).map(|w| (w[0], w[1]));
    stretches.max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0))).unwrap_or((part.x, part.right()))
}

/// Undecidable sets too narrow for the main panel, each on its own scale.
pub(super) struct Zoom<'a> {
    sets: &'a EipSets,
    shown: Vec<&'a Undecidable>,
    top: f64,
    left: f64,
}

/// Boxes side by side.
const COLUMNS: usize = 3;
/// Boxes in all.
const BOXES: usize = 12;
/// Room between boxes.
const GAP: f64 = 34.0;

impl<'a> Zoom<'a> {
    pub(super) fn new(sets: &'a EipSets, x: &Scale, top: f64, left: f64) -> Self {
        let narrow = |u: &&Undecidable| x.at(u.interval.to) - x.at(u.interval.from) < 24.0;
        let shown = sets.undecidable.iter().filter(narrow).take(BOXES).collect();
        Self { sets, shown, top, left }
    }

    fn row(&self) -> f64 {
        (110.0 / self.sets.cases.len().max(1) as f64).clamp(3.0, 22.0)
    }

    /// Height of a box with its numbers.
    fn cell(&self) -> f64 {
        self.row() * self.sets.cases.len() as f64 + 44.0
    }

    pub(super) fn bottom(&self) -> f64 {
        if self.shown.is_empty() {
            return self.top - 24.0;
        }
        self.top + 22.0 + self.cell() * self.shown.len().div_ceil(COLUMNS) as f64
    }

    pub(super) fn draw(&self) -> Group {
        let mut group = Group::new();
        if self.shown.is_empty() {
            return group;
        }
        let total = self.sets.undecidable.len();
        let heading = if self.shown.len() < total {
            format!("Undecidable sets, magnified ({} of {total})", self.shown.len())
        } else {
            "Undecidable sets, magnified".into()
        };
        group = group.add(canvas::text(self.left, self.top + 4.0, LABEL, &heading));
        let columns = self.shown.len().min(COLUMNS) as f64;
        let w = ((WIDTH - 30.0 - self.left - GAP * (columns - 1.0)) / columns).min(400.0);
        for (k, u) in self.shown.iter().enumerate() {
            let (row, column) = (k / COLUMNS, k % COLUMNS);
            let area = Area {
                x: self.left + column as f64 * (w + GAP),
                y: self.top + 18.0 + row as f64 * self.cell(),
                w,
                h: self.row() * self.sets.cases.len() as f64,
            };
            group = group.add(self.magnified(&u.interval, area, column == 0));
        }
        group
    }

    fn magnified(&self, interval: &Interval, area: Area, first: bool) -> Group {
        let width = interval.to - interval.from;
        let room = if width > 0.0 { 0.7 * width } else { 1e-9 * interval.from.abs().max(1e-300) };
        let x = Scale::new(interval.from - room, interval.to + room, false, area.x, area.right());
        let marks = [x.at(interval.from), x.at(interval.to)];
        let mut group = Group::new();
        let mut free = f64::NEG_INFINITY;
        for (k, case) in self.sets.cases.iter().enumerate() {
            let part = Area { y: area.y + k as f64 * self.row(), h: self.row(), ..area };
            group = group.add(strip(case, &x, part, self.row() > 17.0, &marks));
            let y = part.y + part.h / 2.0;
            if first && y - free >= NOTE {
                let text =
                    canvas::text(part.x - 10.0, y + 0.35 * NOTE, NOTE, &summary::delay(case.delay));
                group = group.add(text.set("text-anchor", "end"));
                free = y;
            }
        }
        group = group.add(area.frame());
        for (v, anchor, shift) in [(interval.from, "end", 14.0), (interval.to, "start", -14.0)] {
            let at = x.at(v);
            let text = to_uncertainty(v, 0.01 * width.abs());
            group =
                group.add(canvas::line(at, area.y - 4.0, at, area.bottom() + 6.0, INK, 1.6)).add(
                    canvas::text(at + shift, area.bottom() + 6.0 + TICK, NOTE, &text)
                        .set("text-anchor", anchor)
                        .set("fill", GREY),
                );
        }
        group
    }
}
