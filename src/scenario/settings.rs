//! `[eip]`: the grid of plants and how the sets are computed.

use toml::de::DeValue;

use super::family::ExpressionFamily;
use super::reader::{Reader, Value, all};
use super::table::Table;
use super::{bank, grid, keys, surroundings};
use crate::eip::{Convention, Method, Verify};
use crate::model::{Axis, Grid, Time};

/// Memory limit in bytes where the scenario gives none.
const MEMORY: u128 = 4 << 30;

/// Most delays of a family.
const DELAYS: usize = 1000;

/// `[eip]`, read.
#[derive(Clone)]
pub(super) struct Settings {
    pub(super) grid: Grid,
    pub(super) convention: Convention,
    pub(super) delays: Vec<f64>,
    pub(super) delay_interval: Option<[f64; 2]>,
    pub(super) verify: Verify,
    pub(super) method: Option<Method>,
    pub(super) memory_limit: u128,
}

/// Reads `[eip]`.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    family: &ExpressionFamily,
) -> Option<Settings> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("eip", value, "a table");
    };
    let table = Table::new(reader, "eip", value.span().start, map, keys::EIP);
    let grid = parameter_grid(&table, family);
    let convention = convention(&table, family.time);
    let delays = delays(&table);
    let delay_interval = match table.get("delay_interval") {
        Some(value) => delay_interval(reader, value).map(Some),
        None => Some(None),
    };
    let choices = [("auto", Verify::Auto), ("all", Verify::All), ("none", Verify::None)];
    let verify = match table.get("verify") {
        Some(value) => reader.choice("eip.verify", value, &choices),
        None => Some(Verify::Auto),
    };
    let choices =
        [("auto", None), ("doubling", Some(Method::Doubling)), ("modal", Some(Method::Modal))];
    let method = match table.get("method") {
        Some(value) => reader.choice("eip.method", value, &choices),
        None => Some(None),
    };
    let memory_limit = match table.get("memory_limit") {
        Some(value) => memory(reader, value),
        None => Some(MEMORY),
    };
    Some(Settings {
        grid: grid?,
        convention: convention?,
        delays: delays?,
        delay_interval: delay_interval?,
        verify: verify?,
        method: method?,
        memory_limit: memory_limit?,
    })
}

fn parameter_grid(table: &Table<'_, '_>, family: &ExpressionFamily) -> Option<Grid> {
    let reader = table.reader;
    let remedy = "give the plants, as in grid = { L = { from = 0.9, to = 1.9, points = 401 } }";
    let value = table.need("grid", remedy)?;
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("eip.grid", value, "a table with one entry a parameter");
    };
    let inner = Table::named(reader, "eip.grid", value.span().start, map)?;
    let axes = all(inner.in_order().into_iter().map(|(name, span, value)| {
        let key = inner.key(name);
        let known = bank::parameter(reader, family, name, &key, span.start);
        let axis = grid::axis(reader, &key, value)?;
        if let (Axis::Explicit(list), DeValue::Array(written)) = (&axis, value.get_ref())
            && let Some(i) = (1..list.len()).find(|&i| list[i - 1] >= list[i])
        {
            let message = format!("{} after {}", list[i], list[i - 1]);
            let key = format!("{key}[{i}]");
            let remedy = "list the values in increasing order";
            return reader.error(written[i].span().start, &key, message, remedy);
        }
        known?;
        Some((name.to_string(), axis))
    }))?;
    if axes.is_empty() {
        return reader.error(inner.at, "eip.grid", "no parameters", remedy);
    }
    match Grid::new(axes) {
        Ok(grid) => Some(grid),
        Err(error) => reader.engine(inner.at, "eip.grid", error),
    }
}

fn convention(table: &Table<'_, '_>, time: Time) -> Option<Convention> {
    enum Named {
        Ito,
        Baram,
        Identity,
    }
    let choices = [("ito", 0), ("baram", 1), ("identity", 2)];
    let named = match table.get("convention") {
        Some(value) => match table.reader.choice("eip.convention", value, &choices)? {
            0 => Named::Ito,
            1 => Named::Baram,
            _ => Named::Identity,
        },
        None if time.is_continuous() => Named::Ito,
        None => Named::Baram,
    };
    let sampled = matches!((&named, time), (Named::Baram, Time::Continuous));
    if !sampled && table.get("dt").is_some() {
        let remedy = "remove it: only convention = \"baram\" samples a continuous plant";
        return table.error("dt", "nothing is sampled", remedy);
    }
    match (named, time) {
        (Named::Identity, _) => Some(Convention::Identity),
        (Named::Ito, Time::Continuous) => Some(Convention::Ito),
        (Named::Ito, Time::Discrete { .. }) => {
            let remedy = "write convention = \"baram\" or \"identity\"";
            table.error("convention", "\"ito\" is for continuous plants", remedy)
        }
        (Named::Baram, Time::Discrete { dt }) => Some(Convention::Baram { dt }),
        (Named::Baram, Time::Continuous) => {
            let value = table.need("dt", "give the sampling interval of the filters in seconds")?;
            let dt = table.reader.number("eip.dt", value)?;
            if dt > 0.0 {
                return Some(Convention::Baram { dt });
            }
            table.error("dt", format!("{dt} is not a sampling interval"), "give positive seconds")
        }
    }
}

fn delays(table: &Table<'_, '_>) -> Option<Vec<f64>> {
    let Some(value) = table.get("delays") else { return Some(Vec::new()) };
    let reader = table.reader;
    let list = reader.list("eip.delays", value, "a list of delays in seconds")?;
    if list.len() > DELAYS {
        let message = format!("{} delays, over the limit of {DELAYS}", list.len());
        return table.error("delays", message, "give fewer");
    }
    let each = |(i, v)| surroundings::delay(reader, &format!("eip.delays[{i}]"), v);
    let delays = all(list.iter().enumerate().map(each))?;
    if let Some(i) = (1..delays.len()).find(|&i| delays[..i].contains(&delays[i])) {
        let message = format!("the delay {} s is given twice", delays[i]);
        let key = format!("eip.delays[{i}]");
        return reader.error(list[i].span().start, &key, message, "keep one");
    }
    Some(delays)
}

/// The two ends of an interval of delays.
fn delay_interval<'a>(reader: &Reader<'a>, value: &Value<'a>) -> Option<[f64; 2]> {
    let key = "eip.delay_interval";
    let remedy = "give the shortest and the longest delay in seconds, as in [0, 0.02]";
    let list = reader.list(key, value, "a list of two delays in seconds")?;
    let each = |(i, v)| surroundings::delay(reader, &format!("{key}[{i}]"), v);
    let delays = all(list.iter().enumerate().map(each))?;
    match delays[..] {
        [from, to] if from < to => Some([from, to]),
        [_, _] => reader.error(value.span().start, key, "the delays do not rise", remedy),
        _ => {
            let message = format!("{} delays", delays.len());
            reader.error(value.span().start, key, message, remedy)
        }
    }
}

/// `4294967296` or `"4 GiB"`.
fn memory<'a>(reader: &Reader<'a>, value: &Value<'a>) -> Option<u128> {
    const UNITS: [(&str, u32, u32); 9] = [
        ("B", 1, 0),
        ("kB", 1000, 1),
        ("MB", 1000, 2),
        ("GB", 1000, 3),
        ("TB", 1000, 4),
        ("KiB", 1024, 1),
        ("MiB", 1024, 2),
        ("GiB", 1024, 3),
        ("TiB", 1024, 4),
    ];
    let key = "eip.memory_limit";
    let DeValue::String(text) = value.get_ref() else {
        return reader.integer(key, value, 1).map(u128::from);
    };
    let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let (number, unit) = text.split_at(digits);
    let unit = UNITS.iter().find(|(name, _, _)| name.eq_ignore_ascii_case(unit.trim()));
    match (number.parse::<u64>(), unit) {
        (Ok(number @ 1..), Some((_, base, power))) => {
            Some(u128::from(number) * u128::from(*base).pow(*power))
        }
        _ => {
            let remedy = "write a number of bytes, or \"512 MiB\" or \"4 GiB\"";
            reader.error(value.span().start, key, "not an amount of memory", remedy)
        }
    }
}
