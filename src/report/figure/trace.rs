//! Curves as points of the picture: cut to a stretch, thinned to the pixels.

/// More points than this on a curve are thinned to the extremes of columns.
const DENSE: usize = 2000;

/// The part of a curve between two pixel columns, ends interpolated.
pub(super) fn cut(points: &[(f64, f64)], from: f64, to: f64) -> Vec<(f64, f64)> {
    let first = points.partition_point(|p| p.0 < from);
    let last = points.partition_point(|p| p.0 <= to);
    let at = |x: f64, k: usize| {
        let (a, b) = (points.get(k.checked_sub(1)?)?, points.get(k)?);
        let share = (x - a.0) / (b.0 - a.0);
        let y = a.1 + share * (b.1 - a.1);
        y.is_finite().then_some((x, y))
    };
    let mut inside: Vec<(f64, f64)> = Vec::with_capacity(last.saturating_sub(first) + 2);
    if points.get(first).is_some_and(|p| p.0 > from) {
        inside.extend(at(from, first));
    }
    if first < last {
        inside.extend(&points[first..last]);
    }
    if last > 0 && points[last - 1].0 < to {
        inside.extend(at(to, last));
    }
    inside
}

/// A long curve reduced to the extremes of columns a pixel wide.
pub(super) fn thinned(points: &[(f64, f64)], left: f64) -> Vec<(f64, f64)> {
    if points.len() <= DENSE {
        return points.to_vec();
    }
    let column = |p: &(f64, f64)| (p.0 - left).floor();
    let mut thin = Vec::new();
    for chunk in points.chunk_by(|a, b| column(a) == column(b) && a.1.is_nan() == b.1.is_nan()) {
        let (mut low, mut high) = (0, 0);
        for (k, p) in chunk.iter().enumerate() {
            if p.1 < chunk[low].1 {
                low = k;
            }
            if p.1 > chunk[high].1 {
                high = k;
            }
        }
        let mut keep = [0, low, high, chunk.len() - 1];
        keep.sort_unstable();
        let mut last = None;
        for k in keep {
            if last != Some(k) {
                thin.push(chunk[k]);
            }
            last = Some(k);
        }
    }
    thin
}
