//! A scenario with other models, the rest of the text as it was.

use std::path::Path;

use toml::de::{DeTable, DeValue};

use super::reader::Reader;
use super::source::{self, Source};
use super::{Error, assemble};

/// The text of the scenario at `path` with `bank.models` at `values`, one list a
/// model with a value for each of `parameters`, and labels, where it has them, that
/// say so.
///
/// # Errors
/// `Read`, `TooLarge`; `Invalid` for a text that is no TOML or has no `[bank]`.
pub fn with_models(
    path: &Path,
    parameters: &[String],
    values: &[Vec<f64>],
) -> Result<String, Error> {
    let bytes = source::read(path, source::LIMIT)?;
    let name = path.display().to_string();
    let source = Source::new(&name, &bytes)?;
    let reader = Reader::new(&source);
    let root = DeTable::parse(source.text).map_err(|e| assemble::syntax(&reader, &e))?;
    let bank = root.get_ref().get("bank").and_then(|b| match b.get_ref() {
        DeValue::Table(bank) => Some(bank),
        _ => None,
    });
    let Some(models) = bank.and_then(|b| b.get("models")) else {
        let what = "missing";
        let remedy = "add [bank] with models";
        return Err(Error::Invalid(vec![reader.diagnostic(0, "bank.models", what, remedy)]));
    };
    let column = |(k, name): (usize, &String)| {
        let list: Vec<String> = values.iter().map(|v| format!("{:?}", v[k])).collect();
        format!("{} = [{}]", toml_key(name), list.join(", "))
    };
    let columns: Vec<String> = parameters.iter().enumerate().map(column).collect();
    let mut changes = vec![(models.span(), format!("{{ {} }}", columns.join(", ")))];
    if let Some(labels) = bank.and_then(|b| b.get("labels")) {
        let name = |v: &Vec<f64>| {
            let each = parameters.iter().zip(v).map(|(n, v)| format!("{n} = {v:?}"));
            format!("{:?}", each.collect::<Vec<_>>().join(", "))
        };
        let names: Vec<String> = values.iter().map(name).collect();
        changes.push((labels.span(), format!("[{}]", names.join(", "))));
    }
    // from the end, so that the places before stay where they are
    changes.sort_by_key(|(span, _)| std::cmp::Reverse(span.start));
    let mut text = source.text.to_string();
    for (span, new) in changes {
        text.replace_range(span, &new);
    }
    Ok(text)
}

/// A name as a key: bare where TOML allows it.
fn toml_key(name: &str) -> String {
    let bare = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare && !name.is_empty() { name.into() } else { format!("{name:?}") }
}
