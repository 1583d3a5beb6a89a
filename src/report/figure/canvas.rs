//! Pieces of a drawing: text, lines, hatches, axes.

use svg::node::element::{
    ClipPath, Definitions, Group, Line, Path, Pattern, Rectangle, SVG, Text, Title,
};

use super::palette::{Color, FAINT, GREY, INK};
use super::scale::Scale;
use crate::eip::EipSets;

/// Font sizes in units of a picture 960 wide: legible at 600 pixels.
pub(super) const TITLE: f64 = 23.0;
pub(super) const LABEL: f64 = 18.0;
pub(super) const TICK: f64 = 16.0;
pub(super) const NOTE: f64 = 15.0;

/// Width of every picture.
pub(super) const WIDTH: f64 = 960.0;

/// A rectangle of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Area {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) w: f64,
    pub(super) h: f64,
}

impl Area {
    pub(super) fn right(&self) -> f64 {
        self.x + self.w
    }

    pub(super) fn bottom(&self) -> f64 {
        self.y + self.h
    }

    pub(super) fn rectangle(&self) -> Rectangle {
        Rectangle::new()
            .set("x", px(self.x))
            .set("y", px(self.y))
            .set("width", px(self.w.max(0.0)))
            .set("height", px(self.h.max(0.0)))
    }

    /// The frame around it.
    pub(super) fn frame(&self) -> Rectangle {
        self.rectangle().set("fill", "none").set("stroke", GREY).set("stroke-width", 1)
    }

    /// The part of it between two pixels, at least `least` wide and inside.
    pub(super) fn between(&self, from: f64, to: f64, least: f64) -> Area {
        let (from, to) = (from.max(self.x), to.min(self.right()));
        let w = (to - from).max(least).min(self.w);
        let x = ((from + to - w) / 2.0).clamp(self.x, self.right() - w);
        Area { x, y: self.y, w, h: self.h }
    }
}

/// A coordinate to a hundredth, which no eye and no printer resolves.
pub(super) fn px(v: f64) -> f64 {
    if v.is_finite() { (v * 100.0).round() / 100.0 + 0.0 } else { 0.0 }
}

/// Characters that XML does not allow are dropped.
pub(super) fn clean(text: &str) -> String {
    text.chars().filter(|c| !c.is_control() && !matches!(*c, '\u{fffe}' | '\u{ffff}')).collect()
}

/// Text at a base line.
pub(super) fn text(x: f64, y: f64, size: f64, content: &str) -> Text {
    Text::new(clean(content))
        .set("x", px(x))
        .set("y", px(y))
        .set("font-size", size)
        .set("fill", INK)
}

/// Text around a centre.
pub(super) fn centered(x: f64, y: f64, size: f64, content: &str) -> Text {
    text(x, y, size, content).set("text-anchor", "middle")
}

/// Width of `content` in a wide sans-serif face; others are narrower.
pub(super) fn width(content: &str, size: f64) -> f64 {
    let em: f64 = content
        .chars()
        .map(|c| match c {
            'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | ';' | '\'' | '|' | '!' | ' ' | '\u{a0}' => {
                0.34
            }
            'f' | 't' | 'r' | '(' | ')' | '[' | ']' | '-' => 0.42,
            'm' | 'w' | 'M' | 'W' | '%' => 0.96,
            '0'..='9' | 'a'..='z' => 0.62,
            c if c.is_ascii() => 0.73,
            // superscript digits and the like; ideographs need a full em
            '\u{b2}' | '\u{b3}' | '\u{b9}' | '\u{b7}' | '\u{2070}'..='\u{209f}' => 0.45,
            c if (c as u32) < 0x2e80 => 0.75,
            _ => 1.0,
        })
        .sum();
    em * size
}

/// `content` cut to `space` units of width.
pub(super) fn fitted(content: &str, size: f64, space: f64) -> String {
    let content = clean(content);
    if width(&content, size) <= space {
        return content;
    }
    let mut short = String::new();
    for c in content.chars() {
        short.push(c);
        if width(&short, size) + width("...", size) > space {
            short.pop();
            break;
        }
    }
    short.truncate(short.trim_end().len());
    short + "..."
}

/// Breaks `content` between words into lines of at most `space` units.
pub(super) fn wrapped(content: &str, size: f64, space: f64) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in content.split(' ') {
        let last = lines.len() - 1;
        let candidate = if lines[last].is_empty() {
            word.to_string()
        } else {
            format!("{} {word}", lines[last])
        };
        if lines[last].is_empty() || width(&candidate, size) <= space {
            lines[last] = candidate;
        } else {
            lines.push(word.into());
        }
    }
    lines.iter().map(|l| fitted(l, size, space)).collect()
}

/// A straight line.
pub(super) fn line(x1: f64, y1: f64, x2: f64, y2: f64, color: Color, thickness: f64) -> Line {
    Line::new()
        .set("x1", px(x1))
        .set("y1", px(y1))
        .set("x2", px(x2))
        .set("y2", px(y2))
        .set("stroke", color)
        .set("stroke-width", thickness)
}

/// A closed outline, as a piece of a path.
pub(super) fn outline(points: &[(f64, f64)]) -> String {
    let mut d = String::new();
    for (k, (x, y)) in points.iter().enumerate() {
        d.push_str(&format!("{}{} {}", if k == 0 { "M" } else { "L" }, px(*x), px(*y)));
    }
    d + "Z"
}

/// A rectangle by two opposite corners, as a piece of a path.
pub(super) fn block([from, to]: [(f64, f64); 2]) -> String {
    let [x1, y1, x2, y2] = [from.0, from.1, to.0, to.1].map(px);
    format!("M{x1} {y1}H{x2}V{y2}H{x1}Z")
}

/// The line through `points`, broken where a coordinate is not finite.
pub(super) fn polyline(points: impl IntoIterator<Item = (f64, f64)>) -> Option<Path> {
    let mut d = String::new();
    let mut pen = false;
    for (x, y) in points {
        if x.is_finite() && y.is_finite() {
            d.push_str(if pen { "L" } else { "M" });
            d.push_str(&format!("{} {}", px(x), px(y)));
            pen = true;
        } else {
            pen = false;
        }
    }
    (!d.is_empty()).then(|| {
        Path::new()
            .set("d", d)
            .set("fill", "none")
            .set("stroke-linejoin", "round")
            .set("stroke-linecap", "round")
    })
}

/// Hatch of undecidable sets.
pub(super) const UNDECIDABLE: &str = "url(#undecidable)";
/// Hatch of plants without a winner.
pub(super) const UNSTABLE: &str = "url(#unstable)";

/// An empty picture of height `height`: white, sans-serif, with the hatches.
pub(super) fn page(height: f64, title: &str) -> SVG {
    let hatch = |id: &str, angle: i32, ground: &str, ink: &str, step: f64, thick: f64| {
        Pattern::new()
            .set("id", id)
            .set("width", step)
            .set("height", step)
            .set("patternUnits", "userSpaceOnUse")
            .set("patternTransform", format!("rotate({angle})"))
            .add(
                Rectangle::new()
                    .set("width", step)
                    .set("height", step)
                    .set("fill", ground)
                    .set("fill-opacity", 0.6),
            )
            .add(
                Line::new()
                    .set("x1", thick / 2.0)
                    .set("x2", thick / 2.0)
                    .set("y1", 0)
                    .set("y2", step)
                    .set("stroke", ink)
                    .set("stroke-width", thick),
            )
    };
    let definitions = Definitions::new()
        .add(hatch("undecidable", 45, "#ffffff", "#444444", 6.0, 1.2))
        .add(hatch("unstable", -45, "#ececec", "#b4b4b4", 9.0, 2.0));
    svg::Document::new()
        .set("viewBox", (0, 0, WIDTH, px(height)))
        .set("font-family", "sans-serif")
        .set("role", "img")
        .add(Title::new(clean(title)))
        .add(definitions)
        .add(Rectangle::new().set("width", WIDTH).set("height", px(height)).set("fill", "#ffffff"))
}

/// A clip path `id` that shows `area` only.
pub(super) fn clip(id: &str, area: Area) -> ClipPath {
    ClipPath::new().set("id", id).add(area.rectangle())
}

/// Horizontal axis below `area`: ticks, numbers, and grid lines through it.
pub(super) fn x_axis(area: Area, scale: &Scale, labels: bool, grid: bool) -> Group {
    let mut group = Group::new();
    let bottom = area.bottom();
    let mut free = f64::NEG_INFINITY;
    for tick in scale.ticks(70.0) {
        let x = scale.at(tick.value);
        let major = !tick.label.is_empty();
        if grid && major {
            group = group.add(line(x, area.y, x, bottom, FAINT, 1.0));
        }
        let length = if major { 6.0 } else { 3.5 };
        group = group.add(line(x, bottom, x, bottom + length, GREY, 1.0));
        let half = width(&tick.label, TICK) / 2.0;
        if labels && major && x - half > free {
            group = group.add(centered(x, bottom + 8.0 + TICK, TICK, &tick.label));
            free = x + half + 4.0;
        }
    }
    group
}

/// Vertical axis left of `area`: ticks, numbers, and grid lines through it.
pub(super) fn y_axis(area: Area, scale: &Scale, spacing: f64, grid: bool) -> Group {
    let mut group = Group::new();
    let mut free = f64::INFINITY;
    for tick in scale.ticks(spacing) {
        let y = scale.at(tick.value);
        let major = !tick.label.is_empty();
        if grid && major {
            group = group.add(line(area.x, y, area.right(), y, FAINT, 1.0));
        }
        let length = if major { 6.0 } else { 3.5 };
        group = group.add(line(area.x - length, y, area.x, y, GREY, 1.0));
        if major && y < free - TICK {
            group = group.add(
                text(area.x - 10.0, y + 0.35 * TICK, TICK, &tick.label).set("text-anchor", "end"),
            );
            free = y;
        }
    }
    group
}

/// Room that the numbers of a vertical axis take.
pub(super) fn y_axis_width(scale: &Scale, spacing: f64) -> f64 {
    scale.ticks(spacing).iter().map(|t| width(&t.label, TICK)).fold(0.0, f64::max) + 12.0
}

/// Room between an axis and its name.
pub(super) const NAME: f64 = 54.0;

/// The name of a vertical axis, turned.
pub(super) fn y_label(x: f64, area: Area, content: &str) -> Text {
    let y = area.y + area.h / 2.0;
    centered(x, y, LABEL, content).set("transform", format!("rotate(-90 {} {})", px(x), px(y)))
}

/// The heading: the title of the study, shortened to `room`, or else `what`.
pub(super) fn heading(sets: &EipSets, what: &str, room: f64) -> String {
    let Some(title) = &sets.title else { return what.into() };
    // bold letters are a tenth wider
    match wrapped(title, TITLE * 1.1, room).as_slice() {
        [] => what.into(),
        [line] => line.clone(),
        [first, ..] => format!("{first} .."),
    }
}
