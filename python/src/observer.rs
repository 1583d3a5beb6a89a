//! The adaptive observer of a scenario, and what is told of its courses.

use mmae::Error;
use mmae::adaptive::{Courses, Identifiability, Tuning};
use mmae::scenario::AdaptiveObserver;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors;
use crate::grid::Grid;
use crate::guard;
use crate::pack::Pack;
use crate::scenario::Scenario;

/// What is asked of whom.
pub(crate) struct Task<'py> {
    pub(crate) scenario: &'py Scenario,
    pub(crate) observer: AdaptiveObserver,
    /// Its number in the file.
    pub(crate) number: usize,
    pub(crate) tunings: Vec<Tuning>,
    /// False for the one observer of the file, without a grid.
    pub(crate) stacked: bool,
    /// Observers that were passed over, and why.
    passed: Vec<(String, String)>,
}

impl<'py> Task<'py> {
    pub(crate) fn new(
        py: Python<'py>,
        scenario: &'py Scenario,
        name: Option<&str>,
        grid: &Bound<'py, PyDict>,
    ) -> PyResult<Self> {
        let inner = &scenario.inner;
        let all = inner.adaptive_observers();
        if all.is_empty() {
            // says what is missing
            return match inner.adaptive_cases(&[]) {
                Err(error) => Err(errors::scenario(py, &error)),
                Ok(_) => Err(errors::internal(py, "cases without observers")),
            };
        }
        let mut passed = Vec::new();
        let number = match name {
            Some(name) => match all.iter().position(|o| o.name == name) {
                Some(number) => number,
                None => {
                    let names: Vec<&str> = all.iter().map(|o| o.name.as_str()).collect();
                    let text = format!(
                        "observer: none is called '{name}': the scenario has {}",
                        names.join(", ")
                    );
                    return Err(errors::input(py, &text, "unknown_observer"));
                }
            },
            None if all.len() == 1 => 0,
            None => {
                let tested = guard::short(py, Some(1), |_| inner.build_adaptive())?;
                let first = tested.iter().position(Result::is_ok).unwrap_or(0);
                let why = tested.into_iter().take(first).map(|r| r.err().map(|e| e.to_string()));
                let before = all.iter().map(|o| o.name.clone()).zip(why);
                passed.extend(before.map(|(name, why)| (name, why.unwrap_or_default())));
                first
            }
        };
        let observer = all[number].clone();
        let grid = Grid::take(py, grid, &observer)?;
        let (tunings, stacked) = (grid.tunings(&observer.tuning), grid.is_stacked());
        Ok(Self { scenario, observer, number, tunings, stacked, passed })
    }

    /// An error of the engine; of the file's own observer with its place in the file.
    pub(crate) fn raise(&self, py: Python<'_>, error: Error) -> PyErr {
        let error = match error {
            Error::AllFailed { source, count: 1, what: "observers" } => *source,
            error => error,
        };
        let own = matches!(
            &error,
            Error::NotObservable { .. }
                | Error::ObserverUnstable { .. }
                | Error::NotIdentifiable { .. }
        );
        match own && !self.stacked {
            true => {
                let told = self.scenario.inner.explain_adaptive(error, &self.observer.name);
                errors::scenario(py, &told)
            }
            false => errors::engine(py, &error),
        }
    }

    /// Names, tunings and what the rank tests found.
    pub(crate) fn describe(&self, out: &Pack<'_>, courses: &Courses) -> PyResult<()> {
        let (structure, settings) = (&self.observer.structure, &self.observer.settings);
        let [n, _, q, p] = structure.sizes();
        let items = self.tunings.len();
        out.set("observer", &self.observer.name)?;
        out.set("passed", &self.passed)?;
        out.set("title", self.scenario.inner.title())?;
        out.set("reading", settings.reading.name())?;
        out.set("dt", settings.dt)?;
        out.set("stacked", self.stacked)?;
        let names: Vec<&str> = structure.unknown.iter().map(|u| u.name.as_str()).collect();
        out.set("parameters", names)?;
        out.set("states", &structure.states)?;
        out.set("outputs", &structure.outputs)?;
        let signals = self.scenario.inner.adaptive_names();
        out.set("inputs", signals.map_or(&[][..], |names| &names.inputs))?;
        let gains = self.tunings.iter().flat_map(|t| (0..n * q).map(|e| t.K[(e / q, e % q)]));
        out.array("K", gains.collect(), &[items, n, q])?;
        out.array("forgetting", self.tunings.iter().map(|t| t.lambda).collect(), &[items])?;
        let p0 = self.tunings.iter().flat_map(|t| t.prior.p0(settings.dt));
        out.array("P0", p0.collect(), &[items, p])?;
        let start = self.tunings.iter().flat_map(|t| t.theta.iter().copied());
        out.array("theta0", start.collect(), &[items, p])?;
        let failures: Vec<Option<String>> =
            courses.failures.iter().map(|f| f.as_ref().map(ToString::to_string)).collect();
        out.set("failures", failures)?;
        let found = &courses.identifiability;
        let rank = |i: &Option<_>| i.as_ref().map_or(-1, |i: &Identifiability| i.rank as i64);
        out.array("rank", found.iter().map(rank).collect(), &[items])?;
        let singular = found.iter().flat_map(|f| match f {
            Some(found) => found.singular.clone(),
            None => vec![f64::NAN; p],
        });
        out.array("singular", singular.collect(), &[items, p])
    }

    /// The courses of all cases, one after the other; `sources` trials or records each.
    pub(crate) fn courses(
        &self,
        out: &Pack<'_>,
        all: Vec<Courses>,
        reports: usize,
    ) -> PyResult<()> {
        let [n, _, q, p] = self.observer.structure.sizes();
        let (cases, items) = (all.len(), self.tunings.len());
        let sources = all.first().map_or(0, |c| c.sound.len() / items);
        let mut joined = Courses::default();
        for mut part in all {
            joined.theta.append(&mut part.theta);
            joined.theta_std.append(&mut part.theta_std);
            joined.correlation.append(&mut part.correlation);
            joined.at_bound.append(&mut part.at_bound);
            joined.x_hat.append(&mut part.x_hat);
            joined.x_std.append(&mut part.x_std);
            joined.window.append(&mut part.window);
            joined.condition.append(&mut part.condition);
            joined.residual.append(&mut part.residual);
            joined.drift.append(&mut part.drift);
            joined.settled.append(&mut part.settled);
            joined.sound.append(&mut part.sound);
            joined.y.append(&mut part.y);
        }
        let lead = [cases, items, sources, reports];
        let with = |more: &[usize]| [&lead[..], more].concat();
        out.array("theta_hat", joined.theta, &with(&[p]))?;
        out.array("theta_std", joined.theta_std, &with(&[p]))?;
        out.array("correlation", joined.correlation, &with(&[p, p]))?;
        out.array("at_bound", joined.at_bound, &with(&[p]))?;
        out.array("x_hat", joined.x_hat, &with(&[n]))?;
        out.array("x_std", joined.x_std, &with(&[n]))?;
        out.array("window", joined.window, &lead)?;
        out.array("condition", joined.condition, &lead)?;
        out.array("residual", joined.residual, &lead)?;
        out.array("drift", joined.drift, &lead)?;
        out.array("settled", joined.settled, &lead)?;
        out.array("sound", joined.sound, &lead[..3])?;
        out.array("y", joined.y, &[cases, sources, reports, q])
    }

    /// Parameters behind the last estimates, where the file names some.
    pub(crate) fn behind(&self, all: &[Courses], reports: usize) -> Option<Behind> {
        let physical = self.observer.physical.as_ref()?;
        let p = self.tunings[0].theta.len();
        let mut out = Behind::default();
        for courses in all {
            for (course, sound) in courses.sound.iter().enumerate() {
                let last = (course + 1) * reports - 1;
                let row = |list: &[f64]| list[last * p..][..p].to_vec();
                let rows = &courses.correlation[last * p * p..][..p * p];
                let correlation = mmae::Mat::from_fn(p, p, |i, j| rows[i * p + j]);
                let (theta, std) = (row(&courses.theta), row(&courses.theta_std));
                let solved = sound.then(|| physical.solve(&theta, &std, &correlation));
                let (value, std, failure) = match solved {
                    Some(Ok((value, std))) => (value, std, String::new()),
                    Some(Err(e)) => (vec![f64::NAN; p], vec![f64::NAN; p], e.to_string()),
                    None => (vec![f64::NAN; p], vec![f64::NAN; p], String::new()),
                };
                out.value.extend(value);
                out.std.extend(std);
                out.failure.push(failure);
            }
        }
        Some(out)
    }

    pub(crate) fn physical(
        &self,
        out: &Pack<'_>,
        behind: Option<Behind>,
        cases: usize,
    ) -> PyResult<()> {
        let (Some(physical), Some(behind)) = (&self.observer.physical, behind) else {
            return out.set("physical", false);
        };
        let (items, p) = (self.tunings.len(), physical.names.len());
        let shape = [cases, items, behind.failure.len() / (cases * items), p];
        out.set("physical", true)?;
        out.set("physical_names", &physical.names)?;
        out.array("physical_value", behind.value, &shape)?;
        out.array("physical_std", behind.std, &shape)?;
        out.set("physical_failure", behind.failure)
    }

    /// An error if nothing is left of anything.
    pub(crate) fn left(&self, py: Python<'_>, all: &[Courses]) -> PyResult<()> {
        if all.iter().any(|c| c.sound.contains(&true)) {
            return Ok(());
        }
        let text = format!(
            "observer {} ran away: bound its parameters with min and max, or give a smaller P0",
            self.observer.name
        );
        Err(errors::numerical(py, &text, "ran_away"))
    }
}

/// Physical parameters of every course.
#[derive(Default)]
pub(crate) struct Behind {
    value: Vec<f64>,
    std: Vec<f64>,
    failure: Vec<String>,
}
