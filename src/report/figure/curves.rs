//! One parameter: Upsilon of each model along the grid, over the sets.

use svg::node::element::{Definitions, Group, SVG};

use super::canvas::{self, Area, LABEL, NOTE, TICK, TITLE, WIDTH};
use super::certain;
use super::decisions;
use super::labels::{BoundaryLabels, curve_labels};
use super::margin::MarginRange;
use super::palette::{GREY, INK};
use super::panel::{CROWD, Panel, THRONG, marker, nominal_points, upsilon_range};
use super::scale::Scale;
use crate::eip::{Case, EipSets};
use crate::report::summary;

/// Height of the main panel.
const MAIN: f64 = 380.0;
/// Height of the margin panel.
const MARGIN: f64 = 84.0;

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
    let certain = if sets.robust.is_some() { canvas::width("certain", NOTE) + 16.0 } else { 0.0 };
    let left = 36.0 + numbers.max(decisions::Strips::names_width(sets)).max(certain);
    let labels = curve_labels(sets, case, range.high, MAIN);
    let widest = labels.iter().map(|l| canvas::width(&l.text, TICK)).fold(0.0, f64::max);
    let number = canvas::width(&sets.models.len().to_string(), TICK) + 8.0;
    let right = if labels.is_empty() { 30.0 } else { widest + number + 32.0 };

    let what = format!("EIP sets of {name}");
    let title = canvas::heading(sets, &what, WIDTH - left - 20.0);
    let mut top = 40.0;
    let mut head =
        Group::new().add(canvas::text(left, top, TITLE, &title).set("font-weight", "bold"));
    for text in canvas::wrapped(&subtitle(sets, &what), NOTE, WIDTH - left - 20.0) {
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
    let below = Area { y: lowest.bottom() + 6.0, ..main };
    if let Some((strip, area)) = certain::strip(sets, &x, below) {
        body = body.add(strip);
        lowest = area;
    }
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
    let magnified = certain::Magnified::new(sets, &x, bottom + 24.0, left);
    bottom = magnified.bottom();
    body = body.add(magnified.draw());
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

fn subtitle(sets: &EipSets, what: &str) -> String {
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
    let line = parts.join(", ");
    // the picture's own heading stands where the study has no title
    if sets.title.is_some() { format!("{what}: {line}") } else { line }
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
    if !sets.undecidable.is_empty() || sets.robust.is_some() {
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
    if sets.robust.is_some() {
        notes.push("Dashed: the margin that the worst Delta leaves.".into());
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
