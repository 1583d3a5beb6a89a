//! Bracketed root finding and minimisation of one variable.

/// A root of `f` in `[a, b]` where `f(a)` and `f(b)` differ in sign: false
/// position with Anderson and Bjoerck's weights, and a bisection after a step that
/// has not halved the bracket.
///
/// Returns the final bracket, narrower than `width` or the spacing of floating
/// point numbers. An `f` that is `None` ends the search at that point.
pub(crate) fn bracket<E>(
    mut a: (f64, f64),
    mut b: (f64, f64),
    width: f64,
    mut f: impl FnMut(f64) -> Result<Option<f64>, E>,
) -> Result<Bracket, E> {
    let (mut weight_a, mut weight_b) = (1.0, 1.0);
    let (mut last_width, mut bisected) = ((b.0 - a.0).abs(), false);
    // a root on an end needs no search
    if a.1 == 0.0 {
        return Ok(Bracket::Root(a, a));
    }
    if b.1 == 0.0 {
        return Ok(Bracket::Root(b, b));
    }
    for step in 1.. {
        let size = (b.0 - a.0).abs();
        let resolution = 2.0 * f64::EPSILON * a.0.abs().max(b.0.abs());
        if size <= width.max(resolution) || step > 200 {
            break;
        }
        let (fa, fb) = (a.1 * weight_a, b.1 * weight_b);
        let mut x = a.0 + (b.0 - a.0) * (fa / (fa - fb));
        let middle = 0.5 * (a.0 + b.0);
        if step > 1 && size > 0.5 * last_width && !bisected {
            x = middle;
            bisected = true;
        } else {
            bisected = false;
        }
        last_width = size;
        // a step that lands on an end would stall
        let inset = 0.25 * width.max(resolution);
        let (low, high) = (a.0.min(b.0) + inset, a.0.max(b.0) - inset);
        if !(low..=high).contains(&x) {
            x = if low <= high { x.clamp(low, high) } else { middle };
        }
        let Some(fx) = f(x)? else { return Ok(Bracket::Undefined(x)) };
        if fx == 0.0 {
            return Ok(Bracket::Root((x, fx), (x, fx)));
        }
        if (fx > 0.0) == (b.1 > 0.0) {
            let m = 1.0 - fx / b.1;
            weight_a *= if m > 0.0 { m } else { 0.5 };
            weight_b = 1.0;
            b = (x, fx);
        } else {
            let m = 1.0 - fx / a.1;
            weight_b *= if m > 0.0 { m } else { 0.5 };
            weight_a = 1.0;
            a = (x, fx);
        }
    }
    Ok(Bracket::Root(a, b))
}

/// Outcome of [`bracket`].
pub(crate) enum Bracket {
    /// The two ends with their values, of opposite sign (or zero).
    Root((f64, f64), (f64, f64)),
    /// Where the function had no value.
    Undefined(f64),
}

/// Looks in `[a, b]` for a point where `f` is negative, by golden section
/// towards its minimum; `None` if `f` stays positive there.
pub(crate) fn negative_point<E>(
    mut a: f64,
    mut b: f64,
    mut f: impl FnMut(f64) -> Result<Option<f64>, E>,
) -> Result<Option<f64>, E> {
    const GOLDEN: f64 = 0.381_966_011_250_105_1;
    let span = b - a;
    let (mut x, mut y) = (a + GOLDEN * span, b - GOLDEN * span);
    let (mut fx, mut fy) = (f(x)?, f(y)?);
    for _ in 0..48 {
        for (at, value) in [(x, fx), (y, fy)] {
            match value {
                None => return Ok(None),
                Some(v) if v < 0.0 => return Ok(Some(at)),
                Some(_) => {}
            }
        }
        if (b - a) <= 1e-9 * span {
            break;
        }
        if fx < fy {
            (b, y, fy) = (y, x, fx);
            x = a + GOLDEN * (b - a);
            fx = f(x)?;
        } else {
            (a, x, fx) = (x, y, fy);
            y = b - GOLDEN * (b - a);
            fy = f(y)?;
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_roots_of_easy_and_flat_functions() {
        type Case = (fn(f64) -> f64, f64, f64, f64);
        let functions: [Case; 4] = [
            (|x| x * x - 2.0, 0.0, 2.0, 2.0_f64.sqrt()),
            (|x| x.exp() - 1e-3, -20.0, 5.0, 1e-3_f64.ln()),
            (|x| (x - 0.3).powi(9), -1.0, 2.0, 0.3),
            (|x| if x < 0.7 { -1e-9 } else { 1e9 }, 0.0, 1.0, 0.7),
        ];
        for (f, a, b, root) in functions {
            let mut calls = 0;
            let found = bracket::<()>((a, f(a)), (b, f(b)), 1e-12, |x| {
                calls += 1;
                Ok(Some(f(x)))
            });
            let Ok(Bracket::Root(low, high)) = found else { panic!("no root of f") };
            let tolerance = if root == 0.3 { 1e-2 } else { 1e-11 };
            assert!(
                (low.0 - root).abs() < tolerance || (high.0 - root).abs() < tolerance,
                "{root}: {low:?} {high:?} in {calls}"
            );
            assert!(calls < 140, "{calls} calls");
        }
    }

    #[test]
    fn finds_a_dip_between_two_positive_ends() {
        let f = |x: f64| (x - 0.37).powi(2) - 1e-6;
        let found = negative_point::<()>(0.0, 1.0, |x| Ok(Some(f(x)))).unwrap();
        assert!(found.is_some_and(|x| f(x) < 0.0));
        let none = negative_point::<()>(0.0, 1.0, |x| Ok(Some(f(x) + 1e-3))).unwrap();
        assert!(none.is_none());
    }
}
