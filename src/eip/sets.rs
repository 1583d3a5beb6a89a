//! Who wins at a plant, and the stretches of one parameter.

use crate::eip::{Boundary, Doubt, Interval, Undecidable};

/// Models within this share of the smallest Upsilon are taken for equal, and
/// the first of them wins: models that are the same to rounding then share one
/// interval instead of taking turns.
pub(crate) const TIE: f64 = 1e-12;
/// Two models whose error estimates together are below this share of Upsilon
/// are trusted even where they come closer than that: a plant on a boundary has
/// a winner, too, and the estimate of the quadrature is pessimistic.
const SHARP: f64 = 1e-9;

/// What is known of a parameter value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The model of this index wins.
    Winner(usize),
    /// The loop is unstable.
    Unstable,
    /// The winner is withheld.
    Undecided,
    /// The plant cannot be built.
    Failed,
}

impl Verdict {
    pub(crate) fn winner(self) -> Option<usize> {
        match self {
            Verdict::Winner(w) => Some(w),
            _ => None,
        }
    }
}

/// Where the verdict changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Break {
    pub(crate) value: f64,
    pub(crate) uncertainty: f64,
    pub(crate) left: Verdict,
    pub(crate) right: Verdict,
}

/// The smallest number, NaN left out; infinite if there is no other.
pub(crate) fn least(numbers: &[f64]) -> f64 {
    // Eight chains, in vectors: one would wait for every comparison.
    let (blocks, rest) = numbers.as_chunks::<8>();
    let mut parts = [f64::INFINITY; 8];
    let smaller = |x: f64, than: f64| if x < than { x } else { than };
    for block in blocks {
        for (part, &x) in parts.iter_mut().zip(block) {
            *part = smaller(x, *part);
        }
    }
    let whole = rest.iter().fold(f64::INFINITY, |least, &x| smaller(x, least));
    parts.iter().fold(whole, |least, &x| smaller(x, least))
}

/// The winner of a row: the first that is equal to the smallest number, to
/// [`TIE`]; `None` if all are NaN.
pub(crate) fn winner(row: &[f64]) -> Option<usize> {
    let least = least(row);
    let limit = least + TIE * least.abs();
    row.iter().position(|&v| v <= limit)
}

/// Runner-up less winner, leaving out duplicates of the winner; infinite if there is
/// none.
pub(crate) fn margin(row: &[f64], winner: usize, duplicate_of: &[Option<usize>]) -> f64 {
    let (before, after) = (&row[..winner], &row[winner + 1..]);
    let mut next = least(before).min(least(after));
    let own = |i: usize| is_same(i, winner, duplicate_of);
    if row.iter().enumerate().any(|(i, &u)| u == next && i != winner && own(i)) {
        let others = row.iter().enumerate().filter(|&(i, _)| !own(i));
        next = others.fold(f64::INFINITY, |least, (_, &u)| if u < least { u } else { least });
    }
    let margin = next - row[winner];
    if margin.is_nan() { f64::INFINITY } else { margin }
}

/// True if two models have the same observer.
pub(crate) fn is_same(i: usize, j: usize, duplicate_of: &[Option<usize>]) -> bool {
    duplicate_of[i].unwrap_or(i) == duplicate_of[j].unwrap_or(j)
}

/// The winner, or why it must be withheld: one of the `designed` models has no
/// number, or a rival is closer than the errors (NaN, or none at all: not known, taken
/// for small) and these are not small themselves.
pub(crate) fn decide(
    row: &[f64],
    error: &[f64],
    designed: &[usize],
    duplicate_of: &[Option<usize>],
) -> Result<usize, Doubt> {
    let missing = row.iter().fold(false, |missing, u| missing | u.is_nan());
    let unknown: Vec<usize> = if missing {
        designed.iter().copied().filter(|&i| row[i].is_nan()).collect()
    } else {
        Vec::new()
    };
    let Some(w) = winner(row).filter(|_| unknown.is_empty()) else {
        return Err(Doubt::NoNumber { models: unknown });
    };
    if error.iter().all(|e| e.is_nan()) {
        return Ok(w);
    }
    let own = |i: usize| if error[i].is_nan() { 0.0 } else { error[i] };
    let mut models = vec![w];
    let mut closest = (f64::INFINITY, 0.0);
    for &i in designed {
        let (margin, both) = (row[i] - row[w], own(i) + own(w));
        let close = margin <= both && both > SHARP * row[w].abs().max(row[i].abs());
        if close && !is_same(w, i, duplicate_of) {
            models.push(i);
            if margin < closest.0 {
                closest = (margin, both);
            }
        }
    }
    if models.len() == 1 {
        return Ok(w);
    }
    Err(Doubt::Margin { models, margin: closest.0, error: closest.1 })
}

/// The winner of `row` and the models that it does not lead by more than their
/// errors (not known: NaN).
pub(crate) fn contenders(
    row: &[f64],
    error: &[f64],
    designed: &[usize],
    duplicate_of: &[Option<usize>],
) -> Vec<usize> {
    let Some(w) = winner(row) else { return Vec::new() };
    let leads = |i: usize| row[i] - row[w] > error[i] + error[w];
    let close = |i: usize| i != w && !is_same(w, i, duplicate_of) && !leads(i);
    let mut found: Vec<usize> = designed.iter().copied().filter(|&i| close(i)).collect();
    if !found.is_empty() {
        found.push(w);
    }
    found
}

/// Stretches of the parameter with their verdict, from the first grid value to
/// the last.
pub(crate) fn stretches(
    grid: &[f64],
    first: Verdict,
    breaks: &[Break],
) -> Vec<(Interval, Verdict)> {
    let (Some(&from), Some(&to)) = (grid.first(), grid.last()) else { return Vec::new() };
    let mut all = Vec::with_capacity(breaks.len() + 1);
    let (mut at, mut verdict) = (from, first);
    for b in breaks {
        all.push((Interval { from: at, to: b.value }, verdict));
        (at, verdict) = (b.value, b.right);
    }
    all.push((Interval { from: at, to }, verdict));
    all
}

/// The stretches with a verdict, as disjoint intervals.
pub(crate) fn intervals(stretches: &[(Interval, Verdict)], of: Verdict) -> Vec<Interval> {
    stretches.iter().filter(|s| s.1 == of).map(|s| s.0).collect()
}

/// The EIP set of each model, as disjoint intervals.
pub(crate) fn sets(stretches: &[(Interval, Verdict)], models: usize) -> Vec<Vec<Interval>> {
    let mut sets = vec![Vec::new(); models];
    for &(interval, verdict) in stretches {
        if let Verdict::Winner(w) = verdict {
            sets[w].push(interval);
        }
    }
    sets
}

/// Boundaries between two winners (ends of other stretches are not).
pub(crate) fn boundaries(breaks: &[Break]) -> Vec<Boundary> {
    let between = |b: &Break| {
        Some(Boundary {
            value: b.value,
            uncertainty: b.uncertainty,
            left: b.left.winner()?,
            right: b.right.winner()?,
        })
    };
    breaks.iter().filter_map(between).collect()
}

/// Stretches whose winner is not the same in every case that has one; cases
/// without a winner there have their own lists.
pub(crate) fn undecidable(cases: &[Vec<(Interval, Verdict)>]) -> Vec<Undecidable> {
    let mut ends: Vec<f64> = cases.iter().flatten().flat_map(|(i, _)| [i.from, i.to]).collect();
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    let mut found: Vec<Undecidable> = Vec::new();
    for pair in ends.windows(2) {
        let interval = Interval { from: pair[0], to: pair[1] };
        let middle = 0.5 * (interval.from + interval.to);
        let winners = cases.iter().map(|case| {
            let inside = case.iter().find(|(i, _)| i.from <= middle && middle <= i.to);
            inside.and_then(|s| s.1.winner())
        });
        let mut models: Vec<usize> = winners.flatten().collect();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_equals_wins() {
        assert_eq!(winner(&[2.0, 1.0 + 1e-14, 1.0, 3.0]), Some(1));
        assert_eq!(winner(&[2.0, 1.0 + 1e-11, 1.0, 3.0]), Some(2));
        assert_eq!(winner(&[f64::NAN, -1.0 + 1e-14, -1.0]), Some(1));
        assert_eq!(winner(&[f64::NAN; 2]), None);
    }

    #[test]
    fn a_winner_needs_a_margin_above_the_errors() {
        let none = [None; 3];
        let all = [0, 1, 2];
        assert_eq!(decide(&[1.0, 1.1, 3.0], &[0.01; 3], &all, &none), Ok(0));
        let doubt = decide(&[1.0, 1.1, 3.0], &[0.01, 0.2, 0.2], &all, &none).unwrap_err();
        assert_eq!(doubt.models(), [0, 1]);
        // errors that are small may decide a tie either way
        assert_eq!(decide(&[1.0, 1.0, 3.0], &[1e-10; 3], &all, &none), Ok(0));
        assert_eq!(decide(&[1.0, 1.0, 3.0], &[f64::NAN; 3], &all, &none), Ok(0));
        // a duplicate is no rival
        let twice = [None, Some(0), None];
        assert_eq!(decide(&[1.0, 1.0, 3.0], &[0.1; 3], &all, &twice), Ok(0));
        // a model without a number might win; one that failed does not
        let row = [1.0, f64::NAN, 3.0];
        let doubt = decide(&row, &[0.0; 3], &all, &none).unwrap_err();
        assert_eq!(doubt, Doubt::NoNumber { models: vec![1] });
        assert_eq!(decide(&row, &[0.0; 3], &[0, 2], &none), Ok(0));
    }
}
