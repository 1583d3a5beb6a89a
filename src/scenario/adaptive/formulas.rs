//! Named numbers that follow each other, and vectors of expressions.

use toml::de::DeValue;

use super::super::expression::Entry;
use super::super::operators::{CONSTANTS, FUNCTIONS};
use super::super::reader::{Reader, Value, all};
use super::super::table::Table;
use super::entry;

/// Names with expressions of those before them.
#[derive(Debug, Clone, Default)]
pub(super) struct Quantities {
    pub(super) names: Vec<String>,
    pub(super) entries: Vec<Entry>,
}

impl Quantities {
    /// Reads the table `key`, whose expressions may mention those of `before`; the
    /// result holds both.
    pub(super) fn read(table: &Table<'_, '_>, key: &str, before: &Self) -> Option<Self> {
        let mut found = before.clone();
        let Some(value) = table.get(key) else { return Some(found) };
        let (reader, path) = (table.reader, table.key(key));
        let DeValue::Table(map) = value.get_ref() else {
            return reader.wrong_type(&path, value, "a table of numbers by name");
        };
        let inner = Table::named(reader, &path, value.span().start, map)?;
        for (name, span, value) in inner.in_order() {
            let key = inner.key(name);
            let builtin = CONSTANTS.iter().any(|(n, _)| *n == name)
                || FUNCTIONS.iter().any(|f| f.name == name);
            let fault = if !is_name(name) {
                Some(("not a name", "use letters, digits and _"))
            } else if builtin {
                Some(("the name of a constant or a function", "choose another name"))
            } else if found.names.iter().any(|n| n == name) {
                Some(("a name that is taken", "choose another name"))
            } else {
                None
            };
            if let Some((message, remedy)) = fault {
                return reader.error(span.start, &key, message, remedy);
            }
            let known: Vec<&str> = found.names.iter().map(String::as_str).collect();
            let entry = entry(reader, &key, value, &known, "a parameter can use those above it")?;
            found.names.push(name.into());
            found.entries.push(entry);
        }
        Some(found)
    }

    /// The value of every name; `replace` gives that of a name another one.
    pub(super) fn values(&self, replace: impl Fn(&str) -> Option<f64>) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.names.len());
        for (name, entry) in self.names.iter().zip(&self.entries) {
            let value = replace(name).unwrap_or_else(|| entry.value(&values));
            values.push(value);
        }
        values
    }
}

/// Letters, digits and `_`, not beginning with a digit.
pub(super) fn is_name(name: &str) -> bool {
    !name.is_empty()
        && name.chars().all(|c| c.is_alphanumeric() || c == '_')
        && !name.starts_with(|c: char| c.is_numeric())
}

/// A list of `count` expressions (a single one where `count` is 1) of the names `known`.
pub(super) fn vector<'a>(
    reader: &Reader<'a>,
    key: &str,
    value: &Value<'a>,
    known: &[&str],
    (count, of): (usize, &str),
) -> Option<Vec<Entry>> {
    let otherwise = "expressions here know parameters, t, inputs and outputs or states";
    if count == 1 && !value.get_ref().is_array() {
        return Some(vec![entry(reader, key, value, known, otherwise)?]);
    }
    let list = reader.list(key, value, "a list of numbers and expressions")?;
    if list.len() != count {
        let message = format!("{} entries, wanted {count} ({of})", list.len());
        return reader.error(value.span().start, key, message, "give one entry each");
    }
    let each = list.iter().enumerate();
    all(each.map(|(i, v)| entry(reader, &format!("{key}[{i}]"), v, known, otherwise)))
}

/// A table of expressions by name, in the order of `names`; `None` where one is left out.
pub(super) fn by_name<'a>(
    reader: &Reader<'a>,
    key: &str,
    value: &Value<'a>,
    names: &[String],
    known: &[&str],
) -> Option<Vec<Option<Entry>>> {
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type(key, value, "a table of numbers by name");
    };
    let inner = Table::named(reader, key, value.span().start, map)?;
    let mut found = vec![None; names.len()];
    for (name, span, value) in inner.in_order() {
        let key = inner.key(name);
        let Some(at) = names.iter().position(|n| n == name) else {
            let list: Vec<&str> = names.iter().map(String::as_str).collect();
            let remedy = super::super::suggest::remedy(name, &list, "the names here are");
            return reader.error(span.start, &key, "no such name", remedy);
        };
        found[at] = Some(entry(reader, &key, value, known, "name it under parameters")?);
    }
    Some(found)
}
