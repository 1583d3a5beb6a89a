//! `[weighting]`: the law that turns residuals into weights.

use faer::Mat;
use toml::de::DeValue;

use super::keys;
use super::matrix::{CONSTANT, Size};
use super::reader::{Reader, Value};
use super::table::Table;
use crate::engine::{Innovation, Mixing, Weighting};
use crate::weight::{DwsgScheme, Law, Modifiers, Transition, Window};

/// Runge-Kutta steps of Dunn's differential equation where none are given.
const SUBSTEPS: u64 = 4;

/// Reads `[weighting]` for a bank of `models` models with `outputs` outputs.
pub(super) fn read<'a>(
    reader: &Reader<'a>,
    value: &Value<'a>,
    models: usize,
    outputs: usize,
    continuous: bool,
) -> Option<Weighting> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("weighting", value, "a table");
    };
    let table = Table::new(reader, "weighting", value.span().start, map, keys::WEIGHTING);
    let law = law(&table, continuous);
    without_effect(&table, law);
    let innovation = innovation(&table, outputs);
    let modifiers = modifiers(&table, models);
    let mixing = mixing(&table, models);
    Some(Weighting { law: law?, innovation: innovation?, modifiers: modifiers?, mixing: mixing? })
}

/// A number at `key`, or `default`.
fn number(table: &Table<'_, '_>, key: &str, default: f64) -> Option<f64> {
    match table.get(key) {
        Some(value) => table.reader.number(&table.key(key), value),
        None => Some(default),
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Named {
    Bayes,
    Zhang1,
    Zhang2,
    Dunn,
    Dwsg,
}

/// Keys that only one law has.
const OWN: [(&str, Named); 6] = [
    ("n_max", Named::Zhang2),
    ("reading", Named::Dunn),
    ("substeps", Named::Dunn),
    ("lambda", Named::Dwsg),
    ("tempering", Named::Dwsg),
    ("scheme", Named::Dwsg),
];

fn law(table: &Table<'_, '_>, continuous: bool) -> Option<Law> {
    let choices = [
        ("bayes", Named::Bayes),
        ("zhang1", Named::Zhang1),
        ("zhang2", Named::Zhang2),
        ("dunn", Named::Dunn),
        ("dwsg", Named::Dwsg),
    ];
    let named = match table.get("law") {
        Some(value) => table.reader.choice("weighting.law", value, &choices)?,
        None if continuous => Named::Dunn,
        None => Named::Bayes,
    };
    let mut good = true;
    for (key, owner) in OWN {
        if owner != named && table.get(key).is_some() {
            let law = choices.iter().find(|c| c.1 == owner).map_or("", |c| c.0);
            let message = format!("this key belongs to law = \"{law}\"");
            table.error::<()>(key, message, "remove it, or choose that law");
            good = false;
        }
    }
    let law = match named {
        Named::Bayes => Law::Bayes,
        Named::Zhang1 => Law::Zhang { n_max: 1.0 },
        Named::Zhang2 => Law::Zhang { n_max: number(table, "n_max", f64::INFINITY)? },
        Named::Dunn => dunn(table, continuous)?,
        Named::Dwsg => {
            let schemes = [
                ("left", DwsgScheme::Left),
                ("trapezoid", DwsgScheme::Trapezoid),
                ("mixture", DwsgScheme::Mixture),
            ];
            let scheme = match table.get("scheme") {
                Some(value) => table.reader.choice("weighting.scheme", value, &schemes)?,
                None => DwsgScheme::Left,
            };
            table.need("lambda", "give the rate of the weights in 1/s (1/sample), say 100")?;
            let lambda = number(table, "lambda", 1.0)?;
            Law::Dwsg { lambda, tempering: number(table, "tempering", 1.0)?, scheme }
        }
    };
    match law.check() {
        Ok(()) => good.then_some(law),
        Err(e) => table.reader.engine(table.at("law"), "weighting", e),
    }
}

/// Refuses keys that the law does not look at.
fn without_effect(table: &Table<'_, '_>, law: Option<Law>) {
    let Some(law) = law else { return };
    let likelihoods = matches!(law, Law::Bayes | Law::Dwsg { .. });
    let zhang = matches!(law, Law::Zhang { .. });
    let named = table.get("innovation").is_some_and(|v| v.get_ref().as_str().is_some());
    for (key, fits) in [
        ("window", zhang),
        ("clip", likelihoods || law == Law::Likelihood),
        // a matrix is also the norm of Zhang's residuals
        ("innovation", likelihoods || zhang && !named),
    ] {
        if !fits && table.get(key).is_some() {
            let message = format!("law {} does not look at it", law.name());
            table.error::<()>(key, message, "remove it, or choose another law");
        }
    }
}

fn dunn(table: &Table<'_, '_>, continuous: bool) -> Option<Law> {
    if !continuous {
        let remedy = "write law = \"bayes\": the same posterior for samples";
        return table.error("law", "Dunn's laws are for continuous observers", remedy);
    }
    let ode = match table.get("reading") {
        Some(value) => {
            let readings = [("likelihood", false), ("ode", true)];
            table.reader.choice("weighting.reading", value, &readings)?
        }
        None => false,
    };
    let substeps = match table.get("substeps") {
        Some(_) if !ode => {
            let message = "this key belongs to reading = \"ode\"";
            return table.error("substeps", message, "remove it, or choose that reading");
        }
        Some(value) => table.reader.integer("weighting.substeps", value, 1)?,
        None => SUBSTEPS,
    };
    if substeps > 1000 {
        return table.error("substeps", "over the limit of 1000", "take a shorter dt");
    }
    Some(if ode { Law::Ode { substeps: substeps as usize } } else { Law::Likelihood })
}

/// `"filter"`, `"steady"`, or a matrix `W` common to all models.
fn innovation(table: &Table<'_, '_>, outputs: usize) -> Option<Innovation> {
    let Some(value) = table.get("innovation") else { return Some(Innovation::Filter) };
    if let DeValue::String(_) = value.get_ref() {
        let choices = [("filter", false), ("steady", true)];
        let steady = table.reader.choice("weighting.innovation", value, &choices)?;
        return Some(if steady { Innovation::Steady } else { Innovation::Filter });
    }
    let size = Size::new(outputs, "outputs");
    let key = "weighting.innovation";
    let written = table.reader.covariance(key, value, CONSTANT, size)?;
    Some(Innovation::Common(written.evaluate(table.reader, key, &[], &[])?))
}

fn modifiers(table: &Table<'_, '_>, models: usize) -> Option<Modifiers> {
    let window = match table.get("window") {
        None => Window::All,
        Some(value) => match value.get_ref() {
            DeValue::Integer(_) => match table.reader.integer("weighting.window", value, 1)? {
                steps @ ..=100_000 => Window::Sliding(steps as usize),
                _ => {
                    let remedy = "give at most 100000 steps, or a factor below 1";
                    return table.error("window", "too long to be kept", remedy);
                }
            },
            _ => Window::Exponential(table.reader.number("weighting.window", value)?),
        },
    };
    let modifiers = Modifiers {
        floor: number(table, "floor", 0.0)?,
        forgetting: number(table, "forgetting", 1.0)?,
        clip: number(table, "clip", f64::INFINITY)?,
        window,
    };
    match modifiers.check(models) {
        Ok(()) => Some(modifiers),
        Err(e) => {
            let key = match &e {
                crate::Error::Range { what, .. } => what.clone(),
                _ => String::new(),
            };
            table.reader.engine(table.at(&key), &table.key(&key), e)
        }
    }
}

/// `mixing = "markov"` and so on, with `stay` or `Pi`, or `threshold`.
fn mixing(table: &Table<'_, '_>, models: usize) -> Option<Mixing> {
    let choices = [("none", 0), ("markov", 1), ("imm", 2), ("reseed", 3)];
    let kind = match table.get("mixing") {
        Some(value) => table.reader.choice("weighting.mixing", value, &choices)?,
        None => 0,
    };
    let transits = kind == 1 || kind == 2;
    for (key, fits) in [("stay", transits), ("Pi", transits), ("threshold", kind == 3)] {
        if !fits && table.get(key).is_some() {
            let remedy = "remove it, or choose the mixing that it belongs to";
            return table.error(key, "this mixing has no such key", remedy);
        }
    }
    match kind {
        0 => Some(Mixing::None),
        3 => {
            let threshold = number(table, "threshold", 1e-3)?;
            if threshold > 0.0 && threshold < 1.0 {
                Some(Mixing::Reseed { threshold })
            } else {
                table.error("threshold", "not a weight", "give a number between 0 and 1")
            }
        }
        _ => {
            let transition = transition(table, models)?;
            Some(if kind == 1 { Mixing::Markov(transition) } else { Mixing::Imm(transition) })
        }
    }
}

fn transition(table: &Table<'_, '_>, models: usize) -> Option<Transition> {
    let (key, made) = match (table.get("Pi"), table.get("stay")) {
        (Some(_), Some(_)) => {
            return table.error("stay", "both stay and Pi are given", "keep one of them");
        }
        (Some(value), None) => {
            let size = Size::new(models, "models");
            let written = table.reader.matrix("weighting.Pi", value, CONSTANT, [size, size])?;
            let pi: Mat<f64> = written.evaluate(table.reader, "weighting.Pi", &[], &[])?;
            ("Pi", Transition::new(&pi))
        }
        (None, _) => {
            table.need("stay", "give the probability of staying for a step, say 0.99, or Pi")?;
            ("stay", Transition::sticky(models, number(table, "stay", 1.0)?))
        }
    };
    match made {
        Ok(transition) => Some(transition),
        Err(e) => table.reader.engine(table.at(key), &table.key(key), e),
    }
}
