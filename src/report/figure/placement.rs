//! The sets before and after a placement, one above the other.

use svg::node::element::{Definitions, Group, SVG};

use super::canvas::{self, Area, LABEL, NOTE, TITLE, WIDTH};
use super::decisions;
use super::labels::BoundaryLabels;
use super::palette::GREY;
use super::panel::{CROWD, Panel, UpsilonRange, upsilon_range};
use super::scale::Scale;
use crate::eip::EipSets;
use crate::report::significant;

/// Height of the curves of one study.
const MAIN: f64 = 230.0;

/// Both studies are of one parameter and one grid.
pub(super) fn draw(before: &EipSets, after: &EipSets) -> SVG {
    let (name, axis) = &after.grid.axes()[0];
    let values = axis.values();
    let range = joint(&upsilon_range(&before.cases[0]), &upsilon_range(&after.cases[0]));
    let y_scale = |start, end| Scale::new(range.low, range.high, range.log, start, end);
    let left = 36.0 + canvas::y_axis_width(&y_scale(MAIN, 0.0), 60.0).max(60.0);
    let x = Scale::of_axis(axis, left, WIDTH - 30.0);
    let title = canvas::heading(after, &format!("Placement on {name}"), WIDTH - left - 20.0);
    let mut bottom = 40.0;
    let mut body =
        Group::new().add(canvas::text(left, bottom, TITLE, &title).set("font-weight", "bold"));
    let mut clips = Definitions::new();
    for (k, (what, sets)) in [("before", before), ("after", after)].into_iter().enumerate() {
        let case = &sets.cases[0];
        let labels = BoundaryLabels::new(case, &x);
        bottom += 30.0;
        let nominals: Vec<String> =
            sets.models.iter().take(CROWD).map(|m| significant(m.values[0], 6)).collect();
        let heading = format!("{what}: {name} = {}", nominals.join(", "));
        for text in canvas::wrapped(&heading, LABEL, WIDTH - left - 20.0) {
            body = body.add(canvas::text(left, bottom, LABEL, &text));
            bottom += 23.0;
        }
        let top = bottom + labels.height() - 6.0;
        let main = Area { x: left, y: top, w: WIDTH - 30.0 - left, h: MAIN };
        let y = y_scale(main.bottom(), main.y);
        let panel = Panel { sets, case, values: &values, x, y, main };
        let id = format!("panel{k}");
        clips = clips.add(canvas::clip(&id, main));
        body = body.add(panel.bands()).add(canvas::x_axis(main, &x, false, true));
        body = body.add(canvas::y_axis(main, &y, 60.0, true)).add(panel.unstable(main));
        body = body.add(panel.boundary_lines());
        body = body.add(panel.curves().set("clip-path", format!("url(#{id})"))).add(main.frame());
        if sets.models.len() <= CROWD {
            body = body.add(panel.nominals());
        }
        body = body.add(labels.draw(main.y)).add(canvas::y_label(24.0, main, "Upsilon"));
        let strips = decisions::Strips { sets, x, area: Area { y: main.bottom() + 8.0, ..main } };
        body = body.add(strips.draw());
        let lowest = Area { h: strips.height(), ..strips.area };
        body = body.add(canvas::x_axis(lowest, &x, true, false));
        bottom = lowest.bottom() + canvas::NAME;
    }
    let middle = left + (WIDTH - 30.0 - left) / 2.0;
    body = body.add(canvas::centered(middle, bottom, LABEL, name));
    let note =
        "Circles: nominal values; lines: boundaries of the sets; both panels have one scale.";
    bottom += 26.0;
    body = body.add(canvas::text(left, bottom, NOTE, note).set("fill", GREY));
    canvas::page(bottom + 22.0, &title).add(clips).add(body)
}

/// A range that holds both.
fn joint(a: &UpsilonRange, b: &UpsilonRange) -> UpsilonRange {
    let log = a.log && b.log;
    let low = a.low.min(b.low);
    UpsilonRange { low, high: a.high.max(b.high), log: log && low > 0.0 }
}
