//! EIP sets and placement.

use mmae::eip::{Cells, EipSets, Method};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors;
use crate::guard::{self, Call};
use crate::pack::Pack;
use crate::scenario::Scenario;

/// No model, where an index is wanted.
const NONE: i64 = -1;

fn index(model: Option<usize>) -> i64 {
    model.and_then(|i| i64::try_from(i).ok()).unwrap_or(NONE)
}

/// The EIP sets of a scenario.
#[pyfunction]
#[pyo3(signature = (scenario, threads, progress))]
pub(crate) fn eip<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    threads: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let scenario = &scenario.inner;
    let study = scenario.study().map_err(|e| errors::scenario(py, &e))?;
    let ran = guard::long(py, &Call { threads, progress }, |control| study.run(control))?;
    let sets = ran.map_err(|e| errors::scenario(py, &scenario.explain(e)))?;
    pack(py, sets)
}

fn pack(py: Python<'_>, sets: EipSets) -> PyResult<Bound<'_, PyDict>> {
    let json = mmae::report::json::to_string(&sets);
    let out = Pack::new(py);
    let (plants, models, cases) = (sets.grid.len(), sets.models.len(), sets.cases.len());
    let pseudo = sets.pseudo_norms();
    out.set("json", json)?;
    out.set("title", &sets.title)?;
    out.set("convention", sets.convention.name())?;
    let method = match sets.method {
        Method::Doubling => "doubling",
        Method::Modal => "modal",
    };
    out.set("method", method)?;
    out.set("parameters", &sets.parameters)?;
    let values: Vec<f64> = sets.models.iter().flat_map(|m| m.values.iter().copied()).collect();
    out.array("values", values, &[models, sets.parameters.len()])?;
    let labels: Vec<&str> = sets.models.iter().map(|m| m.label.as_str()).collect();
    out.set("labels", labels)?;
    let axes: Vec<(&str, Bound<'_, PyAny>)> = sets
        .grid
        .axes()
        .iter()
        .map(|(name, axis)| {
            let values = crate::pack::array(py, axis.values(), &[axis.len()])?;
            Ok((name.as_str(), values.into_any()))
        })
        .collect::<PyResult<_>>()?;
    out.set("axes", axes)?;
    let failures: Vec<(usize, String)> = sets
        .models
        .iter()
        .enumerate()
        .filter_map(|(i, m)| Some((i, m.failure.as_ref()?.to_string())))
        .collect();
    out.set("failures", failures)?;
    let twins = sets.models.iter().map(|m| index(m.duplicate_of)).collect();
    out.array("duplicate_of", twins, &[models])?;
    out.array("at_nominals", sets.at_nominals, &[models, models])?;
    out.array("pseudo_norm", pseudo, &[models, models])?;
    let undecidable: Vec<(f64, f64, Vec<usize>)> =
        sets.undecidable.into_iter().map(|u| (u.interval.from, u.interval.to, u.models)).collect();
    out.set("undecidable", undecidable)?;
    let (mut upsilon, mut error) = (Vec::new(), Vec::new());
    let (mut winner, mut margin, mut status) = (Vec::new(), Vec::new(), Vec::new());
    let (mut boundaries, mut intervals, mut messages) = (Vec::new(), Vec::new(), Vec::new());
    for (k, case) in sets.cases.iter().enumerate() {
        upsilon.extend_from_slice(&case.upsilon);
        error.extend_from_slice(&case.error);
        // nothing where no error is known
        error.resize(upsilon.len(), f64::NAN);
        winner.extend(case.winner.iter().map(|w| index(*w)));
        margin.extend_from_slice(&case.margin);
        let mut state = vec![0_i8; plants];
        case.unstable.iter().for_each(|p| state[p.plant] = 1);
        case.failed.iter().for_each(|p| state[p.plant] = 2);
        case.undecided.iter().for_each(|p| state[p.plant] = 3);
        status.extend(state);
        messages.extend(case.failed.iter().map(|p| (k, p.plant, p.error.to_string())));
        boundaries
            .extend(case.boundaries.iter().map(|b| (k, b.value, b.uncertainty, b.left, b.right)));
        for (model, set) in case.sets.iter().enumerate() {
            intervals.extend(set.iter().map(|i| (k, model, i.from, i.to)));
        }
    }
    out.array("upsilon", upsilon, &[cases, plants, models])?;
    out.array("error", error, &[cases, plants, models])?;
    out.array("winner", winner, &[cases, plants])?;
    out.array("margin", margin, &[cases, plants])?;
    out.array("status", status, &[cases, plants])?;
    out.set("boundaries", boundaries)?;
    out.set("intervals", intervals)?;
    out.set("messages", messages)?;
    let each = |f: &dyn Fn(&mmae::eip::Case) -> f64| sets.cases.iter().map(f).collect();
    out.array("delays", each(&|c| c.delay), &[cases])?;
    out.array("route_difference", each(&|c| c.route_difference), &[cases])?;
    let counts = |f: &dyn Fn(&mmae::eip::Case) -> usize| sets.cases.iter().map(f).collect();
    out.array::<usize>("checked_pairs", counts(&|c| c.checked_pairs), &[cases])?;
    out.array::<usize>("replaced", counts(&|c| c.replaced), &[cases])?;
    Ok(out.0)
}

/// Nominal values whose sets are the cells wanted.
#[pyfunction]
#[pyo3(signature = (scenario, cells, edges, excess, anchor, threads))]
pub(crate) fn place<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    cells: Option<usize>,
    edges: Option<Vec<f64>>,
    excess: Option<f64>,
    anchor: Option<f64>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let scenario = &scenario.inner;
    let study = scenario.study().map_err(|e| errors::scenario(py, &e))?;
    let cells = match (cells, edges, excess) {
        (_, _, Some(bound)) => Cells::Within(bound),
        (_, Some(edges), _) => Cells::Edges(edges),
        (count, ..) => Cells::Count(count.unwrap_or(study.bank.models.len())),
    };
    let call = Call { threads, progress: None };
    let placed = guard::long(py, &call, |control| study.place(&cells, anchor, control))?;
    let placed = placed.map_err(|e| errors::scenario(py, &scenario.explain(e)))?;
    let out = Pack::new(py);
    out.set("parameter", &placed.parameter)?;
    out.set("domain", placed.domain)?;
    out.set("feasible", placed.feasible)?;
    for (name, list) in [
        ("nominals", placed.nominals),
        ("wanted", placed.wanted),
        ("edges", placed.edges),
        ("excess", placed.excess),
        ("sensitivity", placed.sensitivity),
    ] {
        let n = list.len();
        out.array(name, list, &[n])?;
    }
    Ok(out.0)
}
