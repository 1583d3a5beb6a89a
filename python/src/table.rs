//! A plant family given by its matrices at the points of a grid.

use mmae::model::{Family, Names, Parameter, Plant, Time};
use mmae::{Error, Mat, Result};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::Array;
use crate::errors;

/// One letter: a matrix for all points, or one each.
struct Stack {
    rows: usize,
    cols: usize,
    varies: bool,
    data: Vec<f64>,
}

/// Plants between the points are interpolated linearly in each parameter: at the
/// points they are exact, and covariances stay positive semidefinite.
pub(crate) struct Table {
    parameters: Vec<Parameter>,
    names: Names,
    time: Time,
    axes: Vec<Vec<f64>>,
    stacks: [Stack; 6],
}

/// Letters in the order of the stacks, with their names for messages.
const LETTERS: [&str; 6] = ["A", "B", "G", "C", "Q", "R"];

impl Table {
    /// From the dictionary that `pymmae.Family` keeps.
    pub(crate) fn read(py: Python<'_>, dict: &Bound<'_, PyDict>) -> PyResult<Self> {
        let get = |key: &str| {
            let missing = || errors::input(py, &format!("the family lacks {key}"), "empty");
            dict.get_item(key)?.ok_or_else(missing)
        };
        let axes: Vec<(String, Vec<f64>, f64)> = get("axes")?.extract()?;
        let [states, inputs, disturbances, outputs]: [Vec<String>; 4] = get("names")?.extract()?;
        let dt: Option<f64> = get("dt")?.extract()?;
        let counts = [states.len(), inputs.len(), disturbances.len(), outputs.len()];
        let [nx, nu, nw, ny] = counts;
        let points: usize = axes.iter().map(|(_, values, _)| values.len()).product();
        let want = [[nx, nx], [nx, nu], [nx, nw], [ny, nx], [nw, nw], [ny, ny]];
        let mut stacks = Vec::with_capacity(6);
        for (letter, [rows, cols]) in LETTERS.into_iter().zip(want) {
            let array = Array::take(letter, &get(letter)?)?;
            let size = rows * cols;
            let grid: Vec<usize> = axes.iter().map(|(_, values, _)| values.len()).collect();
            let full: Vec<usize> = grid.iter().copied().chain([rows, cols]).collect();
            let shape = array.shape();
            if shape != [rows, cols] && shape != full {
                let text = format!(
                    "{letter} has shape {shape:?}: give {full:?} (the grid, then rows and \
                     columns), or {:?} if it is the same everywhere",
                    [rows, cols]
                );
                return Err(errors::input(py, &text, "shape"));
            }
            let varies = shape.len() > 2 && points > 1;
            stacks.push(Stack {
                rows,
                cols,
                varies,
                data: array.data()[..if varies { points } else { 1 } * size].to_vec(),
            });
        }
        let Ok(stacks) = <[Stack; 6]>::try_from(stacks) else {
            return Err(errors::internal(py, "six letters"));
        };
        Ok(Self {
            parameters: axes
                .iter()
                .map(|(name, _, nominal)| Parameter { name: name.clone(), nominal: *nominal })
                .collect(),
            axes: axes.into_iter().map(|(_, values, _)| values).collect(),
            names: Names { states, inputs, disturbances, outputs },
            time: dt.map_or(Time::Continuous, |dt| Time::Discrete { dt }),
            stacks,
        })
    }

    /// The points around `theta` with their shares.
    fn corners(&self, theta: &[f64]) -> Result<Vec<(usize, f64)>> {
        let mut corners = vec![(0, 1.0)];
        for ((axis, &value), parameter) in self.axes.iter().zip(theta).zip(&self.parameters) {
            let (first, last) = (axis[0], axis[axis.len() - 1]);
            if !(value >= first && value <= last) {
                return Err(Error::Range {
                    what: parameter.name.clone(),
                    value,
                    remedy: format!("the family has matrices from {first} to {last}"),
                });
            }
            let above = axis.partition_point(|v| *v < value);
            let here: Vec<(usize, f64)> = if axis[above] == value {
                vec![(above, 1.0)]
            } else {
                let (a, b) = (axis[above - 1], axis[above]);
                let share = (value - a) / (b - a);
                vec![(above - 1, 1.0 - share), (above, share)]
            };
            corners = corners
                .iter()
                .flat_map(|(at, weight)| {
                    here.iter().map(move |(k, share)| (at * axis.len() + k, weight * share))
                })
                .collect();
        }
        Ok(corners)
    }
}

impl Stack {
    fn at(&self, corners: &[(usize, f64)]) -> Mat<f64> {
        let size = self.rows * self.cols;
        Mat::from_fn(self.rows, self.cols, |i, j| {
            let entry = |at: usize| self.data[at * size + i * self.cols + j];
            match (self.varies, corners) {
                (false, _) => entry(0),
                (true, [(at, _)]) => entry(*at),
                // what is the same at all corners is so in between, to the last bit
                (true, [(first, _), rest @ ..])
                    if rest.iter().all(|(at, _)| entry(*at) == entry(*first)) =>
                {
                    entry(*first)
                }
                (true, all) => all.iter().map(|(at, share)| share * entry(*at)).sum(),
            }
        })
    }
}

impl Family for Table {
    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn names(&self) -> &Names {
        &self.names
    }

    fn time(&self) -> Time {
        self.time
    }

    fn plant(&self, theta: &[f64]) -> Result<Plant> {
        if theta.len() != self.axes.len() {
            let (want, got) = ([1, self.axes.len()], [1, theta.len()]);
            return Err(Error::Shape { what: "theta".into(), want, got });
        }
        let corners = self.corners(theta)?;
        let [a, b, g, c, q, r] = &self.stacks;
        Ok(Plant {
            time: self.time,
            A: a.at(&corners),
            B: b.at(&corners),
            G: g.at(&corners),
            C: c.at(&corners),
            Q: q.at(&corners),
            R: r.at(&corners),
        })
    }
}
