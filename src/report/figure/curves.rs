//! One parameter: Upsilon of each model along the grid, over the sets.

use svg::node::element::{Circle, Definitions, Group, SVG};

use super::canvas::{self, Area, LABEL, NOTE, TICK, TITLE, WIDTH};
use super::decisions;
use super::palette::{self, Color, GREY, INK};
use super::place::spread;
use super::scale::Scale;
use crate::eip::{Case, EipSets, Interval};
use crate::report::number::to_uncertainty;
use crate::report::summary;

/// Height of the main panel.
const MAIN: f64 = 380.0;
/// Height of the margin panel.
const MARGIN: f64 = 84.0;
/// More points than this on a curve are thinned to the extremes of columns.
const DENSE: usize = 2000;
/// With more models than this, losing curves fade and circles are left out.
const CROWD: usize = 24;
/// With more models than this, only winning stretches are drawn.
const THRONG: usize = 200;
/// Losing curves are cut at this multiple of the largest winner.
const HEADROOM: f64 = 300.0;

pub(super) fn draw(sets: &EipSets) -> SVG {
    let case = &sets.cases[0];
    let (name, axis) = &sets.grid.axes()[0];
    let values = axis.values();
    let several = sets.cases.len() > 1;

    let range = upsilon_range(case);
    let y_scale = |start, end| Scale::new(range.low, range.high, range.log, start, end);
    let margin = MarginRange::new(case);
    let numbers = canvas::y_axis_width(&y_scale(MAIN, 0.0), 60.0)
        .max(margin.as_ref().map_or(52.0, |m| canvas::y_axis_width(&m.scale(MARGIN, 0.0), 27.0)));
    let left = 36.0 + numbers.max(decisions::Strips::names_width(sets));
    let labels = curve_labels(sets, case, range.high);
    let widest = labels.iter().map(|l| canvas::width(&l.text, TICK)).fold(0.0, f64::max);
    let number = canvas::width(&sets.models.len().to_string(), TICK) + 8.0;
    let right = if labels.is_empty() { 30.0 } else { widest + number + 32.0 };

    let title = format!("EIP sets of {name}");
    let mut top = 40.0;
    let mut head =
        Group::new().add(canvas::text(left, top, TITLE, &title).set("font-weight", "bold"));
    for text in canvas::wrapped(&subtitle(sets), NOTE, WIDTH - left - 20.0) {
        top += 23.0;
        head = head.add(canvas::text(left, top, NOTE, &text).set("fill", GREY));
    }
    if let Some(marks) = legend(sets, case, left, top + 26.0) {
        top += 26.0;
        head = head.add(marks);
    }

    let x = Scale::of_axis(axis, left, WIDTH - right);
    let boundary_labels = BoundaryLabels::new(case, &x);
    top += 16.0 + boundary_labels.height();
    let main = Area { x: left, y: top, w: WIDTH - right - left, h: MAIN };
    let y = y_scale(main.bottom(), main.y);
    let panel = Panel { sets, case, values: &values, x, y, main };

    let mut body = Group::new().add(panel.bands());
    body = body.add(canvas::x_axis(main, &x, false, true));
    if case.upsilon.iter().any(|u| u.is_finite()) {
        body = body.add(canvas::y_axis(main, &y, 60.0, true));
    }
    body = body.add(panel.unstable(main)).add(panel.undecidable()).add(panel.boundary_lines());
    body = body.add(panel.curves()).add(main.frame());
    if nominals_shown(sets) {
        body = body.add(panel.nominals());
    }
    body = body.add(boundary_labels.draw(main.y));
    body = body.add(panel.direct_labels(&labels, number));
    if case.winner.iter().all(Option::is_none) {
        let note = "no plant has a winner";
        body = body.add(canvas::centered(main.x + main.w / 2.0, main.y + MAIN / 2.0, LABEL, note));
    }
    body = body.add(canvas::y_label(24.0, main, "Upsilon"));

    let strips = decisions::Strips { sets, x, area: Area { y: main.bottom() + 12.0, ..main } };
    body = body.add(strips.draw());
    let mut lowest = Area { h: strips.height(), ..strips.area };
    if let Some(range) = &margin {
        let area = Area { y: lowest.bottom() + 16.0, h: MARGIN, ..main };
        body = body.add(panel.margin(area, range));
        lowest = area;
    }
    body = body.add(canvas::x_axis(lowest, &x, true, false));
    let mut bottom = lowest.bottom() + canvas::NAME;
    body = body.add(canvas::centered(main.x + main.w / 2.0, bottom, LABEL, name));
    if several {
        let zoom = decisions::Zoom::new(sets, &x, bottom + 24.0, left);
        bottom = zoom.bottom();
        body = body.add(zoom.draw());
    }
    let unnamed = case.boundaries.len() - boundary_labels.labels.len();
    for text in notes(sets, labels.len(), unnamed) {
        for part in canvas::wrapped(&text, NOTE, WIDTH - 40.0) {
            bottom += 24.0;
            body = body.add(canvas::text(20.0, bottom, NOTE, &part).set("fill", GREY));
        }
    }
    canvas::page(bottom + 22.0, &title)
        .add(Definitions::new().add(canvas::clip("panel", main)))
        .add(head)
        .add(body)
}

fn subtitle(sets: &EipSets) -> String {
    let mut parts = vec![
        summary::count(sets.models.len(), "model"),
        summary::count(sets.grid.len(), "plant"),
        summary::convention(sets.convention),
    ];
    match sets.cases.as_slice() {
        [only] if only.delay == 0.0 => {}
        [only] => parts.push(format!("actuator delay {}", summary::delay(only.delay))),
        [first, ..] => parts.push(format!(
            "{} (curves: delay {})",
            summary::count(sets.cases.len(), "actuator delay"),
            summary::delay(first.delay),
        )),
        [] => {}
    }
    parts.join(", ")
}

/// What the marks mean, for the marks that occur.
fn legend(sets: &EipSets, case: &Case, left: f64, y: f64) -> Option<Group> {
    let mut group = Group::new();
    let mut x = left;
    let mut entry = |group: Group, mark: Group, text: &str| {
        let group = group
            .add(mark.set("transform", format!("translate({} {})", canvas::px(x), canvas::px(y))))
            .add(canvas::text(x + 30.0, y, NOTE, text));
        x += 30.0 + canvas::width(text, NOTE) + 22.0;
        group
    };
    let swatch = |fill: &str| {
        let area = Area { x: 0.0, y: -12.0, w: 22.0, h: 14.0 };
        Group::new().add(area.frame().set("fill", fill))
    };
    if nominals_shown(sets) && nominal_points(sets, case).next().is_some() {
        group = entry(group, Group::new().add(marker(11.0, -5.0, INK)), "nominal value");
    }
    if !case.boundaries.is_empty() {
        let mark = canvas::line(11.0, -14.0, 11.0, 3.0, INK, 1.4);
        group = entry(group, Group::new().add(mark), "boundary");
    }
    if !sets.undecidable.is_empty() {
        group = entry(group, swatch(canvas::UNDECIDABLE), "undecidable");
    }
    if !case.unstable.is_empty() {
        group = entry(group, swatch(canvas::UNSTABLE), "unstable loop");
    }
    (x > left).then_some(group)
}

/// Circles of many models would be a band of their own.
fn nominals_shown(sets: &EipSets) -> bool {
    sets.models.len() <= CROWD
}

fn marker(x: f64, y: f64, color: Color) -> Circle {
    Circle::new()
        .set("cx", canvas::px(x))
        .set("cy", canvas::px(y))
        .set("r", 5)
        .set("fill", "#ffffff")
        .set("stroke", color)
        .set("stroke-width", 2.4)
}

fn notes(sets: &EipSets, labelled: usize, unnamed: usize) -> Vec<String> {
    let mut notes = Vec::new();
    let failed: Vec<usize> =
        (0..sets.models.len()).filter(|&i| sets.models[i].failure.is_some()).collect();
    if !failed.is_empty() {
        notes.push(format!("Not drawn, unusable: model {}.", summary::numbers(&failed, ", ")));
    }
    for (i, model) in sets.models.iter().enumerate() {
        if let Some(first) = model.duplicate_of {
            notes.push(format!("Model {} has the same observer as model {}.", i + 1, first + 1));
        }
    }
    let drawn = sets.models.len() - failed.len();
    if labelled > 0 && labelled < drawn {
        notes.push(format!("{labelled} of {drawn} curves are labelled."));
    }
    if sets.models.len() > THRONG {
        notes.push("Curves are drawn where they win.".into());
    }
    if unnamed > 0 {
        notes.push(format!("{unnamed} boundaries are in the text and JSON results."));
    }
    if notes.len() > 4 {
        notes.truncate(3);
        notes.push("More notes are in the text and JSON results.".into());
    }
    notes
}

struct UpsilonRange {
    low: f64,
    high: f64,
    log: bool,
}

/// Range of the vertical axis: all winners, and losers as long as they do not
/// press the winners flat.
fn upsilon_range(case: &Case) -> UpsilonRange {
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

/// Range of the margin panel.
struct MarginRange {
    low: f64,
    high: f64,
    log: bool,
}

impl MarginRange {
    /// `None` if there is no margin to show.
    fn new(case: &Case) -> Option<Self> {
        let mut margins: Vec<f64> =
            case.margin.iter().copied().filter(|m| m.is_finite() && *m > 0.0).collect();
        margins.sort_by(f64::total_cmp);
        let high = *margins.last()?;
        let quantile = |q: f64| margins[((margins.len() - 1) as f64 * q) as usize];
        if case.margin.len() < 2 {
            return None;
        }
        if quantile(0.5) > 0.06 * high {
            return Some(Self { low: 0.0, high: 1.08 * high, log: false });
        }
        // half of the plants would hug the axis; the dips to zero are cut
        let low = (0.3 * quantile(0.1)).max(1e-6 * high);
        Some(Self { low, high: 1.5 * high, log: true })
    }

    fn scale(&self, start: f64, end: f64) -> Scale {
        Scale::new(self.low, self.high, self.log, start, end)
    }
}

/// The nominal value and Upsilon of each model that lies on the grid.
fn nominal_points<'a>(
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

/// The label of a curve and the last plant where it can be seen.
struct CurveLabel {
    model: usize,
    text: String,
    plant: usize,
}

/// A label for every curve with a point not above `high`, as far as they fit.
fn curve_labels(sets: &EipSets, case: &Case, high: f64) -> Vec<CurveLabel> {
    let n = sets.models.len();
    let all = (0..n).filter(|&i| sets.models[i].failure.is_none()).filter_map(|i| {
        let plant = (0..case.winner.len()).rev().find(|p| case.upsilon[p * n + i] <= high)?;
        let text = canvas::fitted(&summary::short_name(sets, i), TICK, 196.0);
        Some(CurveLabel { model: i, text, plant })
    });
    let mut labels: Vec<CurveLabel> = all.collect();
    let room = (MAIN / (TICK + 2.0)) as usize;
    if labels.len() > room {
        labels.retain(|l| case.sets.get(l.model).is_some_and(|s| !s.is_empty()));
    }
    if labels.len() > room {
        let every = labels.len().div_ceil(room);
        let mut k = 0;
        labels.retain(|_| {
            k += 1;
            (k - 1) % every == 0
        });
    }
    labels
}

/// Values of the boundaries above the panel.
struct BoundaryLabels {
    /// Pixel of the boundary, centre of its label, text.
    labels: Vec<(f64, f64, String)>,
    turned: bool,
}

impl BoundaryLabels {
    fn new(case: &Case, x: &Scale) -> Self {
        let digits = (x.to - x.from).abs() * 1e-4;
        let wanted: Vec<f64> = case.boundaries.iter().map(|b| x.at(b.value)).collect();
        let texts: Vec<String> =
            case.boundaries.iter().map(|b| to_uncertainty(b.value, digits)).collect();
        let place = |sizes: Vec<f64>| spread(&wanted, &sizes, x.start - 30.0, x.end + 30.0);
        let flat = place(texts.iter().map(|t| canvas::width(t, NOTE) + 8.0).collect());
        let (centers, turned) = match flat {
            Some(centers) => (Some(centers), false),
            None => (place(vec![NOTE + 2.0; texts.len()]), true),
        };
        let labels = match centers {
            Some(c) => wanted.iter().copied().zip(c).zip(texts).map(|((w, c), t)| (w, c, t)),
            None => return Self { labels: Vec::new(), turned: false },
        };
        Self { labels: labels.collect(), turned }
    }

    fn height(&self) -> f64 {
        if self.labels.is_empty() {
            0.0
        } else if self.turned {
            16.0 + self.longest()
        } else {
            34.0
        }
    }

    fn longest(&self) -> f64 {
        self.labels.iter().map(|l| canvas::width(&l.2, NOTE)).fold(0.0, f64::max)
    }

    /// Labels above pixel row `top`, each tied to its boundary.
    fn draw(&self, top: f64) -> Group {
        let mut group = Group::new();
        for (wanted, center, text) in &self.labels {
            let tie =
                canvas::polyline([(*wanted, top), (*wanted, top - 4.0), (*center, top - 12.0)]);
            if let Some(tie) = tie {
                group = group.add(tie.set("stroke", INK).set("stroke-width", 1));
            }
            group = group.add(if self.turned {
                let x = center + 0.35 * NOTE;
                canvas::text(x, top - 15.0, NOTE, text).set(
                    "transform",
                    format!("rotate(-90 {} {})", canvas::px(x), canvas::px(top - 15.0)),
                )
            } else {
                canvas::centered(*center, top - 16.0, NOTE, text)
            });
        }
        group
    }
}

/// The main panel with what it shows.
struct Panel<'a> {
    sets: &'a EipSets,
    case: &'a Case,
    values: &'a [f64],
    x: Scale,
    y: Scale,
    main: Area,
}

impl Panel<'_> {
    /// The sets, pale, behind everything.
    fn bands(&self) -> Group {
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
    fn unstable(&self, area: Area) -> Group {
        self.case.unstable_intervals.iter().fold(Group::new(), |group, interval| {
            let area = self.stretch(interval, area, 3.0);
            group.add(area.rectangle().set("fill", canvas::UNSTABLE))
        })
    }

    fn undecidable(&self) -> Group {
        self.sets.undecidable.iter().fold(Group::new(), |group, undecidable| {
            let area = self.stretch(&undecidable.interval, self.main, 5.0);
            group.add(area.rectangle().set("fill", canvas::UNDECIDABLE))
        })
    }

    fn stretch(&self, interval: &Interval, area: Area, least: f64) -> Area {
        area.between(self.x.at(interval.from), self.x.at(interval.to), least)
    }

    /// Upsilon of every model, thick where it wins.
    fn curves(&self) -> Group {
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

    fn points(&self, model: usize) -> Vec<(f64, f64)> {
        let n = self.sets.models.len();
        let at = |plant: usize| self.y.at(self.case.upsilon[plant * n + model]);
        self.values.iter().enumerate().map(|(plant, v)| (self.x.at(*v), at(plant))).collect()
    }

    fn boundary_lines(&self) -> Group {
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

    fn nominals(&self) -> Group {
        nominal_points(self.sets, self.case)
            .filter(|(_, _, u)| (self.y.from..=self.y.to).contains(u))
            .fold(Group::new(), |group, (i, value, u)| {
                group.add(marker(self.x.at(value), self.y.at(u), Color::of(i).ink()))
            })
    }

    /// A label at the right end of each curve.
    fn direct_labels(&self, labels: &[CurveLabel], number: f64) -> Group {
        let n = self.sets.models.len();
        let end = |l: &CurveLabel| {
            let u = self.case.upsilon[l.plant * n + l.model];
            // a curve that goes on above the panel leaves it at the top
            let next = self.case.upsilon.get((l.plant + 1) * n + l.model);
            let above = next.is_some_and(|next| next.is_finite());
            let y = if above { self.main.y } else { self.y.at(u) };
            (self.x.at(self.values[l.plant]), y.clamp(self.main.y, self.main.bottom()))
        };
        let mut order: Vec<&CurveLabel> = labels.iter().collect();
        // from the top; of those that left it there the first one stands highest
        order.sort_by(|a, b| {
            let (ends, models) = ((end(a), end(b)), (a.model, b.model));
            let by_y = ends.0.1.total_cmp(&ends.1.1);
            by_y.then(ends.0.0.total_cmp(&ends.1.0)).then(models.0.cmp(&models.1))
        });
        let wanted: Vec<f64> = order.iter().map(|l| end(l).1).collect();
        let sizes = vec![TICK + 2.0; wanted.len()];
        let Some(centers) = spread(&wanted, &sizes, self.main.y - 8.0, self.main.bottom() + 8.0)
        else {
            return Group::new();
        };
        let mut group = Group::new();
        for (label, y) in order.iter().zip(centers) {
            let color = Color::of(label.model);
            let (x, from) = end(label);
            let right = self.main.right();
            if let Some(tie) = canvas::polyline([(x, from), (right + 4.0, from), (right + 14.0, y)])
            {
                let tie = tie.set("stroke", color).set("stroke-width", 1.2);
                group = group.add(if x < right - 2.0 {
                    tie.set("stroke-dasharray", "2 4")
                } else {
                    tie
                });
            }
            let base = y + 0.35 * TICK;
            let text =
                |x, content: &str| canvas::text(x, base, TICK, content).set("fill", color.ink());
            let index = (label.model + 1).to_string();
            group = group
                .add(text(right + 18.0, &index).set("font-weight", "bold"))
                .add(text(right + 18.0 + number, &label.text));
        }
        group
    }

    /// The margin to the runner-up, in the colour of the winner.
    fn margin(&self, area: Area, range: &MarginRange) -> Group {
        let y = range.scale(area.bottom(), area.y);
        let mut group = Group::new().add(canvas::y_axis(area, &y, 27.0, true));
        let points: Vec<(f64, f64)> = (self.values.iter().zip(&self.case.margin))
            .map(|(v, m)| (self.x.at(*v), y.at(m.clamp(range.low, f64::INFINITY))))
            .collect();
        for (i, set) in self.case.sets.iter().enumerate() {
            for interval in set {
                let ends = [interval.from, interval.to].map(|v| {
                    let boundary = self.case.boundaries.iter().any(|b| b.value == v);
                    (self.x.at(v), boundary)
                });
                let mut inside = cut(&points, ends[0].0, ends[1].0);
                inside.retain(|p| p.1.is_finite());
                let (Some(&first), Some(&last)) = (inside.first(), inside.last()) else { continue };
                // the margin is zero at a boundary, which is no grid point
                let start = if ends[0].1 { (ends[0].0, area.bottom()) } else { first };
                let stop = if ends[1].1 { (ends[1].0, area.bottom()) } else { last };
                if ends[0].1 {
                    inside.insert(0, start);
                }
                if ends[1].1 {
                    inside.push(stop);
                }
                let inside = thinned(&inside, area.x);
                let color = Color::of(i);
                let outline = [(start.0, area.bottom())].into_iter().chain(inside.iter().copied());
                if let Some(path) = canvas::polyline(outline.chain([(stop.0, area.bottom())])) {
                    group = group.add(path.set("fill", color.pale(0.6)));
                }
                if let Some(path) = canvas::polyline(inside) {
                    group = group.add(path.set("stroke", color).set("stroke-width", 1.8));
                }
            }
        }
        group = group.add(self.unstable(area)).add(area.frame());
        group.add(canvas::y_label(24.0, area, "margin"))
    }
}

/// The part of a curve between two pixel columns, ends interpolated.
fn cut(points: &[(f64, f64)], from: f64, to: f64) -> Vec<(f64, f64)> {
    let first = points.partition_point(|p| p.0 < from);
    let last = points.partition_point(|p| p.0 <= to);
    let at = |x: f64, k: usize| {
        let (a, b) = (points.get(k.checked_sub(1)?)?, points.get(k)?);
        let share = (x - a.0) / (b.0 - a.0);
        let y = a.1 + share * (b.1 - a.1);
        y.is_finite().then_some((x, y))
    };
    let mut inside: Vec<(f64, f64)> = Vec::with_capacity(last.saturating_sub(first) + 2);
    if points.get(first).is_some_and(|p| p.0 > from) {
        inside.extend(at(from, first));
    }
    if first < last {
        inside.extend(&points[first..last]);
    }
    if last > 0 && points[last - 1].0 < to {
        inside.extend(at(to, last));
    }
    inside
}

/// A long curve reduced to the extremes of columns a pixel wide.
fn thinned(points: &[(f64, f64)], left: f64) -> Vec<(f64, f64)> {
    if points.len() <= DENSE {
        return points.to_vec();
    }
    let column = |p: &(f64, f64)| (p.0 - left).floor();
    let mut thin = Vec::new();
    for chunk in points.chunk_by(|a, b| column(a) == column(b) && a.1.is_nan() == b.1.is_nan()) {
        let (mut low, mut high) = (0, 0);
        for (k, p) in chunk.iter().enumerate() {
            if p.1 < chunk[low].1 {
                low = k;
            }
            if p.1 > chunk[high].1 {
                high = k;
            }
        }
        let mut keep = [0, low, high, chunk.len() - 1];
        keep.sort_unstable();
        let mut last = None;
        for k in keep {
            if last != Some(k) {
                thin.push(chunk[k]);
            }
            last = Some(k);
        }
    }
    thin
}
