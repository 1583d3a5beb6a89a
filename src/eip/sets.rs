//! Intervals and boundaries of one parameter, refined between grid points.

use crate::eip::root::{Bracket, bracket, negative_point};
use crate::eip::{Boundary, Interval, Undecidable};
use crate::error::Result;

/// Upsilon of every model at one parameter value; `None` where the loop is
/// unstable.
pub(crate) type Row = Option<Vec<f64>>;

/// A parameter value that was looked at.
#[derive(Clone)]
struct Probe {
    x: f64,
    row: Row,
    winner: Option<usize>,
}

/// Where the winner changes; `None` for an unstable stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Break {
    pub(crate) value: f64,
    pub(crate) width: f64,
    /// Slope of the difference that changes sign.
    pub(crate) slope: f64,
    pub(crate) left: Option<usize>,
    pub(crate) right: Option<usize>,
}

/// The winner of a row: the smallest number, the first of equals; `None` if
/// all are NaN.
pub(crate) fn winner(row: &[f64]) -> Option<usize> {
    let mut best: Option<usize> = None;
    for (i, &v) in row.iter().enumerate() {
        if !v.is_nan() && best.is_none_or(|b| v < row[b]) {
            best = Some(i);
        }
    }
    best
}

/// Runner-up less winner, leaving out duplicates of the winner.
pub(crate) fn margin(row: &[f64], winner: usize, duplicate_of: &[Option<usize>]) -> f64 {
    let root = |i: usize| duplicate_of[i].unwrap_or(i);
    row.iter()
        .enumerate()
        .filter(|&(i, v)| root(i) != root(winner) && !v.is_nan())
        .fold(f64::INFINITY, |m, (_, &v)| m.min(v - row[winner]))
}

/// Finds every change of winner along the grid.
///
/// `rows[k]` belongs to `grid[k]`; `evaluate` gives the row at any value
/// between. Boundaries are bracketed to `width`. Between grid points with one
/// winner a dip of a rival is looked for where three points show a minimum that
/// a parabola takes to a tenth of the middle one.
pub(crate) fn breaks(
    grid: &[f64],
    rows: &[Row],
    width: f64,
    mut evaluate: impl FnMut(f64) -> Result<Row>,
) -> Result<Vec<Break>> {
    let mut probes: Vec<Probe> = Vec::with_capacity(grid.len());
    let mut dips = Vec::new();
    for (k, (&x, row)) in grid.iter().zip(rows).enumerate() {
        probes.push(probe(x, row.clone()));
        if k >= 2 {
            dips.extend(dip(&probes[k - 2..], &mut evaluate)?);
        }
    }
    probes.append(&mut dips);
    probes.sort_by(|p, q| p.x.total_cmp(&q.x));
    let mut found = Vec::new();
    for pair in probes.windows(2) {
        split(&pair[0], &pair[1], width, &mut evaluate, &mut found)?;
    }
    Ok(found)
}

fn probe(x: f64, row: Row) -> Probe {
    let winner = row.as_deref().and_then(winner);
    Probe { x, row, winner }
}

/// A point near the middle one of three where another model wins.
fn dip(three: &[Probe], evaluate: &mut impl FnMut(f64) -> Result<Row>) -> Result<Option<Probe>> {
    let [a, b, c] = three else { return Ok(None) };
    let Some(w) = b.winner else { return Ok(None) };
    if a.winner != b.winner || c.winner != b.winner {
        return Ok(None);
    }
    let (Some(ra), Some(rb), Some(rc)) = (&a.row, &b.row, &c.row) else { return Ok(None) };
    for j in (0..rb.len()).filter(|&j| j != w) {
        let (d0, d1, d2) = (ra[j] - ra[w], rb[j] - rb[w], rc[j] - rc[w]);
        let bend = d0 - 2.0 * d1 + d2;
        // also false for NaN
        if !(d1 > 0.0 && d1 <= d0 && d1 <= d2 && bend > 0.0) {
            continue;
        }
        if d1 - (d0 - d2).powi(2) / (8.0 * bend) > 0.1 * d1 {
            continue;
        }
        let at =
            negative_point(a.x, c.x, |x| Ok::<_, crate::Error>(evaluate(x)?.map(|r| r[j] - r[w])))?;
        if let Some(x) = at {
            return Ok(Some(probe(x, evaluate(x)?)));
        }
    }
    Ok(None)
}

/// Finds the changes of winner between two probes, in order.
fn split(
    a: &Probe,
    b: &Probe,
    width: f64,
    evaluate: &mut impl FnMut(f64) -> Result<Row>,
    found: &mut Vec<Break>,
) -> Result<()> {
    if a.winner == b.winner {
        return Ok(());
    }
    let small = b.x - a.x <= width.max(2.0 * f64::EPSILON * a.x.abs().max(b.x.abs()));
    let (Some(i), Some(j)) = (a.winner, b.winner) else {
        return edge(a, b, width, evaluate, found);
    };
    let (Some(ra), Some(rb)) = (&a.row, &b.row) else { return Ok(()) };
    let (fa, fb) = (ra[i] - ra[j], rb[i] - rb[j]);
    let slope = (fb - fa) / (b.x - a.x);
    let stop = |x: f64, w: f64| Break { value: x, width: w, slope, left: Some(i), right: Some(j) };
    if small {
        found.push(stop(0.5 * (a.x + b.x), b.x - a.x));
        return Ok(());
    }
    let ends = bracket((a.x, fa), (b.x, fb), width, |x| {
        Ok::<_, crate::Error>(evaluate(x)?.map(|r| r[i] - r[j]))
    })?;
    let (low, high) = match ends {
        Bracket::Root(p, q) => (p, q),
        Bracket::Undefined(x) => {
            let middle = probe(x, evaluate(x)?);
            split(a, &middle, width, evaluate, found)?;
            return split(&middle, b, width, evaluate, found);
        }
    };
    // the end with the smaller difference is nearer to the root
    let x = if low.1.abs() <= high.1.abs() { low.0 } else { high.0 };
    let middle = probe(x, evaluate(x)?);
    if middle.winner == Some(i) || middle.winner == Some(j) || x <= a.x || x >= b.x {
        found.push(stop(x, (high.0 - low.0).abs()));
        return Ok(());
    }
    // a third model wins where these two meet
    split(a, &middle, width, evaluate, found)?;
    split(&middle, b, width, evaluate, found)
}

/// Bisects for the end of an unstable stretch.
fn edge(
    a: &Probe,
    b: &Probe,
    width: f64,
    evaluate: &mut impl FnMut(f64) -> Result<Row>,
    found: &mut Vec<Break>,
) -> Result<()> {
    let (mut a, mut b) = (a.clone(), b.clone());
    let (start, end) = (a.clone(), b.clone());
    while b.x - a.x > width.max(4.0 * f64::EPSILON * a.x.abs().max(b.x.abs())) {
        let x = 0.5 * (a.x + b.x);
        let middle = probe(x, evaluate(x)?);
        let like_a = middle.winner.is_some() == a.winner.is_some();
        if like_a {
            a = middle;
        } else {
            b = middle;
        }
    }
    let here = Break {
        value: 0.5 * (a.x + b.x),
        width: b.x - a.x,
        slope: f64::INFINITY,
        left: a.winner,
        right: b.winner,
    };
    // the stable side may change winner on its way to the edge
    if a.winner.is_some() {
        split(&start, &a, width, evaluate, found)?;
        found.push(here);
        Ok(())
    } else {
        found.push(here);
        split(&b, &end, width, evaluate, found)
    }
}

/// Stretches of the parameter with their winner (`None`: unstable), from the
/// first grid value to the last.
pub(crate) fn stretches(
    grid: &[f64],
    first: Option<usize>,
    breaks: &[Break],
) -> Vec<(Interval, Option<usize>)> {
    let (Some(&from), Some(&to)) = (grid.first(), grid.last()) else { return Vec::new() };
    let mut all = Vec::with_capacity(breaks.len() + 1);
    let (mut at, mut winner) = (from, first);
    for b in breaks {
        all.push((Interval { from: at, to: b.value }, winner));
        (at, winner) = (b.value, b.right);
    }
    all.push((Interval { from: at, to }, winner));
    all
}

/// The EIP set of each model, as disjoint intervals.
pub(crate) fn sets(
    stretches: &[(Interval, Option<usize>)],
    models: usize,
) -> (Vec<Vec<Interval>>, Vec<Interval>) {
    let mut sets = vec![Vec::new(); models];
    let mut unstable = Vec::new();
    for &(interval, winner) in stretches {
        match winner {
            Some(w) => sets[w].push(interval),
            None => unstable.push(interval),
        }
    }
    (sets, unstable)
}

/// Boundaries between two winners (ends of unstable stretches are not).
pub(crate) fn boundaries(breaks: &[Break]) -> Vec<Boundary> {
    breaks
        .iter()
        .filter_map(|b| {
            Some(Boundary { value: b.value, uncertainty: b.width, left: b.left?, right: b.right? })
        })
        .collect()
}

/// Stretches whose winner is not the same in every case that has one; cases
/// that are unstable there have their own list.
pub(crate) fn undecidable(cases: &[Vec<(Interval, Option<usize>)>]) -> Vec<Undecidable> {
    let mut ends: Vec<f64> = cases.iter().flatten().flat_map(|(i, _)| [i.from, i.to]).collect();
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    let mut found: Vec<Undecidable> = Vec::new();
    for pair in ends.windows(2) {
        let interval = Interval { from: pair[0], to: pair[1] };
        let middle = 0.5 * (interval.from + interval.to);
        let winners: Vec<Option<usize>> = cases
            .iter()
            .map(|case| {
                case.iter().find(|(i, _)| i.from <= middle && middle <= i.to).and_then(|s| s.1)
            })
            .collect();
        let mut models: Vec<usize> = winners.into_iter().flatten().collect();
        models.sort_unstable();
        models.dedup();
        if models.len() < 2 {
            continue;
        }
        match found.last_mut() {
            Some(last) if last.interval.to == interval.from && last.models == models => {
                last.interval.to = interval.to;
            }
            _ => found.push(Undecidable { interval, models }),
        }
    }
    found
}
