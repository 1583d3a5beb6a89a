//! How the observers of a bank start: the rest of `[bank]`.

use faer::Mat;

use super::matrix::{CONSTANT, Size};
use super::reader::all;
use super::table::Table;
use crate::bank::{GainMode, Initial, StartTime};
use crate::model::check_covariance;

/// Gains, prior and first estimates of a bank.
#[derive(Debug, Clone)]
pub(super) struct Start {
    pub(super) gains: GainMode,
    /// Seconds between measurements of a continuous plant.
    pub(super) dt: Option<f64>,
    pub(super) prior: Vec<f64>,
    pub(super) initial: Vec<Initial>,
    pub(super) time: StartTime,
}

/// Reads the keys of a bank of `models` models with `n` states; whether plant and
/// observers are continuous.
pub(super) fn read(
    table: &Table<'_, '_>,
    models: usize,
    n: usize,
    [continuous, held]: [bool; 2],
) -> Option<Start> {
    let reader = table.reader;
    let prior = match table.get("prior") {
        None => Some(vec![1.0; models]),
        Some(value) => prior(table, reader.numbers("bank.prior", value)?, models),
    };
    let x_hat = match table.get("x0") {
        None => Some(vec![0.0; n]),
        Some(value) => match reader.numbers("bank.x0", value)? {
            x if x.len() == n => Some(x),
            x => {
                let message = format!("{} numbers for {n} states of the observers", x.len());
                table.error("x0", message, "give one number a state")
            }
        },
    };
    let p = match table.get("P0") {
        None => Some(None),
        Some(value) => {
            let size = Size::new(n, "states of the observers");
            let written = reader.covariance("bank.P0", value, CONSTANT, size)?;
            let p: Mat<f64> = written.evaluate(reader, "bank.P0", &[], &[])?;
            match check_covariance("bank.P0", p.as_ref(), false) {
                Ok(()) => Some(Some(p)),
                Err(e) => reader.engine(value.span().start, "bank.P0", e),
            }
        }
    };
    let gains = match table.get("gains") {
        // a covariance at the start asks for the recursion that begins there
        None if table.get("P0").is_some() => Some(GainMode::Recursive),
        None => Some(GainMode::Steady),
        Some(value) => {
            let choices = [("steady", GainMode::Steady), ("recursive", GainMode::Recursive)];
            reader.choice("bank.gains", value, &choices)
        }
    };
    if let (Some(GainMode::Steady), Some(_)) = (gains, table.get("P0")) {
        let remedy = "remove it, or write gains = \"recursive\"";
        return table.error("P0", "steady gains do not begin anywhere", remedy);
    }
    let time = match table.get("start") {
        Some(_) if held => {
            let message = "continuous observers begin where the first interval does";
            return table.error("start", message, "remove it");
        }
        None => Some(StartTime::StepBefore),
        Some(value) => {
            let choices = [
                ("step-before", StartTime::StepBefore),
                ("first-measurement", StartTime::FirstMeasurement),
            ];
            reader.choice("bank.start", value, &choices)
        }
    };
    let dt = match table.get("dt") {
        None => Some(None),
        Some(_) if !continuous => {
            table.error("dt", "a discrete plant has its own interval", "remove it")
        }
        Some(value) => match reader.number("bank.dt", value)? {
            dt if dt > 0.0 => Some(Some(dt)),
            dt => table.error("dt", format!("{dt} is not an interval"), "give positive seconds"),
        },
    };
    let initial = vec![Initial { x_hat: x_hat?, P: p? }];
    Some(Start { gains: gains?, dt: dt?, prior: prior?, initial, time: time? })
}

fn prior(table: &Table<'_, '_>, prior: Vec<f64>, models: usize) -> Option<Vec<f64>> {
    if prior.len() != models {
        let message = format!("{} probabilities for {models} models", prior.len());
        return table.error("prior", message, "give one a model");
    }
    match crate::weight::check_prior(&prior) {
        Ok(_) => Some(prior),
        Err(e) => table.reader.engine(table.at("prior"), "bank.prior", e),
    }
}

/// Starts of models that have their own: `x0` and `P0`, or `a1` and `P1`, in
/// each.
pub(super) fn of_models(
    tables: &[Table<'_, '_>],
    keys: [&str; 2],
    n: usize,
) -> Option<Vec<Initial>> {
    all(tables.iter().map(|table| {
        let reader = table.reader;
        let [x, p] = keys;
        let x_hat = match table.get(x) {
            None => vec![0.0; n],
            Some(value) => {
                let size = [Size::new(n, "states"), Size::new(1, "column")];
                let key = table.key(x);
                let written = reader.matrix(&key, value, CONSTANT, size)?;
                let x = written.evaluate(reader, &key, &[], &[])?;
                (0..n).map(|i| x[(i, 0)]).collect()
            }
        };
        let covariance = match table.get(p) {
            None => None,
            Some(value) => {
                let key = table.key(p);
                let written = reader.covariance(&key, value, CONSTANT, Size::new(n, "states"))?;
                Some(written.evaluate(reader, &key, &[], &[])?)
            }
        };
        Some(Initial { x_hat, P: covariance })
    }))
}
