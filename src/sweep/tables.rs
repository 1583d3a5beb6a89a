//! The two tables of a block.

use parquet::data_type::ByteArray;
use parquet::errors::Result;

use crate::eip::{Block, Case, Model};
use crate::model::Grid;
use crate::report::columns::{Column, Kind, Table};
use crate::report::summary;
use crate::report::table::{self, GROUP_ROWS, Pairs};

/// Columns of the table of plants that are no parameters.
const OWN: [&str; 7] = ["delay", "plant", "winner", "label", "margin", "status", "detail"];

/// The table of pairs: the rows of the plants that were computed.
pub(crate) fn pairs(
    block: &Block,
    grid: &Grid,
    models: &[Model],
    about: &[(&str, &str)],
) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut table = Table::new(&mut bytes, "eip", &table::columns(grid), about)?;
    let pairs = Pairs { grid, models, first: block.plants.start, cases: &block.cases };
    pairs.write(&mut table, |case, place| block.computed[case][place])?;
    table.close()?;
    Ok(bytes)
}

/// The table of plants: a row a delay and plant.
pub(crate) fn plants(
    block: &Block,
    grid: &Grid,
    models: &[Model],
    about: &[(&str, &str)],
) -> Result<Vec<u8>> {
    let mut columns = vec![(OWN[0].to_string(), Kind::Real)];
    columns.extend(table::parameters(grid, &OWN));
    let kinds = [Kind::Long, Kind::Index, Kind::Note, Kind::Number, Kind::Text, Kind::Note];
    columns.extend(OWN[1..].iter().map(|name| name.to_string()).zip(kinds));
    let mut bytes = Vec::new();
    let mut table = Table::new(&mut bytes, "plants", &columns, about)?;
    for (case, computed) in block.cases.iter().zip(&block.computed) {
        let (status, detail) = told(case, computed, block.plants.start);
        let places: Vec<usize> = (0..case.winner.len()).collect();
        for places in places.chunks(GROUP_ROWS) {
            let plants = || places.iter().map(|k| block.plants.start + k);
            let winners = || places.iter().map(|&k| case.winner[k]);
            let label = |w: usize| ByteArray::from(models[w].label.as_str());
            let mut columns = vec![Column::Real(vec![case.delay; places.len()])];
            columns.extend(table::points(grid, plants()).into_iter().map(Column::Real));
            columns.push(Column::Long(plants().map(|k| k as i64).collect()));
            columns.push(Column::Index(winners().map(|w| w.map(|w| w as i32)).collect()));
            columns.push(Column::Note(winners().map(|w| w.map(label)).collect()));
            columns.push(Column::Number(places.iter().map(|&k| case.margin[k]).collect()));
            let status = places.iter().map(|&k| ByteArray::from(status[k]));
            columns.push(Column::Text(status.collect()));
            let detail = places.iter().map(|&k| detail[k].as_deref().map(ByteArray::from));
            columns.push(Column::Note(detail.collect()));
            table.group(columns)?;
        }
    }
    table.close()?;
    Ok(bytes)
}

/// What came of each plant, and the reason where it has no winner.
fn told(case: &Case, computed: &[bool], first: usize) -> (Vec<&'static str>, Vec<Option<String>>) {
    let mut status: Vec<&str> =
        computed.iter().map(|&done| if done { "decided" } else { "inferred" }).collect();
    let mut detail = vec![None; status.len()];
    for u in &case.unstable {
        status[u.plant - first] = "unstable";
        detail[u.plant - first] = Some(format!("mode {} ({})", u.mode, u.states));
    }
    for f in &case.failed {
        status[f.plant - first] = "failed";
        detail[f.plant - first] = Some(summary::plant_cause(&f.error).to_string());
    }
    for u in &case.undecided {
        status[u.plant - first] = "undecided";
        detail[u.plant - first] = Some(summary::doubt(&u.doubt));
    }
    (status, detail)
}
