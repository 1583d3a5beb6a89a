//! A study as a report: its picture and its tables.

use super::{Figure, Page, Table};
use crate::eip::{Case, EipSets};
use crate::report::manifest::Manifest;
use crate::report::{figure, significant, summary};

/// Rows of a table, at most.
const ROWS: usize = 200;
/// Models up to which the table at the nominal values is shown.
const SQUARE: usize = 12;

/// The report of a study; `subtitle` and `scenario` as in [`Page`].
pub fn study<'a>(
    sets: &'a EipSets,
    subtitle: &'a str,
    scenario: &'a str,
    manifest: &'a Manifest,
) -> Page<'a> {
    let mut tables = Vec::new();
    for case in &sets.cases {
        let of = if sets.cases.len() > 1 {
            format!(", actuator delay {}", summary::delay(case.delay))
        } else {
            String::new()
        };
        tables.push(models(sets, case, &of));
        tables.extend(boundaries(sets, case, &of));
        tables.extend(missing(sets, case, &of));
    }
    tables.extend(undecidable(sets));
    tables.extend(nominals(sets));
    let svg = figure::to_string(sets);
    Page {
        title: sets.title.as_deref().unwrap_or("EIP sets"),
        subtitle,
        figures: vec![Figure { caption: "Equivalently identified plants".into(), svg }],
        tables,
        scenario,
        manifest,
    }
}

fn models(sets: &EipSets, case: &Case, of: &str) -> Table {
    let n = sets.models.len();
    let one = sets.grid.axes().len() == 1;
    let (shares, ranges) = (summary::shares(case, n), summary::winning_range(case, n));
    let mut head = vec!["model".to_string(), "nominal values".into()];
    if one {
        head.push("EIP set".into());
    }
    head.extend(["share".into(), "its Upsilon there".into()]);
    let rows = (0..n).map(|i| {
        let mut row = vec![(i + 1).to_string(), summary::model_name(sets, i)];
        if one {
            let end = |v| summary::end_point(v, &case.boundaries);
            let set = case.sets.get(i).map(Vec::as_slice).unwrap_or_default();
            let set: Vec<String> =
                set.iter().map(|s| format!("[{}, {}]", end(s.from), end(s.to))).collect();
            row.push(if set.is_empty() { "none".into() } else { set.join(", ") });
        }
        row.push(format!("{} %", significant(100.0 * shares[i], 4)));
        row.push(ranges[i].map_or_else(String::new, |(low, high)| {
            format!("{} to {}", significant(low, 6), significant(high, 6))
        }));
        row
    });
    let rows: Vec<_> = rows.take(ROWS).collect();
    let mut notes = cut(n);
    for (i, failure) in sets.models.iter().enumerate() {
        if let Some(failure) = &failure.failure {
            notes.push(format!("Model {} is unusable: {}", i + 1, summary::cause(failure)));
        }
    }
    if let Some(closest) = summary::closest(case, n) {
        notes.push(format!(
            "Closest decision: {}, model {} before model {} by {}.",
            summary::plant_name(sets, closest.plant),
            closest.winner + 1,
            closest.runner_up + 1,
            significant(closest.margin, 4),
        ));
    }
    notes.push(format!(
        "{} of {} pairs by two routes, which differ by {} at most (relative); {} by the frequency integral alone.",
        case.checked_pairs,
        case.upsilon.len(),
        significant(case.route_difference, 2),
        case.replaced,
    ));
    Table { caption: format!("Models{of}"), head, rows, notes }
}

fn boundaries(sets: &EipSets, case: &Case, of: &str) -> Option<Table> {
    let row = |b: &crate::eip::Boundary| {
        let sides = format!("{} | {}", b.left + 1, b.right + 1);
        vec![summary::boundary_value(b), significant(b.uncertainty, 2), sides]
    };
    let rows: Vec<_> = case.boundaries.iter().take(ROWS).map(row).collect();
    let head = vec![sets.grid.axes()[0].0.clone(), "uncertainty".into(), "models".into()];
    let notes = cut(case.boundaries.len());
    let table = Table { caption: format!("Boundaries{of}"), head, rows, notes };
    (!case.boundaries.is_empty()).then_some(table)
}

/// The plants without a winner.
fn missing(sets: &EipSets, case: &Case, of: &str) -> Option<Table> {
    let at = |plant| summary::plant_name(sets, plant);
    let unstable = case
        .unstable
        .iter()
        .map(|u| vec![at(u.plant), "unstable".into(), format!("mode {} ({})", u.mode, u.states)]);
    let failed = case.failed.iter().map(|f| {
        vec![at(f.plant), "cannot be built".into(), summary::plant_cause(&f.error).to_string()]
    });
    let undecided = case
        .undecided
        .iter()
        .map(|u| vec![at(u.plant), "not decided".into(), summary::doubt(&u.doubt)]);
    let count = case.unstable.len() + case.failed.len() + case.undecided.len();
    let rows: Vec<_> = unstable.chain(failed).chain(undecided).take(ROWS).collect();
    let head = vec!["plant".into(), "what".into(), "why".into()];
    let caption = format!("Plants without a winner{of}");
    (count > 0).then(|| Table { caption, head, rows, notes: cut(count) })
}

fn undecidable(sets: &EipSets) -> Option<Table> {
    let row = |u: &crate::eip::Undecidable| {
        let Some((name, _)) = sets.grid.axes().first() else { return Vec::new() };
        let ends = [u.interval.from, u.interval.to].map(|v| significant(v, 9));
        let stretch = format!("{name} in [{}, {}]", ends[0], ends[1]);
        vec![stretch, summary::numbers(&u.models, ", ")]
    };
    let rows: Vec<_> = sets.undecidable.iter().take(ROWS).map(row).collect();
    let caption = "Undecidable: the winner depends on the delay".into();
    let head = vec!["where".into(), "models".into()];
    let notes = cut(sets.undecidable.len());
    (!rows.is_empty()).then_some(Table { caption, head, rows, notes })
}

/// Upsilon of each model with the plant at each nominal value.
fn nominals(sets: &EipSets) -> Option<Table> {
    let n = sets.models.len();
    if n > SQUARE {
        return None;
    }
    let mut head = vec!["plant at nominal of".to_string()];
    head.extend((1..=n).map(|i| format!("model {i}")));
    let rows = sets.at_nominals.chunks(n).enumerate().map(|(j, row)| {
        let mut cells = vec![format!("model {}", j + 1)];
        let shown = |u: &f64| if u.is_finite() { significant(*u, 7) } else { "none".into() };
        cells.extend(row.iter().map(shown));
        cells
    });
    let rows = rows.collect();
    let caption = "Upsilon at the nominal values".into();
    Some(Table { caption, head, rows, notes: Vec::new() })
}

/// Says what a table leaves out.
fn cut(count: usize) -> Vec<String> {
    let more = count.saturating_sub(ROWS);
    if more > 0 { vec![format!("and {more} more")] } else { Vec::new() }
}
