//! Panels of curves, bands and dots below each other.

use svg::node::element::{Group, Path, SVG};

use super::canvas::{self, Area, LABEL, NOTE, TITLE, WIDTH};
use super::palette::{Color, GREY, INK};
use super::scale::Scale;
use super::trace::thinned;
use crate::report::timeline::{Layer, Panel, Stack};

/// Height of a panel when there are few and when there are many.
const TALL: f64 = 190.0;
const LOW: f64 = 120.0;
/// Room between two numbers of a vertical axis.
const TICKS: f64 = 28.0;
/// Opacity of the bands.
pub(super) const WIDE: f64 = 0.16;
pub(super) const NARROW: f64 = 0.26;
/// Share of the edge of a band that may lie outside of a panel, at either end.
const RARE: f64 = 0.05;
/// Most dots of a panel.
const MANY: usize = 2000;
/// Of a dot.
const RADIUS: f64 = 2.0;

/// Draws the panels over one time axis.
pub(super) fn draw(run: &Stack) -> SVG {
    let height = (900.0 / run.panels.len().max(1) as f64).clamp(LOW, TALL);
    let ranges: Vec<(f64, f64)> = run.panels.iter().map(range).collect();
    let numbers = ranges
        .iter()
        .map(|r| canvas::y_axis_width(&Scale::new(r.0, r.1, false, height, 0.0), TICKS))
        .fold(52.0, f64::max);
    let (left, right) = (36.0 + numbers, WIDTH - 24.0);
    let room = right - left;
    let title = canvas::fitted(&run.title, TITLE * 1.1, room);
    let mut top = 40.0;
    let mut body =
        Group::new().add(canvas::text(left, top, TITLE, &title).set("font-weight", "bold"));
    for text in canvas::wrapped(&run.subtitle, NOTE, room) {
        top += 23.0;
        body = body.add(canvas::text(left, top, NOTE, &text).set("fill", GREY));
    }
    let (key, bottom) = key(run, left, top + 24.0, right);
    body = body.add(key);
    top = bottom + 18.0;
    let (from, to) = match (run.t.first(), run.t.last()) {
        (Some(&a), Some(&b)) => (a, b),
        _ => (0.0, 1.0),
    };
    let x = Scale::new(from, to, false, left, right);
    for (k, (panel, range)) in run.panels.iter().zip(&ranges).enumerate() {
        let area = Area { x: left, y: top, w: room, h: height };
        body = body.add(draw_panel(run, panel, *range, area, &x, k + 1 == run.panels.len()));
        top = area.bottom() + 14.0;
    }
    let middle = (left + right) / 2.0;
    body = body.add(canvas::centered(middle, top + 42.0, LABEL, &run.time));
    canvas::page(top + 62.0, &title).add(body)
}

/// Swatches with their meaning in rows that fit; also where they end.
fn key(run: &Stack, left: f64, top: f64, right: f64) -> (Group, f64) {
    let mut group = Group::new();
    let (mut x, mut y) = (left, top);
    for (layer, text) in &run.key {
        let wide = 42.0 + canvas::width(text, NOTE);
        if x > left && x + wide > right {
            (x, y) = (left, y + 22.0);
        }
        let area = Area { x, y: y - 12.0, w: 26.0, h: 14.0 };
        let middle = area.y + 7.0;
        group = match layer {
            Layer::Wide(..) => group.add(swatch(area, WIDE)),
            Layer::Narrow(..) => group.add(swatch(area, WIDE + NARROW)),
            Layer::Truth(_) => group.add(canvas::line(x, middle, x + 26.0, middle, GREY, 3.0)),
            Layer::Estimate(_) => {
                group.add(canvas::line(x, middle, x + 26.0, middle, Color::of(0), 2.2))
            }
            Layer::Dots(_) => group.add(dots(&[5.0, 13.0, 21.0].map(|at| (x + at, middle)))),
            Layer::Level(_) => {
                let line = canvas::line(x, middle, x + 26.0, middle, GREY, 1.4);
                group.add(line.set("stroke-dasharray", "5 4"))
            }
        };
        group = group.add(canvas::text(x + 33.0, y, NOTE, text));
        x += wide + 14.0;
    }
    (group, if run.key.is_empty() { top - 24.0 } else { y })
}

fn swatch(area: Area, opacity: f64) -> svg::node::element::Rectangle {
    area.rectangle().set("fill", Color::of(0)).set("fill-opacity", opacity)
}

/// Dots, smaller where there are many, as points of one path.
fn dots(points: &[(f64, f64)]) -> Path {
    let mut d = String::new();
    let finite = points.iter().filter(|p| p.0.is_finite() && p.1.is_finite());
    for (x, y) in finite {
        d.push_str(&format!("M{} {}h0.01", canvas::px(*x), canvas::px(*y)));
    }
    let radius =
        (RADIUS * (600.0 / points.len().max(1) as f64).sqrt()).clamp(0.45 * RADIUS, RADIUS);
    Path::new()
        .set("d", d)
        .set("fill", "none")
        .set("stroke", INK)
        .set("stroke-opacity", 0.55)
        .set("stroke-width", canvas::px(2.0 * radius))
        .set("stroke-linecap", "round")
}

/// Range of the numbers of a panel, with some room. Around dots a band that is
/// wide now and then (a filter that starts from nothing) is cut.
fn range(panel: &Panel) -> (f64, f64) {
    let dots = panel.layers.iter().any(|layer| matches!(layer, Layer::Dots(_)));
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut take = |values: &[f64], share: f64| {
        let mut all: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        all.sort_by(f64::total_cmp);
        let cut = (share * all.len() as f64) as usize;
        if let [first, .., last] | [first @ last] = &all[cut..all.len() - cut] {
            (low, high) = (low.min(*first), high.max(*last));
        }
    };
    for layer in &panel.layers {
        match layer {
            Layer::Wide(a, b) | Layer::Narrow(a, b) => {
                let share = if dots { RARE } else { 0.0 };
                take(a, share);
                take(b, share);
            }
            Layer::Truth(v) | Layer::Estimate(v) | Layer::Dots(v) => take(v, 0.0),
            Layer::Level(v) => take(&[*v], 0.0),
        }
    }
    if low > high {
        return (0.0, 1.0);
    }
    let room = 0.06 * (high - low);
    (low - room, high + room)
}

fn draw_panel(
    run: &Stack,
    panel: &Panel,
    (low, high): (f64, f64),
    area: Area,
    x: &Scale,
    numbers: bool,
) -> Group {
    let y = Scale::new(low, high, false, area.bottom(), area.y);
    let mut group = Group::new()
        .add(canvas::x_axis(area, x, numbers, true))
        .add(canvas::y_axis(area, &y, TICKS, true));
    let points = |values: &[f64]| -> Vec<(f64, f64)> {
        let points: Vec<(f64, f64)> =
            run.t.iter().zip(values).map(|(t, v)| (x.at(*t), y.at(*v))).collect();
        thinned(&points, area.x)
    };
    let clip = format!("panel-{}", area.y.round());
    let mut marks = Group::new().set("clip-path", format!("url(#{clip})"));
    group = group.add(canvas::clip(&clip, area));
    for layer in &panel.layers {
        marks = match layer {
            Layer::Wide(a, b) => marks.add(band(&points(a), &points(b), Color::of(0), WIDE)),
            Layer::Narrow(a, b) => marks.add(band(&points(a), &points(b), Color::of(0), NARROW)),
            Layer::Truth(v) => curve(marks, &points(v), GREY, 3.0),
            Layer::Estimate(v) => curve(marks, &points(v), Color::of(0), 1.8),
            Layer::Dots(v) => {
                // every so many: the extremes alone would tell of more than there is
                let stride = v.len().div_ceil(MANY).max(1);
                let pairs = run.t.iter().zip(v).step_by(stride);
                let points: Vec<(f64, f64)> = pairs.map(|(t, v)| (x.at(*t), y.at(*v))).collect();
                marks.add(dots(&points))
            }
            Layer::Level(v) => {
                let line = canvas::line(area.x, y.at(*v), area.right(), y.at(*v), GREY, 1.2);
                marks.add(line.set("stroke-dasharray", "5 4"))
            }
        };
    }
    let size = if canvas::width(&panel.name, LABEL) > area.h { NOTE } else { LABEL };
    let name = canvas::fitted(&panel.name, size, area.h + 12.0);
    let label = canvas::y_label(24.0, area, &name).set("font-size", size);
    group.add(marks).add(area.frame()).add(label)
}

fn curve(group: Group, points: &[(f64, f64)], color: Color, thickness: f64) -> Group {
    match canvas::polyline(points.iter().copied()) {
        Some(path) => group.add(path.set("stroke", color).set("stroke-width", thickness)),
        None => group,
    }
}

/// The area between two curves, with gaps where one has none.
pub(super) fn band(low: &[(f64, f64)], high: &[(f64, f64)], color: Color, opacity: f64) -> Group {
    let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
    let mut group = Group::new();
    // curves that are thinned differ in their points, and have no gaps to speak of
    let alike = low.len() == high.len();
    let gap = |k: usize| !(finite(&low[k]) && finite(&high[k]));
    let mut from = 0;
    while from < low.len() {
        let to = if alike {
            (from..low.len()).find(|k| gap(*k)).unwrap_or(low.len())
        } else {
            low.len()
        };
        let end = if alike { to } else { high.len() };
        let outline = low[from..to].iter().chain(high[from..end].iter().rev()).copied();
        if to > from
            && let Some(path) = canvas::polyline(outline.filter(finite))
        {
            group = group.add(path.set("fill", color).set("fill-opacity", opacity));
        }
        from = to + 1;
    }
    group
}
