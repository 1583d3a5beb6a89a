//! The weights of a bank along a record, and the parameters that follow.

use svg::node::element::{Group, SVG};

use super::canvas::{self, Area, LABEL, NOTE, TICK, TITLE, WIDTH};
use super::palette::{Color, GREY, dash};
use super::place::spread;
use super::scale::Scale;
use super::stack::{NARROW, WIDE, band};
use super::trace::thinned;
use crate::report::timeline::{Bands, Timeline, Track};

/// Height of the panel of weights, and of one parameter.
const WEIGHTS: f64 = 300.0;
const PARAMETER: f64 = 170.0;
/// Parameters that are drawn.
const TRACKS: usize = 4;
/// Models with a colour and a label; the others are drawn in grey.
const NAMED: usize = 10;
/// Of these, those whose weight reached this share of the largest one.
const SHARE: f64 = 0.05;

/// Draws weights and parameters below each other over one time axis.
pub(super) fn draw(run: &Timeline) -> SVG {
    let named = named(run);
    let names: Vec<String> = named
        .iter()
        .map(|&i| canvas::fitted(&format!("{}  {}", i + 1, run.labels[i]), TICK, 190.0))
        .collect();
    let widest = names.iter().map(|n| canvas::width(n, TICK)).fold(0.0, f64::max);
    let tracks: Vec<&Track> = run.parameters.iter().take(TRACKS).collect();
    let ranges: Vec<(f64, f64)> = tracks.iter().map(|t| range(t)).collect();
    let numbers = ranges
        .iter()
        .map(|r| canvas::y_axis_width(&Scale::new(r.0, r.1, false, PARAMETER, 0.0), 40.0))
        .fold(52.0, f64::max);
    let (left, right) = (36.0 + numbers, WIDTH - widest - 30.0);

    let room = WIDTH - left - 20.0;
    let title = canvas::fitted(&run.title, TITLE * 1.1, room);
    let mut top = 40.0;
    let mut body =
        Group::new().add(canvas::text(left, top, TITLE, &title).set("font-weight", "bold"));
    for text in canvas::wrapped(&run.subtitle, NOTE, room) {
        top += 23.0;
        body = body.add(canvas::text(left, top, NOTE, &text).set("fill", GREY));
    }
    top += 20.0;

    let (from, to) = match (run.t.first(), run.t.last()) {
        (Some(&a), Some(&b)) => (a, b),
        _ => (0.0, 1.0),
    };
    let x = Scale::new(from, to, false, left, right);
    let panels = 1 + tracks.len();
    let area = Area { x: left, y: top, w: right - left, h: WEIGHTS };
    body = body.add(weights(run, &named, &names, area, &x, panels == 1));
    let mut bottom = area.bottom();
    for (k, (track, range)) in tracks.iter().zip(&ranges).enumerate() {
        let area = Area { x: left, y: bottom + 16.0, w: right - left, h: PARAMETER };
        body = body.add(parameter(run, track, *range, area, &x, k + 2 == panels));
        bottom = area.bottom();
    }
    let middle = (left + right) / 2.0;
    body = body.add(canvas::centered(middle, bottom + 56.0, LABEL, &run.time));
    canvas::page(bottom + 78.0, &title).add(body)
}

/// The models of large weight at some time, in their order.
fn named(run: &Timeline) -> Vec<usize> {
    let peak = |i: usize| run.p[i].iter().fold(0.0_f64, |m, v| m.max(*v));
    let mut order: Vec<usize> = (0..run.p.len()).collect();
    // stable: of equals the first
    order.sort_by(|&i, &j| peak(j).total_cmp(&peak(i)));
    order.truncate(NAMED);
    let top = order.first().map_or(0.0, |&i| peak(i));
    order.retain(|&i| run.p.len() <= 6 || peak(i) >= SHARE.max(0.25 * top));
    order.sort_unstable();
    order
}

fn weights(
    run: &Timeline,
    named: &[usize],
    names: &[String],
    area: Area,
    x: &Scale,
    numbers: bool,
) -> Group {
    let y = Scale::new(0.0, 1.0, false, area.bottom(), area.y);
    let mut group = Group::new()
        .add(canvas::x_axis(area, x, numbers, true))
        .add(canvas::y_axis(area, &y, 40.0, true));
    let points = |values: &[f64]| -> Vec<(f64, f64)> {
        let points: Vec<(f64, f64)> =
            run.t.iter().zip(values).map(|(t, p)| (x.at(*t), y.at(*p))).collect();
        thinned(&points, area.x)
    };
    let curve = |i: usize| canvas::polyline(points(&run.p[i]));
    for (k, &i) in named.iter().enumerate() {
        let Some(Bands([low, quarter, three, high])) = run.bands.get(i) else { continue };
        let color = Color::of(k);
        group = group.add(band(&points(low), &points(high), color, 0.6 * WIDE)).add(band(
            &points(quarter),
            &points(three),
            color,
            0.7 * NARROW,
        ));
    }
    for i in (0..run.p.len()).filter(|i| !named.contains(i)) {
        if let Some(path) = curve(i) {
            group = group.add(path.set("stroke", GREY.pale(0.6)).set("stroke-width", 1.0));
        }
    }
    for (k, &i) in named.iter().enumerate() {
        if let Some(mut path) = curve(i) {
            path = path.set("stroke", Color::of(k)).set("stroke-width", 2.4);
            if let Some(dash) = dash(k) {
                path = path.set("stroke-dasharray", dash);
            }
            group = group.add(path);
        }
    }
    group = group.add(area.frame()).add(canvas::y_label(24.0, area, "weight"));
    // labels at the height where their curves end
    let end = |i: usize| y.at(run.p[i].last().copied().unwrap_or(0.0));
    let mut order: Vec<usize> = (0..named.len()).collect();
    order.sort_by(|&a, &b| end(named[a]).total_cmp(&end(named[b])).then(a.cmp(&b)));
    let wanted: Vec<f64> = order.iter().map(|&k| end(named[k])).collect();
    let sizes = vec![TICK + 4.0; order.len()];
    let Some(at) = spread(&wanted, &sizes, area.y - 4.0, area.bottom() + 4.0) else { return group };
    for ((&k, wanted), at) in order.iter().zip(&wanted).zip(at) {
        let color = Color::of(k);
        let right = area.right();
        group = group
            .add(canvas::line(right, *wanted, right + 8.0, *wanted, color, 1.2))
            .add(canvas::line(right + 8.0, *wanted, right + 16.0, at, color, 1.2));
        let text = canvas::text(right + 20.0, at + 0.35 * TICK, TICK, &names[k]);
        group = group.add(text.set("fill", color.ink()));
    }
    group
}

/// Range of a parameter: models, means and truth, with some room.
fn range(track: &Track) -> (f64, f64) {
    let truth = track.truth.iter().flatten();
    let bands = track.bands.0.iter().flatten();
    let all = track.mean.iter().chain(&track.models).chain(truth).chain(bands);
    let all = all.filter(|v| v.is_finite());
    let (low, high) =
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let room = 0.08 * (high - low);
    (low - room, high + room)
}

fn parameter(
    run: &Timeline,
    track: &Track,
    (low, high): (f64, f64),
    area: Area,
    x: &Scale,
    numbers: bool,
) -> Group {
    let y = Scale::new(low, high, false, area.bottom(), area.y);
    let mut group = Group::new()
        .add(canvas::x_axis(area, x, numbers, true))
        .add(canvas::y_axis(area, &y, 40.0, false));
    let mut nominal = track.models.clone();
    nominal.sort_by(f64::total_cmp);
    nominal.dedup();
    for value in nominal {
        let at = y.at(value);
        let line = canvas::line(area.x, at, area.right(), at, GREY.pale(0.4), 1.2);
        group = group.add(line.set("stroke-dasharray", "2 4"));
    }
    for value in track.boundaries.iter().filter(|v| (low..=high).contains(*v)) {
        let at = y.at(*value);
        let line = canvas::line(area.x, at, area.right(), at, Color::of(5), 1.4);
        group = group.add(line.set("stroke-dasharray", "9 4"));
    }
    let points = |values: &[f64]| -> Vec<(f64, f64)> {
        let points: Vec<(f64, f64)> =
            run.t.iter().zip(values).map(|(t, v)| (x.at(*t), y.at(*v))).collect();
        thinned(&points, area.x)
    };
    let [wide_low, quarter, three, wide_high] = &track.bands.0;
    group = group.add(band(&points(wide_low), &points(wide_high), Color::of(0), WIDE)).add(band(
        &points(quarter),
        &points(three),
        Color::of(0),
        NARROW,
    ));
    let curve = |values: &[f64]| canvas::polyline(points(values));
    if let Some(path) = track.truth.as_deref().and_then(curve) {
        group = group.add(path.set("stroke", GREY).set("stroke-width", 3.0));
    }
    if let Some(path) = curve(&track.mean) {
        group = group.add(path.set("stroke", Color::of(0)).set("stroke-width", 2.2));
    }
    group.add(area.frame()).add(canvas::y_label(24.0, area, &track.name))
}
