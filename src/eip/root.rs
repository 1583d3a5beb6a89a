//! Roots and minima of one variable from batches of evaluations: eight points
//! cost what one costs.

use crate::simd::LANES;

/// A point and the value there.
pub(crate) type Point = (f64, f64);

/// Distances from the predicted root, as shares of the bracket: a prediction
/// good to any of them shrinks the bracket to that share.
const REACH: [f64; LANES / 2] = [0.2, 0.02, 5e-4, 1e-6];
/// The same for a prediction by a cubic.
const FINE: [f64; LANES / 2] = [0.05, 1e-3, 1e-6, 1e-9];

/// Outcome of [`bracket`].
pub(crate) enum Bracket {
    /// The two ends with their values, of opposite sign (or zero).
    Root(Point, Point),
    /// Where the function had no value.
    Undefined(f64),
}

/// A root of `f` in `[a, b]`, where `f(a)` and `f(b)` differ in sign: points around
/// the place where the points at hand predict it, and sections by nine after every
/// round in which these would have done better.
///
/// Returns the final bracket, narrower than `width` or the spacing of floating
/// point numbers; of several roots the first that the sections see. An `f`
/// that is `None` ends the search at that point.
pub(crate) fn bracket<E>(
    mut a: Point,
    mut b: Point,
    width: f64,
    mut f: impl FnMut(&[f64]) -> Result<Vec<Option<f64>>, E>,
) -> Result<Bracket, E> {
    let mut near = true;
    // the nearest points outside
    let (mut before, mut after) = (None, None);
    // sections alone need 35 rounds for the whole range of a double's digits
    for _ in 0..80 {
        let size = b.0 - a.0;
        let enough = width.max(2.0 * f64::EPSILON * a.0.abs().max(b.0.abs()));
        if a.1 == 0.0 {
            return Ok(Bracket::Root(a, a));
        }
        if b.1 == 0.0 {
            return Ok(Bracket::Root(b, b));
        }
        if size <= enough {
            break;
        }
        let points = if near {
            match predicted([before, Some(a), Some(b), after]) {
                Some(root) => around(root, FINE, a, b, enough),
                None => around(a.0 + size * (a.1 / (a.1 - b.1)), REACH, a, b, enough),
            }
        } else {
            sections(a.0, b.0)
        };
        let values = f(&points)?;
        let sign = b.1 > 0.0;
        let mut right = None;
        for (&x, value) in points.iter().zip(values) {
            if right.is_some() {
                after = value.map(|y| (x, y)).or(after);
                break;
            }
            let Some(y) = value else { return Ok(Bracket::Undefined(x)) };
            if y == 0.0 || (y > 0.0) == sign {
                right = Some((x, y));
                after = Some(b);
            } else {
                (before, a) = (Some(a), (x, y));
            }
        }
        b = right.unwrap_or(b);
        near = !near || b.0 - a.0 <= size / 9.0;
    }
    Ok(Bracket::Root(a, b))
}

/// Points that cut `[a, b]` into nine equal parts.
pub(crate) fn sections(a: f64, b: f64) -> Vec<f64> {
    let n = (LANES + 1) as f64;
    let mut points: Vec<f64> = (1..=LANES).map(|k| a + (b - a) * (k as f64 / n)).collect();
    points.retain(|x| *x > a && *x < b);
    points.dedup();
    if points.is_empty() { vec![0.5 * (a + b)] } else { points }
}

/// Points on both sides of `root`, inside `(a, b)`.
fn around(root: f64, shares: [f64; LANES / 2], a: Point, b: Point, enough: f64) -> Vec<f64> {
    let size = b.0 - a.0;
    let (low, high) = (a.0 + 0.2 * enough, b.0 - 0.2 * enough);
    let mut points = Vec::with_capacity(LANES);
    for share in shares {
        let reach = (share * size).max(0.4 * enough);
        points.push((root - reach).clamp(low, high));
        points.push((root + reach).clamp(low, high));
    }
    points.sort_by(f64::total_cmp);
    points.dedup();
    points
}

/// Where the cubic `x(y)` through four points of a falling or rising function has `y = 0`
/// (Neville's scheme); `None` if it is not between the inner two.
fn predicted(points: [Option<Point>; 4]) -> Option<f64> {
    let [Some(p), Some(a), Some(b), Some(q)] = points else { return None };
    let y = [p.1, a.1, b.1, q.1];
    let monotone = y.is_sorted_by(|u, v| u < v) || y.is_sorted_by(|u, v| u > v);
    if !monotone {
        return None;
    }
    // from the left end of the bracket: differences keep their digits
    let mut x = [p.0 - a.0, 0.0, b.0 - a.0, q.0 - a.0];
    for step in 1..4 {
        for i in 0..4 - step {
            x[i] = (x[i] * y[i + step] - x[i + 1] * y[i]) / (y[i + step] - y[i]);
        }
    }
    (x[0] > 0.0 && x[0] < b.0 - a.0).then_some(a.0 + x[0])
}

/// Looks in `[a, b]`, where `f` is positive at both ends, for a point where it
/// is negative, by sections towards its minimum; `None` if `f` stays positive
/// there or has no value.
pub(crate) fn negative_point<E>(
    mut a: Point,
    mut b: Point,
    mut f: impl FnMut(&[f64]) -> Result<Vec<Option<f64>>, E>,
) -> Result<Option<f64>, E> {
    let span = b.0 - a.0;
    for round in 0.. {
        let mut points = vec![a];
        let inner = sections(a.0, b.0);
        for (&x, value) in inner.iter().zip(f(&inner)?) {
            let Some(y) = value else { return Ok(None) };
            points.push((x, y));
        }
        points.push(b);
        let mut least = 1;
        for k in 1..points.len() - 1 {
            if points[k].1 < points[least].1 {
                least = k;
            }
        }
        let middle = points[least];
        if middle.1 < 0.0 {
            return Ok(Some(middle.0));
        }
        (a, b) = (points[least - 1], points[least + 1]);
        // the parabola is close once the first sections have been cut again
        let hopeless = round > 0 && vertex(a, middle, b).is_none_or(|v| v.1 > 0.5 * middle.1);
        if hopeless || b.0 - a.0 <= 1e-9 * span {
            break;
        }
    }
    Ok(None)
}

/// Minimum of the parabola through three points with different abscissas, from
/// divided differences; `None` if it has none.
pub(crate) fn vertex(p: Point, q: Point, r: Point) -> Option<Point> {
    let first = (q.1 - p.1) / (q.0 - p.0);
    let second = (r.1 - q.1) / (r.0 - q.0);
    let bend = (second - first) / (r.0 - p.0);
    // false for NaN, too
    if bend > 0.0 {
        let x = 0.5 * (p.0 + q.0 - first / bend);
        Some((x, p.1 + first * (x - p.0) + bend * (x - p.0) * (x - q.0)))
    } else {
        None
    }
}

/// How far from the root `x` the function `f`, which rises there, may stay
/// below `error` in size: looked for on both sides as far as `ends`, from
/// `cell`, the scale on which `f` varies.
pub(crate) fn reach<E>(
    x: f64,
    error: f64,
    cell: f64,
    ends: (f64, f64),
    mut f: impl FnMut(&[f64]) -> Result<Vec<Option<f64>>, E>,
) -> Result<f64, E> {
    const SHARES: [[f64; LANES / 2]; 2] = [[1e-8, 1e-6, 1e-4, 1e-2], [0.03, 0.1, 0.3, 1.0]];
    // distances with the smaller size of the two sides, the largest first
    let mut sizes: Vec<Point> = Vec::with_capacity(LANES);
    for shares in SHARES {
        let mut points = Vec::with_capacity(LANES);
        for share in shares {
            points.push((x - share * cell).max(ends.0));
            points.push((x + share * cell).min(ends.1));
        }
        let values = f(&points)?;
        for (k, share) in shares.into_iter().enumerate() {
            let mut size = f64::INFINITY;
            for (side, sign) in [(2 * k, -1.0), (2 * k + 1, 1.0)] {
                // an end of the grid bounds the search, not the root
                if points[side] != x
                    && let Some(y) = values[side]
                {
                    size = size.min(sign * y);
                }
            }
            if size.is_finite() {
                sizes.insert(0, (share * cell, size));
            }
        }
        if sizes.first().is_some_and(|s| s.1 > error) {
            break;
        }
    }
    // down from the largest: what noise lifts above the error further in does
    // not count
    let mut found: Option<Point> = None;
    for (h, size) in sizes {
        if size > error {
            found = Some((h, size));
            continue;
        }
        return Ok(match found {
            // between the two by the power law through them
            Some((h1, size1)) if size > 0.0 => {
                let power = libm::log(size1 / size) / libm::log(h1 / h);
                h * libm::exp(libm::log(error / size) / power)
            }
            Some((h1, _)) => h1,
            None => h,
        });
    }
    Ok(found.map_or(0.0, |(h, size)| h * (error / size)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(xs: &[f64], f: impl Fn(f64) -> f64) -> Result<Vec<Option<f64>>, ()> {
        Ok(xs.iter().map(|&x| Some(f(x))).collect())
    }

    #[test]
    fn finds_roots_of_easy_and_flat_functions() {
        type Case = (fn(f64) -> f64, f64, f64, f64, usize);
        let functions: [Case; 4] = [
            (|x| x * x - 2.0, 0.0, 2.0, 2.0_f64.sqrt(), 6),
            (|x| x.exp() - 1e-3, -20.0, 5.0, 1e-3_f64.ln(), 16),
            (|x| (x - 0.3).powi(9), -1.0, 2.0, 0.3, 36),
            (|x| if x < 0.7 { -1e-9 } else { 1e9 }, 0.0, 1.0, 0.7, 36),
        ];
        for (f, a, b, root, rounds) in functions {
            let mut calls = 0;
            let found = bracket((a, f(a)), (b, f(b)), 1e-12, |xs| {
                calls += 1;
                all(xs, f)
            });
            let Ok(Bracket::Root(low, high)) = found else { panic!("no root of f") };
            let tolerance = if root == 0.3 { 1e-2 } else { 1e-11 };
            assert!(
                (low.0 - root).abs() < tolerance || (high.0 - root).abs() < tolerance,
                "{root}: {low:?} {high:?} in {calls}"
            );
            assert!(calls <= rounds, "{root}: {calls} calls");
        }
    }

    #[test]
    fn finds_a_dip_between_two_positive_ends() {
        let f = |x: f64| (x - 0.37).powi(2) - 1e-6;
        let ends = |f: &dyn Fn(f64) -> f64| ((0.0, f(0.0)), (1.0, f(1.0)));
        let (a, b) = ends(&f);
        let found = negative_point(a, b, |xs| all(xs, f)).unwrap();
        assert!(found.is_some_and(|x| f(x) < 0.0));
        let g = |x| f(x) + 1e-3;
        let (a, b) = ends(&g);
        assert!(negative_point(a, b, |xs| all(xs, g)).unwrap().is_none());
    }

    #[test]
    fn parabolas_on_uneven_points() {
        let f = |x: f64| 3.0 * (x - 0.2).powi(2) + 0.5;
        let at = |x| (x, f(x));
        let (x, y) = vertex(at(1.0), at(10.0), at(1000.0)).unwrap();
        assert!((x - 0.2).abs() < 1e-12 && (y - 0.5).abs() < 1e-12);
        assert!(vertex((0.0, 0.0), (1.0, 1.0), (2.0, 2.0)).is_none());
    }

    #[test]
    fn a_flat_root_is_less_certain_than_a_steep_one() {
        let reach_of =
            |f: fn(f64) -> f64| reach(0.0, 1e-9, 0.1, (-1.0, 1.0), |xs| all(xs, f)).unwrap();
        let steep = reach_of(|x| 40.0 * x);
        assert!((steep / 2.5e-11 - 1.0).abs() < 1e-6, "{steep}");
        let flat = reach_of(|x| 40.0 * x.powi(3) + 1e-4 * x);
        // 1e-4 x reaches 1e-9 at 1e-5
        assert!((0.5e-5..2e-5).contains(&flat), "{flat}");
        let flatter = reach_of(|x| x.powi(3));
        assert!((0.9e-3..1.1e-3).contains(&flatter), "{flatter}");
        assert_eq!(reach_of(|_| 0.0), 0.1);
    }
}
