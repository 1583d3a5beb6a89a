//! Riccati, Lyapunov and Sylvester equations on stacked arrays.

use std::borrow::Cow;

use mmae::par::RunControl;
use mmae::solve::{
    Checks, Lyapunov, Method, Riccati, RiccatiOde, Solutions, Sylvester, care_with, dare_with,
    lyapunov_continuous_with, lyapunov_discrete_with, riccati_ode_with, sylvester_continuous_with,
    sylvester_discrete_with,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Array, room};
use crate::errors;
use crate::guard::{self, Call};
use crate::pack::Pack;

/// Multiply-adds below which a call is over before anybody presses Ctrl-C: some
/// ten milliseconds.
const SHORT: f64 = 3e7;
/// Multiply-adds of an equation, in units of n cubed.
const EACH: f64 = 100.0;

/// Arguments of a batch with the dimensions before the last two broadcast.
struct Batch<'a> {
    /// Those dimensions.
    shape: Vec<usize>,
    len: usize,
    data: Vec<Cow<'a, [f64]>>,
}

/// Checks the matrices (`rows` by `cols` each) and brings them to one batch.
fn batch<'a>(
    py: Python<'_>,
    arrays: &[(&'a Array<'_>, [usize; 2])],
    scalar: Option<&'a Array<'_>>,
) -> PyResult<Batch<'a>> {
    for (array, want) in arrays {
        let [.., rows, cols] = array.shape() else { continue };
        if [*rows, *cols] != *want {
            let text = format!(
                "{} is {rows}x{cols}, wanted {}x{}: check the order of rows and columns",
                array.name(),
                want[0],
                want[1]
            );
            return Err(errors::input(py, &text, "shape"));
        }
    }
    let outer = |a: &'a Array<'_>, inner: usize| &a.shape()[..a.shape().len() - inner];
    let mut all: Vec<(&Array<'_>, &[usize], usize)> =
        arrays.iter().map(|(a, want)| (*a, outer(a, 2), want[0] * want[1])).collect();
    all.extend(scalar.map(|a| (a, outer(a, 0), 1)));
    let mut shape: Vec<usize> = Vec::new();
    for (array, own, _) in &all {
        shape = merge(&shape, own).ok_or_else(|| {
            let text = format!(
                "{}: its leading dimensions {own:?} do not go with {shape:?}: give each argument \
                 one matrix, or as many as the others",
                array.name()
            );
            errors::input(py, &text, "shape")
        })?;
    }
    let len = shape.iter().try_fold(1_usize, |n, d| n.checked_mul(*d)).unwrap_or(usize::MAX);
    if len == 0 {
        let empty = all.iter().find(|(_, own, _)| own.contains(&0));
        let name = empty.map_or("batch", |(a, ..)| a.name());
        return Err(errors::input(py, &format!("{name} is empty: give at least one"), "empty"));
    }
    let data = all.into_iter().map(|(array, own, size)| spread(py, array, own, &shape, size));
    Ok(Batch { len, data: data.collect::<PyResult<_>>()?, shape: shape.clone() })
}

/// The shape that two shapes broadcast to.
fn merge(a: &[usize], b: &[usize]) -> Option<Vec<usize>> {
    let n = a.len().max(b.len());
    let at = |s: &[usize], k: usize| (k + s.len()).checked_sub(n).map_or(1, |k| s[k]);
    (0..n)
        .map(|k| match (at(a, k), at(b, k)) {
            (x, y) if x == y || y == 1 => Some(x),
            (1, y) => Some(y),
            _ => None,
        })
        .collect()
}

/// One matrix for all, or one each: in place where the array is like that.
fn spread<'a>(
    py: Python<'_>,
    array: &'a Array<'_>,
    own: &[usize],
    shape: &[usize],
    size: usize,
) -> PyResult<Cow<'a, [f64]>> {
    let data = array.data();
    if own.iter().all(|d| *d == 1)
        || own.iter().product::<usize>() == shape.iter().product::<usize>()
    {
        return Ok(Cow::Borrowed(data));
    }
    let len: u128 = shape.iter().map(|d| *d as u128).product();
    room(py, array.name(), len * size as u128 * 8)?;
    let pad = shape.len() - own.len();
    let mut out = Vec::with_capacity(len as usize * size);
    for item in 0..len as usize {
        let (mut rest, mut index, mut step) = (item, 0, 1);
        for k in (0..shape.len()).rev() {
            let i = rest % shape[k];
            rest /= shape[k];
            if k >= pad {
                let d = own[k - pad];
                index += if d == 1 { 0 } else { i * step };
                step *= d;
            }
        }
        out.extend_from_slice(&data[index * size..][..size]);
    }
    Ok(Cow::Owned(out))
}

/// Rows and columns of the last two dimensions.
fn sizes(py: Python<'_>, a: &Array<'_>, form: &str) -> PyResult<[usize; 2]> {
    a.expect_dims(py, 2, form)?;
    let n = a.shape().len();
    Ok([a.shape()[n - 2], a.shape()[n - 1]])
}

/// Order of a square matrix, at least one.
fn order(py: Python<'_>, a: &Array<'_>) -> PyResult<usize> {
    let [n, cols] = sizes(py, a, "(..., n, n)")?;
    match n {
        0 => Err(errors::input(py, &format!("{} is empty: give at least one", a.name()), "empty")),
        _ if n == cols => Ok(n),
        _ => {
            let text = format!("{} is {n}x{cols}: give a square matrix", a.name());
            Err(errors::input(py, &text, "shape"))
        }
    }
}

fn checks(py: Python<'_>, name: &str) -> PyResult<Checks> {
    match name {
        "all" => Ok(Checks::All),
        "stability" => Ok(Checks::Stability),
        _ => Err(errors::input(py, "checks: write 'all' or 'stability'", "range")),
    }
}

/// Runs a batch and packs its solutions.
fn solve<'py>(
    py: Python<'py>,
    shape: &[usize],
    len: usize,
    [rows, cols]: [usize; 2],
    threads: Option<usize>,
    work: impl FnOnce(&RunControl<'_>) -> mmae::Result<Solutions> + Send,
) -> PyResult<Bound<'py, PyDict>> {
    // results and reports
    room(py, "the batch of solutions", len as u128 * (rows as u128 * cols as u128 * 8 + 400))?;
    let flops = EACH * len as f64 * (rows.max(cols) as f64).powi(3);
    let solved = match flops < SHORT {
        true => guard::short(py, threads, work)?,
        false => guard::long(py, &Call { threads, progress: None }, work)?,
    };
    let solutions = solved.map_err(|e| errors::engine(py, &e))?;
    let Solutions { x, items, .. } = solutions;
    let pack = Pack::new(py);
    let full: Vec<usize> = shape.iter().copied().chain([rows, cols]).collect();
    pack.array("X", x, &full)?;
    let numbers = |f: &dyn Fn(&mmae::solve::ItemReport) -> f64| items.iter().map(f).collect();
    pack.array("residual", numbers(&|i| i.residual), shape)?;
    pack.array("error_bound", numbers(&|i| i.error_bound.unwrap_or(f64::NAN)), shape)?;
    pack.array("condition", numbers(&|i| i.condition.unwrap_or(f64::NAN)), shape)?;
    pack.array("margin", numbers(&|i| i.margin), shape)?;
    pack.array("iterations", items.iter().map(|i| i.iterations).collect(), shape)?;
    pack.array("reliable", items.iter().map(|i| i.reliable).collect(), shape)?;
    let alone = |m: Method| u8::from(m == Method::Fallback);
    pack.array("alone", items.iter().map(|i| alone(i.method)).collect(), shape)?;
    pack.array("failed", items.iter().map(|i| i.status.is_err()).collect(), shape)?;
    let failed = items.iter().enumerate().filter_map(|(k, i)| Some((k, i.status.as_ref().err()?)));
    let errors: Vec<(usize, Py<PyAny>)> =
        failed.map(|(k, e)| (k, errors::engine(py, e).into_value(py).into_any())).collect();
    pack.set("errors", errors)?;
    Ok(pack.0)
}

/// `A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0`, or its discrete sister.
#[pyfunction]
#[pyo3(signature = (a, b, q, r, s, discrete, check, threads))]
#[expect(clippy::too_many_arguments, reason = "the letters of the equation")]
pub(crate) fn care<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    b: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    r: &Bound<'py, PyAny>,
    s: Option<&Bound<'py, PyAny>>,
    discrete: bool,
    check: &str,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let check = checks(py, check)?;
    let (a, b) = (Array::take("A", a)?, Array::take("B", b)?);
    let (q, r) = (Array::take("Q", q)?, Array::take("R", r)?);
    let s = s.map(|s| Array::take("S", s)).transpose()?;
    let n = order(py, &a)?;
    let [_, m] = sizes(py, &b, "(..., n, m)")?;
    q.expect_dims(py, 2, "(..., n, n)")?;
    r.expect_dims(py, 2, "(..., m, m)")?;
    let mut all = vec![(&a, [n, n]), (&b, [n, m]), (&q, [n, n]), (&r, [m, m])];
    if let Some(s) = &s {
        s.expect_dims(py, 2, "(..., n, m)")?;
        all.push((s, [n, m]));
    }
    let Batch { shape, len, data } = batch(py, &all, None)?;
    let problem = Riccati {
        n,
        m,
        len,
        A: &data[0],
        B: &data[1],
        Q: &data[2],
        R: &data[3],
        S: data.get(4).map(|s| &**s),
    };
    solve(py, &shape, len, [n, n], threads, |control| match discrete {
        false => care_with(&problem, check, control),
        true => dare_with(&problem, check, control),
    })
}

/// `A X + X A' + Q = 0`, or `A X A' - X + Q = 0`.
#[pyfunction]
#[pyo3(signature = (a, q, discrete, check, threads))]
pub(crate) fn lyapunov<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    discrete: bool,
    check: &str,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let check = checks(py, check)?;
    let (a, q) = (Array::take("A", a)?, Array::take("Q", q)?);
    let n = order(py, &a)?;
    q.expect_dims(py, 2, "(..., n, n)")?;
    let Batch { shape, len, data } = batch(py, &[(&a, [n, n]), (&q, [n, n])], None)?;
    let problem = Lyapunov { n, len, A: &data[0], Q: &data[1] };
    solve(py, &shape, len, [n, n], threads, |control| match discrete {
        false => lyapunov_continuous_with(&problem, check, control),
        true => lyapunov_discrete_with(&problem, check, control),
    })
}

/// `A X + X B + C = 0`, or `A X B - X + C = 0`.
#[pyfunction]
#[pyo3(signature = (a, b, c, discrete, check, threads))]
pub(crate) fn sylvester<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    b: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
    discrete: bool,
    check: &str,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let check = checks(py, check)?;
    let (a, b, c) = (Array::take("A", a)?, Array::take("B", b)?, Array::take("C", c)?);
    let (n, m) = (order(py, &a)?, order(py, &b)?);
    c.expect_dims(py, 2, "(..., n, m)")?;
    let Batch { shape, len, data } = batch(py, &[(&a, [n, n]), (&b, [m, m]), (&c, [n, m])], None)?;
    let problem = Sylvester { n, m, len, A: &data[0], B: &data[1], C: &data[2] };
    solve(py, &shape, len, [n, m], threads, |control| match discrete {
        false => sylvester_continuous_with(&problem, check, control),
        true => sylvester_discrete_with(&problem, check, control),
    })
}

/// `P(h)` of `dP/dt = F P + P F' - P H' R^-1 H P + Q`.
#[pyfunction]
#[pyo3(signature = (f, h, q, r, p, step, threads))]
#[expect(clippy::too_many_arguments, reason = "the letters of the equation")]
pub(crate) fn riccati_ode<'py>(
    py: Python<'py>,
    f: &Bound<'py, PyAny>,
    h: &Bound<'py, PyAny>,
    q: &Bound<'py, PyAny>,
    r: &Bound<'py, PyAny>,
    p: &Bound<'py, PyAny>,
    step: &Bound<'py, PyAny>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let (f, h) = (Array::take("F", f)?, Array::take("H", h)?);
    let (q, r, p) = (Array::take("Q", q)?, Array::take("R", r)?, Array::take("P", p)?);
    let step = Array::take("h", step)?;
    let n = order(py, &f)?;
    let [m, _] = sizes(py, &h, "(..., m, n)")?;
    for (array, form) in [(&q, "(..., n, n)"), (&r, "(..., m, m)"), (&p, "(..., n, n)")] {
        array.expect_dims(py, 2, form)?;
    }
    let all = [(&f, [n, n]), (&h, [m, n]), (&q, [n, n]), (&r, [m, m]), (&p, [n, n])];
    let Batch { shape, len, data } = batch(py, &all, Some(&step))?;
    let problem = RiccatiOde {
        n,
        m,
        len,
        F: &data[0],
        H: &data[1],
        Q: &data[2],
        R: &data[3],
        P: &data[4],
        h: &data[5],
    };
    solve(py, &shape, len, [n, n], threads, |control| riccati_ode_with(&problem, control))
}

/// Address of the numbers that a call would work on, and whether they are the
/// caller's own.
#[pyfunction]
#[pyo3(name = "_where")]
pub(crate) fn where_from(value: &Bound<'_, PyAny>) -> PyResult<(usize, bool)> {
    let array = Array::take("value", value)?;
    Ok((array.data().as_ptr() as usize, array.is_lent()))
}
