//! The study as a Parquet table, one row a plant and model and delay.

use std::io::Write;

use parquet::data_type::ByteArray;
use parquet::errors::Result;

use crate::eip::{Case, EipSets, Model};
use crate::model::Grid;
use crate::report::columns::{Column, Kind, Table};

/// Rows of a row group, at most: bounds the memory of writer and readers.
pub(crate) const GROUP_ROWS: usize = 1 << 16;

/// Writes the study as Parquet, without compression.
///
/// Columns: `delay`, one a grid parameter (`plant_` in front of a name that is
/// taken), `plant` and `model` (indices from 0), `label`, `upsilon` and `error`
/// (null where not defined), `winner` (true in the row of the winning model),
/// `margin` (of the plant; null without a winner or a runner-up). Row order:
/// delay, plant, model.
///
/// # Errors
/// Whatever `out` reports.
pub fn write(sets: &EipSets, out: impl Write + Send) -> Result<()> {
    let about = [
        ("mmae.schema", super::json::SCHEMA),
        ("mmae.version", env!("CARGO_PKG_VERSION")),
        ("mmae.convention", sets.convention.name()),
    ];
    let mut table = Table::new(out, "eip", &columns(&sets.grid), &about)?;
    let pairs = Pairs { grid: &sets.grid, models: &sets.models, first: 0, cases: &sets.cases };
    pairs.write(&mut table, |_, _| true)?;
    table.close()
}

const OWN: [&str; 8] = ["delay", "plant", "model", "label", "upsilon", "error", "winner", "margin"];

/// A column a grid parameter, under a name that none of `own` has.
pub(crate) fn parameters(grid: &Grid, own: &[&str]) -> impl Iterator<Item = (String, Kind)> {
    grid.axes().iter().map(|(name, _)| {
        let free =
            if own.contains(&name.as_str()) { format!("plant_{name}") } else { name.clone() };
        (free, Kind::Real)
    })
}

/// Columns of the table of pairs on `grid`.
pub(crate) fn columns(grid: &Grid) -> Vec<(String, Kind)> {
    let mut columns = vec![("delay".to_string(), Kind::Real)];
    columns.extend(parameters(grid, &OWN));
    let kinds = [Kind::Long, Kind::Int, Kind::Text, Kind::Number, Kind::Number, Kind::Flag];
    columns.extend(OWN[1..].iter().map(|name| name.to_string()).zip(kinds));
    columns.push((OWN[7].into(), Kind::Number));
    columns
}

/// Plants from `first` on, by models.
pub(crate) struct Pairs<'a> {
    pub(crate) grid: &'a Grid,
    pub(crate) models: &'a [Model],
    pub(crate) first: usize,
    pub(crate) cases: &'a [Case],
}

impl Pairs<'_> {
    /// Writes the rows of the plants that `wanted(case, place)` asks for.
    pub(crate) fn write<W: Write + Send>(
        &self,
        table: &mut Table<W>,
        wanted: impl Fn(usize, usize) -> bool,
    ) -> Result<()> {
        // whole plants, so that a group never splits one
        let step = (GROUP_ROWS / self.models.len().max(1)).max(1);
        for (c, case) in self.cases.iter().enumerate() {
            let places: Vec<usize> = (0..case.winner.len()).filter(|&k| wanted(c, k)).collect();
            for places in places.chunks(step) {
                table.group(self.rows(case, places))?;
            }
        }
        Ok(())
    }

    /// The columns of some plants of one case, in the order of [`columns`].
    fn rows(&self, case: &Case, places: &[usize]) -> Vec<Column> {
        let n = self.models.len();
        let labels: Vec<ByteArray> =
            self.models.iter().map(|m| ByteArray::from(m.label.as_str())).collect();
        let pairs = || places.iter().flat_map(|&k| (0..n).map(move |i| (k, i)));
        let of_plant = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            places.iter().flat_map(|&k| std::iter::repeat_n(value(k), n)).collect()
        };
        let of_pair = |values: &[f64]| -> Vec<f64> {
            pairs().map(|(k, i)| values.get(k * n + i).copied().unwrap_or(f64::NAN)).collect()
        };
        let mut columns = vec![Column::Real(vec![case.delay; places.len() * n])];
        for axis in points(self.grid, places.iter().map(|k| self.first + k)) {
            let values = axis.into_iter().flat_map(|v| std::iter::repeat_n(v, n));
            columns.push(Column::Real(values.collect()));
        }
        columns.push(Column::Long(pairs().map(|(k, _)| (self.first + k) as i64).collect()));
        columns.push(Column::Int(pairs().map(|(_, i)| i as i32).collect()));
        columns.push(Column::Text(pairs().map(|(_, i)| labels[i].clone()).collect()));
        columns.push(Column::Number(of_pair(&case.upsilon)));
        columns.push(Column::Number(of_pair(&case.error)));
        columns.push(Column::Flag(pairs().map(|(k, i)| case.winner[k] == Some(i)).collect()));
        columns.push(Column::Number(of_plant(&|k| case.margin[k])));
        columns
    }
}

/// Parameter values of plants, one list an axis.
pub(crate) fn points(grid: &Grid, plants: impl Iterator<Item = usize>) -> Vec<Vec<f64>> {
    let mut axes = vec![Vec::new(); grid.axes().len()];
    for plant in plants {
        for (axis, value) in axes.iter_mut().zip(grid.point(plant)) {
            axis.push(value);
        }
    }
    axes
}
