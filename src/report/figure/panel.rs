//! The main panel: bands, hatches, curves, nominal values.

use svg::node::element::{Circle, Group};

use super::canvas::{self, Area};
use super::decisions;
use super::palette::{self, Color, GREY, INK};
use super::scale::Scale;
use super::trace::{cut, thinned};
use crate::eip::{Case, EipSets, Interval};
use crate::report::summary;

/// With more models than this, losing curves fade and circles are left out.
pub(super) const CROWD: usize = 24;
/// With more models than this, only winning stretches are drawn.
pub(super) const THRONG: usize = 200;
/// Losing curves are cut at this multiple of the largest winner.
const HEADROOM: f64 = 300.0;

pub(super) struct UpsilonRange {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) log: bool,
}

/// Range of the vertical axis: all winners, and losers as long as they do not
/// press the winners flat.
pub(super) fn upsilon_range(case: &Case) -> UpsilonRange {
    let extremes = |values: &mut dyn Iterator<Item = f64>| {
        values
            .filter(|u| u.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), u| (l.min(u), h.max(u)))
    };
    let n = case.upsilon.len() / case.winner.len().max(1);
    let (low, high) = extremes(&mut case.upsilon.iter().copied());
    if low > high {
        return UpsilonRange { low: 0.0, high: 1.0, log: false };
    }
    let winning = case.winner.iter().enumerate();
    let (best, worst) =
        extremes(&mut winning.filter_map(|(plant, w)| w.map(|i| case.upsilon[plant * n + i])));
    if low > 0.0 && high > 20.0 * low {
        let high = high.min(worst.max(low) * HEADROOM);
        let room = (high / low).powf(0.04);
        return UpsilonRange { low: low / room, high: high * room, log: true };
    }
    let high = if worst > best { high.min(worst + 5.0 * (worst - best)) } else { high };
    let room = if high > low { 0.05 * (high - low) } else { 0.5 * high.abs().max(1.0) };
    UpsilonRange { low: low - room, high: high + room, log: false }
}

/// The nominal value and Upsilon of each model that lies on the grid.
pub(super) fn nominal_points<'a>(
    sets: &'a EipSets,
    case: &'a Case,
) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
    let (name, axis) = &sets.grid.axes()[0];
    let (from, to) = summary::ends(axis);
    let column = sets.parameters.iter().position(|p| p == name);
    let values = axis.values();
    let n = sets.models.len();
    sets.models.iter().enumerate().filter_map(move |(i, model)| {
        let value = *model.values.get(column?)?;
        if !(from..=to).contains(&value) || from == to {
            return None;
        }
        let after = values.partition_point(|v| *v < value).clamp(1, values.len() - 1);
        let (a, b) = (values[after - 1], values[after]);
        let share = (value - a) / (b - a);
        let at = |plant: usize| case.upsilon[plant * n + i];
        let u = at(after - 1) * (1.0 - share) + at(after) * share;
        u.is_finite().then_some((i, value, u))
    })
}

pub(super) fn marker(x: f64, y: f64, color: Color) -> Circle {
    Circle::new()
        .set("cx", canvas::px(x))
        .set("cy", canvas::px(y))
        .set("r", 5)
        .set("fill", "#ffffff")
        .set("stroke", color)
        .set("stroke-width", 2.4)
}

/// The main panel with what it shows.
pub(super) struct Panel<'a> {
    pub(super) sets: &'a EipSets,
    pub(super) case: &'a Case,
    pub(super) values: &'a [f64],
    pub(super) x: Scale,
    pub(super) y: Scale,
    pub(super) main: Area,
}

impl Panel<'_> {
    /// The sets, pale, behind everything.
    pub(super) fn bands(&self) -> Group {
        let mut group = Group::new();
        for (i, set) in self.case.sets.iter().enumerate() {
            for interval in set {
                let area = self.stretch(interval, self.main, decisions::least(interval));
                group = group.add(area.rectangle().set("fill", Color::of(i).pale(0.86)));
            }
        }
        group
    }

    /// Unstable stretches over `area`.
    pub(super) fn unstable(&self, area: Area) -> Group {
        self.case.unstable_intervals.iter().fold(Group::new(), |group, interval| {
            let area = self.stretch(interval, area, 3.0);
            group.add(area.rectangle().set("fill", canvas::UNSTABLE))
        })
    }

    pub(super) fn undecidable(&self) -> Group {
        self.sets.undecidable.iter().fold(Group::new(), |group, undecidable| {
            let area = self.stretch(&undecidable.interval, self.main, 5.0);
            group.add(area.rectangle().set("fill", canvas::UNDECIDABLE))
        })
    }

    pub(super) fn stretch(&self, interval: &Interval, area: Area, least: f64) -> Area {
        area.between(self.x.at(interval.from), self.x.at(interval.to), least)
    }

    /// Upsilon of every model, thick where it wins.
    pub(super) fn curves(&self) -> Group {
        let mut group = Group::new().set("clip-path", "url(#panel)");
        for i in 0..self.sets.models.len() {
            let points: Vec<(f64, f64)> = self.points(i);
            let color = Color::of(i);
            if self.sets.models.len() <= THRONG
                && let Some(path) = canvas::polyline(thinned(&points, self.main.x))
            {
                let crowd = self.sets.models.len() > CROWD;
                let (color, thickness) = if crowd { (color.pale(0.6), 1.0) } else { (color, 1.8) };
                let mut path = path.set("stroke", color).set("stroke-width", thickness);
                if let Some(dash) = palette::dash(i) {
                    path = path.set("stroke-dasharray", dash);
                }
                group = group.add(path);
            }
            for interval in self.case.sets.get(i).into_iter().flatten() {
                let (from, to) = (self.x.at(interval.from), self.x.at(interval.to));
                let inside = cut(&points, from, to);
                if let Some(path) = canvas::polyline(thinned(&inside, self.main.x)) {
                    group = group.add(path.set("stroke", color).set("stroke-width", 4));
                }
            }
            // a lone plant has no line
            if let [(x, y)] = points.as_slice()
                && y.is_finite()
            {
                group = group.add(marker(*x, *y, color).set("fill", color));
            }
        }
        group
    }

    pub(super) fn points(&self, model: usize) -> Vec<(f64, f64)> {
        let n = self.sets.models.len();
        let at = |plant: usize| self.y.at(self.case.upsilon[plant * n + model]);
        self.values.iter().enumerate().map(|(plant, v)| (self.x.at(*v), at(plant))).collect()
    }

    pub(super) fn boundary_lines(&self) -> Group {
        let crowd = self.case.boundaries.len() > CROWD;
        let (color, thickness) = if crowd { (GREY, 0.5) } else { (INK, 1.0) };
        let mut group = Group::new();
        for b in &self.case.boundaries {
            let x = self.x.at(b.value);
            let (top, bottom) = (self.main.y, self.main.bottom());
            group = group.add(canvas::line(x, top, x, bottom, color, thickness));
        }
        group
    }

    pub(super) fn nominals(&self) -> Group {
        nominal_points(self.sets, self.case)
            .filter(|(_, _, u)| (self.y.from..=self.y.to).contains(u))
            .fold(Group::new(), |group, (i, value, u)| {
                group.add(marker(self.x.at(value), self.y.at(u), Color::of(i).ink()))
            })
    }
}
