//! Models given as matrices, one set a model.

use faer::Mat;
use toml::de::DeValue;

use super::family::{ExpressionFamily, Pattern, Plants};
use super::keys;
use super::matrix::{CONSTANT, Size};
use super::reader::{Reader, Value, all};
use super::start;
use super::table::Table;
use crate::bank::Initial;
use crate::model::{Names, Plant, Time};

/// The models of a bank that is not drawn from a family.
#[derive(Debug, Clone)]
pub(super) struct Explicit {
    pub(super) plants: Vec<Plant>,
    /// Where some model says how it starts, one each.
    pub(super) initial: Option<Vec<Initial>>,
    /// True for the timing of `a1`, `P1`: before the first measurement.
    pub(super) before_first: bool,
}

/// True if `models` is a list of tables with matrices.
pub(super) fn is_explicit(bank: &Value<'_>) -> bool {
    let DeValue::Table(bank) = bank.get_ref() else { return false };
    let Some(DeValue::Array(models)) = bank.get("models").map(|v| v.get_ref()) else {
        return false;
    };
    let matrices = |m: &Value<'_>| match m.get_ref() {
        DeValue::Table(map) => {
            [["A", "C"], ["T", "Z"]].iter().any(|keys| keys.iter().all(|k| map.get(*k).is_some()))
        }
        _ => false,
    };
    !models.is_empty() && models.iter().any(matrices)
}

/// Reads `bank.models` as matrices. Two alphabets are known: `A, B, G, C, Q, R,
/// x0, P0`, and that of Durbin and Koopman, `T, Z, H, Q, a1, P1`.
pub(super) fn read<'a>(reader: &Reader<'a>, models: &[Value<'a>], time: Time) -> Option<Explicit> {
    let paths: Vec<String> = (0..models.len()).map(|i| format!("bank.models[{i}]")).collect();
    let koopman = models
        .first()
        .is_some_and(|m| m.get_ref().as_table().is_some_and(|t| t.get("T").is_some()));
    let known = if koopman { keys::MODEL_KOOPMAN } else { keys::MODEL };
    let tables: Vec<Table<'_, 'a>> =
        all(models.iter().zip(&paths).map(|(m, path)| match m.get_ref() {
            DeValue::Table(map) => Some(Table::new(reader, path, m.span().start, map, known)),
            _ => reader.wrong_type(path, m, "a table of matrices"),
        }))?;
    let plants = all(tables.iter().map(|t| plant(t, koopman, time)))?;
    let n = plants.first().map_or(0, Plant::nx);
    let starts = if koopman { ["a1", "P1"] } else { ["x0", "P0"] };
    let given = tables.iter().any(|t| starts.iter().any(|k| t.get(k).is_some()));
    let initial = if given { Some(start::of_models(&tables, starts, n)?) } else { None };
    Some(Explicit { plants, initial, before_first: koopman })
}

fn plant(table: &Table<'_, '_>, koopman: bool, time: Time) -> Option<Plant> {
    let reader = table.reader;
    let free = |of| Size::free(of);
    let matrix = |key: &str, size: [Size<'_>; 2]| -> Option<Mat<f64>> {
        let value = table.need(key, "give its rows")?;
        let key = table.key(key);
        reader.matrix(&key, value, CONSTANT, size)?.evaluate(reader, &key, &[], &[])
    };
    let covariance = |key: &str, n: usize, of: &str| -> Option<Mat<f64>> {
        let value = table.need(key, "give a number, a diagonal or a matrix")?;
        let key = table.key(key);
        let written = reader.covariance(&key, value, CONSTANT, Size::new(n, of))?;
        written.evaluate(reader, &key, &[], &[])
    };
    let (a, c, r) = if koopman { ("T", "Z", "H") } else { ("A", "C", "R") };
    let a = matrix(a, [free("states"), free("states")])?;
    let n = a.nrows();
    if a.ncols() != n {
        let key = if koopman { "T" } else { "A" };
        return table.error(key, format!("{n} by {}", a.ncols()), "give a square matrix");
    }
    let states = || Size::new(n, "states");
    let c = matrix(c, [free("outputs"), states()])?;
    let b = match table.get("B") {
        Some(_) => matrix("B", [states(), free("inputs")])?,
        None => Mat::zeros(n, 0),
    };
    let g = match table.get("G") {
        Some(_) => matrix("G", [states(), free("disturbances")])?,
        None => Mat::identity(n, n),
    };
    let (q, ny) = (covariance("Q", g.ncols(), "disturbances")?, c.nrows());
    let r = covariance(r, ny, "outputs")?;
    Some(Plant { time, A: a, B: b, G: g, C: c, Q: q, R: r })
}

/// A family of one plant that stands for the models where no plant is given.
pub(super) fn family(plant: &Plant, names: Names) -> ExpressionFamily {
    let pattern = |letter, m: &Mat<f64>| Pattern::constant(letter, m.clone());
    ExpressionFamily {
        parameters: Vec::new(),
        quantities: Vec::new(),
        names,
        time: plant.time,
        plants: Plants::Written(Box::new([
            pattern("A", &plant.A),
            pattern("B", &plant.B),
            pattern("G", &plant.G),
            pattern("C", &plant.C),
            pattern("Q", &plant.Q),
            pattern("R", &plant.R),
        ])),
    }
}
