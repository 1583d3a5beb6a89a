//! Shards of a study and their merge.

use std::path::PathBuf;

use mmae::sweep::{self, Mode, Options, Plan, Shard};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors;
use crate::guard::{self, Call};
use crate::pack::Pack;
use crate::scenario::Scenario;

/// The study of a scenario in parts; `salt` tells plants that are not in its text.
fn plan(
    py: Python<'_>,
    scenario: &Scenario,
    salt: &[u8],
    block: Option<usize>,
    refine: bool,
) -> PyResult<Plan> {
    let study = scenario.inner.study().map_err(|e| errors::scenario(py, &e))?;
    let bytes = [scenario.text.as_bytes(), salt].concat();
    let options = Options { block, refine };
    let seed = scenario.inner.seed();
    let made = guard::short(py, Some(1), |_| Plan::new(study, &bytes, seed, options))?;
    made.map_err(|e| errors::scenario(py, &scenario.inner.explain(e)))
}

/// Number of blocks.
#[pyfunction]
#[pyo3(signature = (scenario, salt, block, refine))]
pub(crate) fn blocks(
    py: Python<'_>,
    scenario: &Scenario,
    salt: &[u8],
    block: Option<usize>,
    refine: bool,
) -> PyResult<usize> {
    Ok(plan(py, scenario, salt, block, refine)?.blocks())
}

/// Digest of the manifest in `dir` if it holds all parts of the study, and all are
/// sound.
#[pyfunction]
#[pyo3(signature = (scenario, salt, block, refine, dir))]
pub(crate) fn complete(
    py: Python<'_>,
    scenario: &Scenario,
    salt: &[u8],
    block: Option<usize>,
    refine: bool,
    dir: PathBuf,
) -> PyResult<Option<String>> {
    let plan = plan(py, scenario, salt, block, refine)?;
    let path = dir.join("manifest.json");
    if !path.is_file() {
        return Ok(None);
    }
    let call = Call::default();
    let looked = guard::long(py, &call, |_| {
        let found = sweep::look(&[&dir])?;
        let ours = found.study.as_ref() == Some(plan.identity());
        let sound = ours && found.problems().is_empty() && found.damaged.is_empty();
        Ok::<_, sweep::Error>(sound)
    })?;
    match looked.map_err(|e| errors::sweep(py, &e))? {
        true => {
            let bytes = std::fs::read(&path)?;
            Ok(Some(mmae::report::write::sha256(&bytes)))
        }
        false => Ok(None),
    }
}

/// Computes shard `index` of `of` into `dir`; parts that are there are kept.
#[pyfunction]
#[pyo3(signature = (scenario, salt, block, refine, index, of, dir, threads))]
#[expect(clippy::too_many_arguments, reason = "a study, a shard, a place")]
pub(crate) fn shard<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    salt: &[u8],
    block: Option<usize>,
    refine: bool,
    index: usize,
    of: usize,
    dir: PathBuf,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let plan = plan(py, scenario, salt, block, refine)?;
    let shard = Shard::new(index, of).map_err(|e| errors::sweep(py, &e))?;
    let mut notes: Vec<String> = Vec::new();
    let call = Call { threads, progress: None };
    let ran = guard::long(py, &call, |control| {
        sweep::run(&plan, shard, &dir, Mode::Resume, control, &mut |note| notes.push(note.into()))
    })?;
    let done = ran.map_err(|e| errors::sweep(py, &e))?;
    let out = Pack::new(py);
    out.set("path", dir)?;
    out.set("sha256", done.written.sha256)?;
    out.set("computed", done.computed)?;
    out.set("kept", done.kept)?;
    out.set("notes", notes)?;
    Ok(out.0)
}

/// Joins the parts in `dirs` in directory `out`; returns the digest of its manifest.
#[pyfunction]
#[pyo3(signature = (dirs, out, force))]
pub(crate) fn merge(
    py: Python<'_>,
    dirs: Vec<PathBuf>,
    out: PathBuf,
    force: bool,
) -> PyResult<String> {
    let merged =
        guard::long(py, &Call::default(), |_| sweep::merge(&dirs, &out, force, &mut |_| {}))?;
    Ok(merged.map_err(|e| errors::sweep(py, &e))?.written.sha256)
}
