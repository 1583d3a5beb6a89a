//! The key of a map: winners, hatches, shades.

use svg::node::element::{Circle, Group};

use super::canvas::{self, Area, NOTE, TICK, WIDTH};
use super::map::Plane;
use super::palette::{Color, GREY};
use super::shade::SHADES;
use crate::report::number::pretty;
use crate::report::summary;

/// Rows of the legend.
const LEGEND: usize = 18;

impl Plane<'_> {
    pub(super) fn legend(&self, levels: &[f64], x: f64, top: f64) -> Group {
        let sets = self.sets;
        let mut group = Group::new();
        let mut y = top;
        let heading = |group: Group, y: f64, text: &str| {
            group.add(canvas::text(x, y, NOTE, text).set("font-weight", "bold"))
        };
        group = heading(group, y, "winner");
        let seen: Vec<bool> = {
            let mut seen = vec![false; sets.models.len()];
            for i in sets.cases[0].winner.iter().flatten() {
                seen[*i] = true;
            }
            seen
        };
        let winners: Vec<usize> = (0..seen.len()).filter(|&i| seen[i]).collect();
        for &i in winners.iter().take(LEGEND) {
            y += 25.0;
            group = group.add(dot(x + 11.0, y - 5.0, i));
            // a line never breaks between a name and its value
            let label = summary::short_name(sets, i).replace(" = ", "\u{a0}=\u{a0}");
            let lines = canvas::wrapped(&label, NOTE, WIDTH - x - 40.0);
            // names of many values take more lines, where there is room
            let lines = &lines[..lines.len().min(if winners.len() > 8 { 1 } else { 3 })];
            for (k, text) in lines.iter().enumerate() {
                y += if k > 0 { 20.0 } else { 0.0 };
                group = group.add(canvas::text(x + 29.0, y, NOTE, text));
            }
        }
        let mut lines = Vec::new();
        if winners.len() > LEGEND {
            lines.push(format!("and {} more", winners.len() - LEGEND));
        }
        if winners.len() < sets.models.len() {
            let losers = sets.models.len() - winners.len();
            lines.push(format!("{} without a plant", summary::count(losers, "model")));
        }
        for text in lines {
            y += 25.0;
            group = group.add(canvas::text(x, y, NOTE, &text).set("fill", GREY));
        }
        if sets.cases[0].winner.iter().any(Option::is_none) {
            y += 27.0;
            let swatch = Area { x, y: y - 13.0, w: 22.0, h: 15.0 };
            let case = &sets.cases[0];
            let text = if winners.is_empty() {
                "no winner anywhere"
            } else if case.failed.is_empty() && case.undecided.is_empty() {
                "unstable loop"
            } else {
                "no winner"
            };
            group = group.add(swatch.frame().set("fill", canvas::UNSTABLE)).add(canvas::text(
                x + 29.0,
                y,
                NOTE,
                text,
            ));
        }
        if (0..sets.grid.len()).any(|plant| summary::undecided(sets, plant)) {
            y += 27.0;
            let swatch = Area { x, y: y - 13.0, w: 22.0, h: 15.0 };
            group = group.add(swatch.frame().set("fill", canvas::UNDECIDABLE)).add(canvas::text(
                x + 29.0,
                y,
                NOTE,
                "undecidable",
            ));
        }
        if levels.is_empty() {
            return group;
        }
        y += 44.0;
        group = heading(group, y, "margin to runner-up");
        let first = SHADES.len() - 1 - levels.len();
        for (k, pale) in SHADES[first..].iter().enumerate() {
            y += 22.0;
            let swatch = Area { x, y: y - 13.0, w: 22.0, h: 17.0 };
            let text = match (k.checked_sub(1).map(|b| levels[b]), levels.get(k)) {
                (None, Some(above)) => format!("below {}", pretty(*above)),
                (Some(below), Some(above)) => format!("{} to {}", pretty(below), pretty(*above)),
                (Some(below), None) => format!("above {}", pretty(below)),
                (None, None) => String::new(),
            };
            group = group
                .add(swatch.frame().set("fill", Color::of(0).pale(*pale)))
                .add(canvas::text(x + 29.0, y, NOTE, &text));
        }
        group
    }
}

pub(super) fn dot(x: f64, y: f64, model: usize) -> Group {
    let circle = Circle::new()
        .set("cx", canvas::px(x))
        .set("cy", canvas::px(y))
        .set("r", 10.5)
        .set("fill", Color::of(model))
        .set("stroke", "#ffffff")
        .set("stroke-width", 1.6);
    let number = (model + 1).to_string();
    let size = if number.len() > 2 { 10.0 } else { TICK - 3.0 };
    Group::new().add(circle).add(
        canvas::centered(x, y + 0.36 * size, size, &number)
            .set("fill", Color::of(model).contrast()),
    )
}
