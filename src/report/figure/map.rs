//! Two parameters: a map of winners, stronger where the margin is larger, parted
//! by the lines on which two models explain a plant equally well.

use std::collections::BTreeMap;

use svg::node::element::{Group, SVG};

use super::canvas::{self, Area, LABEL, NOTE, TITLE, WIDTH};
use super::contour::{self, Mesh};
use super::key::dot;
use super::palette::{Color, GREY, INK};
use super::scale::Scale;
use super::shade::{SHADES, levels, lightest};
use crate::eip::EipSets;
use crate::model::Axis;
use crate::report::summary;

/// Cells a side, at most; finer grids show every few points.
const CELLS: usize = 240;

pub(super) fn draw(sets: &EipSets) -> SVG {
    let axes = sets.grid.axes();
    let ((x_name, x_axis), (y_name, y_axis)) = (&axes[0], &axes[1]);
    let plane = Plane::new(sets);
    let levels = levels(&plane.margins());

    let right = 236.0;
    let left = 40.0 + canvas::y_axis_width(&Scale::of_axis(y_axis, 500.0, 0.0), 60.0).max(36.0);
    let what = format!("EIP sets of {x_name} and {y_name}");
    let title = canvas::heading(sets, &what, WIDTH - left - 20.0);
    let mut top = 40.0;
    let mut head =
        Group::new().add(canvas::text(left, top, TITLE, &title).set("font-weight", "bold"));
    let line = plane.subtitle();
    let line = if sets.title.is_some() { format!("{what}: {line}") } else { line };
    for text in canvas::wrapped(&line, NOTE, WIDTH - left - 20.0) {
        top += 23.0;
        head = head.add(canvas::text(left, top, NOTE, &text).set("fill", GREY));
    }
    top += 20.0;
    let area = Area { x: left, y: top, w: WIDTH - right - left, h: 540.0 };
    let x = padded(x_axis, &plane.columns, area.x, area.right());
    let y = padded(y_axis, &plane.rows, area.bottom(), area.y);
    let mut body = Group::new().add(plane.regions(&levels, &x, &y));
    body = body.add(plane.undecidable(&x, &y)).add(plane.nominals(&x, &y));
    body = body.add(area.frame());
    body =
        body.add(canvas::x_axis(area, &x, true, false)).add(canvas::y_axis(area, &y, 60.0, false));
    let bottom = area.bottom() + canvas::NAME;
    body = body
        .add(canvas::centered(area.x + area.w / 2.0, bottom, LABEL, x_name))
        .add(canvas::y_label(24.0, area, y_name));
    body = body.add(plane.legend(&levels, area.right() + 24.0, area.y + 14.0));
    canvas::page(bottom + 26.0, &title).add(head).add(body)
}

/// A scale with room for half a cell at both ends.
fn padded(axis: &Axis, shown: &[usize], start: f64, end: f64) -> Scale {
    let mut scale = Scale::of_axis(axis, start, end);
    let values: Vec<f64> = shown.iter().map(|&k| axis.value(k)).collect();
    if let ([first, second, ..], [.., before, last]) = (&values[..], &values[..]) {
        let outer = |edge: f64, next: f64| {
            let middle = scale.middle(edge, next);
            if scale.log { edge * edge / middle } else { 2.0 * edge - middle }
        };
        let (from, to) = (outer(*first, *second), outer(*last, *before));
        (scale.from, scale.to) = (from, to);
    }
    scale
}

/// The shown plane of the grid: the first two axes.
pub(super) struct Plane<'a> {
    pub(super) sets: &'a EipSets,
    /// Shown indices of the first and of the second axis.
    columns: Vec<usize>,
    rows: Vec<usize>,
    /// Index along every other axis.
    others: Vec<usize>,
}

impl<'a> Plane<'a> {
    fn new(sets: &'a EipSets) -> Self {
        let axes = sets.grid.axes();
        let shown = |axis: &Axis| -> Vec<usize> {
            let every = axis.len().div_ceil(CELLS);
            (0..axis.len()).step_by(every).collect()
        };
        Self {
            sets,
            columns: shown(&axes[0].1),
            rows: shown(&axes[1].1),
            others: axes[2..].iter().map(|(_, axis)| axis.len() / 2).collect(),
        }
    }

    /// Index of a plant on the grid, last axis fastest.
    fn plant(&self, column: usize, row: usize) -> usize {
        let indices = [column, row].into_iter().chain(self.others.iter().copied());
        self.sets.grid.axes().iter().zip(indices).fold(0, |k, ((_, axis), i)| k * axis.len() + i)
    }

    fn winner(&self, column: usize, row: usize) -> Option<usize> {
        self.sets.cases[0].winner[self.plant(column, row)]
    }

    /// Whether the winner depends on the delay.
    fn undecided(&self, column: usize, row: usize) -> bool {
        summary::undecided(self.sets, self.plant(column, row))
    }

    fn margin(&self, column: usize, row: usize) -> f64 {
        self.sets.cases[0].margin[self.plant(column, row)]
    }

    fn margins(&self) -> Vec<f64> {
        let all = self.columns.iter().flat_map(|&c| self.rows.iter().map(move |&r| (c, r)));
        let mut margins: Vec<f64> =
            all.map(|(c, r)| self.margin(c, r)).filter(|m| m.is_finite()).collect();
        margins.sort_by(f64::total_cmp);
        margins
    }

    fn subtitle(&self) -> String {
        let sets = self.sets;
        let case = &sets.cases[0];
        let mut parts = vec![
            summary::count(sets.models.len(), "model"),
            summary::count(sets.grid.len(), "plant"),
            summary::convention(sets.convention),
        ];
        if case.delay != 0.0 || sets.cases.len() > 1 {
            let more = if sets.cases.len() > 1 {
                format!(" (first of {})", sets.cases.len())
            } else {
                String::new()
            };
            parts.push(format!("actuator delay {}{more}", summary::delay(case.delay)));
        }
        let axes = sets.grid.axes();
        if axes.len() > 2 {
            let fixed: Vec<String> = axes[2..]
                .iter()
                .zip(&self.others)
                .map(|((name, axis), &k)| format!("{name} = {}", axis.value(k)))
                .collect();
            parts.push(format!("slice at {} (middle of the grid)", fixed.join(", ")));
        }
        let thinned: Vec<String> = [(&axes[0], &self.columns), (&axes[1], &self.rows)]
            .iter()
            .filter(|((_, axis), shown)| shown.len() < axis.len())
            .map(|((name, axis), shown)| format!("{} of {} {name}", shown.len(), axis.len()))
            .collect();
        if !thinned.is_empty() {
            parts.push(format!("shown: {}", thinned.join(", ")));
        }
        parts.join(", ")
    }

    /// Regions by winner and shade, and the lines between winners.
    fn regions(&self, levels: &[f64], x: &Scale, y: &Scale) -> Group {
        let axes = self.sets.grid.axes();
        let (columns, xs) = nodes(&axes[0].1, &self.columns, x);
        let (rows, ys) = nodes(&axes[1].1, &self.rows, y);
        let models = self.sets.models.len();
        let winner = |c: usize, r: usize| self.winner(columns[c], rows[r]);
        let value = |c: usize, r: usize, i: usize| {
            self.sets.cases[0].upsilon[self.plant(columns[c], rows[r]) * models + i]
        };
        let margin = |c: usize, r: usize| self.margin(columns[c], rows[r]);
        let (xs, ys) = (&xs[..], &ys[..]);
        let mesh = Mesh { xs, ys, winner: &winner, value: &value, margin: &margin };
        // a path for each winner and shade
        let mut faces: BTreeMap<(Option<usize>, usize), String> = BTreeMap::new();
        let mut lines = String::new();
        for r in 0..ys.len() - 1 {
            // equal neighbours of a row are one rectangle, begun at a column
            let mut run: Option<((Option<usize>, usize), usize)> = None;
            for c in 0..xs.len() - 1 {
                let cell = mesh.cell(c, r);
                let mut parts = Vec::new();
                for face in &cell.faces {
                    let bands = contour::bands(&face.outline, levels);
                    let key = |band| (face.winner, lightest(levels) + band);
                    parts.extend(bands.into_iter().map(|(band, outline)| (key(band), outline)));
                }
                let key = if let [(key, _)] = &parts[..] { Some(*key) } else { None };
                if let Some((begun, from)) = run.filter(|(begun, _)| key != Some(*begun)) {
                    let ends = [(xs[from], ys[r]), (xs[c], ys[r + 1])];
                    faces.entry(begun).or_default().push_str(&canvas::block(ends));
                    run = None;
                }
                if let Some(key) = key {
                    run.get_or_insert((key, c));
                    continue;
                }
                for (key, outline) in parts {
                    faces.entry(key).or_default().push_str(&canvas::outline(&outline));
                }
                for [from, to] in &cell.lines {
                    let [x1, y1, x2, y2] = [from.0, from.1, to.0, to.1].map(canvas::px);
                    lines.push_str(&format!("M{x1} {y1}L{x2} {y2}"));
                }
            }
            if let Some((begun, from)) = run {
                let ends = [(xs[from], ys[r]), (xs[xs.len() - 1], ys[r + 1])];
                faces.entry(begun).or_default().push_str(&canvas::block(ends));
            }
        }
        let mut group = Group::new();
        for ((owner, shade), d) in faces {
            let path = svg::node::element::Path::new().set("d", d);
            group = group.add(match owner {
                Some(i) => {
                    let color = Color::of(i).pale(SHADES[shade]);
                    // a thin line hides the seams between faces
                    path.set("fill", color).set("stroke", color).set("stroke-width", 0.6)
                }
                None => path.set("fill", canvas::UNSTABLE),
            });
        }
        let path = svg::node::element::Path::new().set("d", lines).set("fill", "none");
        let path = path.set("stroke", INK).set("stroke-width", 1.6);
        group.add(path.set("stroke-linecap", "round"))
    }

    /// Hatch over the cells whose winner depends on the delay.
    fn undecidable(&self, x: &Scale, y: &Scale) -> Group {
        let axes = self.sets.grid.axes();
        let xs = edges(&axes[0].1, &self.columns, x);
        let ys = edges(&axes[1].1, &self.rows, y);
        let mut group = Group::new();
        if self.sets.cases.len() < 2 {
            return group;
        }
        for (r, &row) in self.rows.iter().enumerate() {
            let mut c = 0;
            while c < self.columns.len() {
                let first = c;
                while c < self.columns.len() && self.undecided(self.columns[c], row) {
                    c += 1;
                }
                if c > first {
                    let w = xs[c] - xs[first];
                    let cell = Area { x: xs[first], y: ys[r + 1], w, h: ys[r] - ys[r + 1] };
                    group = group.add(cell.rectangle().set("fill", canvas::UNDECIDABLE));
                }
                c = c.max(first + 1);
            }
        }
        group
    }

    /// Numbered dots at the nominal values.
    fn nominals(&self, x: &Scale, y: &Scale) -> Group {
        let axes = self.sets.grid.axes();
        let column = |name: &str| self.sets.parameters.iter().position(|p| p == name);
        let mut group = Group::new();
        let (Some(cx), Some(cy)) = (column(&axes[0].0), column(&axes[1].0)) else { return group };
        let mut taken: Vec<(f64, f64)> = Vec::new();
        for (i, model) in self.sets.models.iter().enumerate() {
            let (Some(&vx), Some(&vy)) = (model.values.get(cx), model.values.get(cy)) else {
                continue;
            };
            if !(x.from..=x.to).contains(&vx) || !(y.from..=y.to).contains(&vy) {
                continue;
            }
            let (px, py) = (x.at(vx), y.at(vy));
            if taken.iter().any(|t| (t.0 - px).hypot(t.1 - py) < 20.0) {
                continue;
            }
            taken.push((px, py));
            group = group.add(dot(px, py, i));
        }
        group
    }
}

/// Nodes of the mesh along an axis: the shown values, the outer ones again at
/// the ends of the scale; their indices and pixels.
fn nodes(axis: &Axis, shown: &[usize], scale: &Scale) -> (Vec<usize>, Vec<f64>) {
    let (Some(&first), Some(&last)) = (shown.first(), shown.last()) else {
        return Default::default();
    };
    let indices = [&[first], shown, &[last]].concat();
    let mut pixels = vec![scale.start];
    pixels.extend(shown.iter().map(|&k| scale.at(axis.value(k))));
    pixels.push(scale.end);
    (indices, pixels)
}

/// Pixels between the shown values of an axis, one more than there are values.
fn edges(axis: &Axis, shown: &[usize], scale: &Scale) -> Vec<f64> {
    let values: Vec<f64> = shown.iter().map(|&k| axis.value(k)).collect();
    let mut edges = vec![scale.start];
    edges.extend(values.windows(2).map(|w| scale.at(scale.middle(w[0], w[1]))));
    edges.push(scale.end);
    edges
}
