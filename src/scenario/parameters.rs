//! `[plant.parameters]`: nominal values, and quantities that follow from them.

use toml::de::DeValue;

use super::expression::Entry;
use super::family::{ExpressionFamily, Origin, Quantity};
use super::matrix::Scope;
use super::operators::{CONSTANTS, FUNCTIONS};
use super::table::Table;
use crate::model::Parameter;

/// Reads `[plant.parameters]` in the order of the file. One that is wrong is
/// reported and kept, so that its users are not reported as well.
pub(super) fn quantities(table: &Table<'_, '_>) -> Option<(Vec<Parameter>, Vec<Quantity>)> {
    let (mut free, mut quantities) = (Vec::new(), Vec::<Quantity>::new());
    let Some(value) = table.get("parameters") else { return Some((free, quantities)) };
    let reader = table.reader;
    let DeValue::Table(map) = value.get_ref() else {
        return reader.wrong_type("plant.parameters", value, "a table of numbers");
    };
    let inner = Table::named(reader, "plant.parameters", value.span().start, map)?;
    for (name, span, value) in inner.in_order() {
        let key = inner.key(name);
        let entry = {
            let known: Vec<&str> = quantities.iter().map(|q| q.name.as_str()).collect();
            let scope = Scope { names: &known, otherwise: "a parameter can use those above it" };
            reader.entry(&key, value, scope)
        };
        let bad = match &entry {
            Some(Entry::Constant(value)) if !value.is_finite() => Some((
                "not a finite number".to_string(),
                "look for a division by zero, or a root of a negative number",
            )),
            _ => bad_name(name),
        };
        let entry = match bad {
            Some((message, remedy)) => reader.error(span.start, &key, message, remedy),
            None => entry,
        };
        let value = match entry {
            Some(entry @ (Entry::Parameter(_) | Entry::Formula(_))) => Origin::Derived(entry),
            number => {
                let nominal = number.map_or(1.0, |n| n.value(&[]));
                free.push(Parameter { name: name.into(), nominal });
                Origin::Free(free.len() - 1)
            }
        };
        quantities.push(Quantity { name: name.into(), value });
    }
    Some((free, quantities))
}

/// What keeps `name` from being used in expressions.
fn bad_name(name: &str) -> Option<(String, &'static str)> {
    let letter = |c: char| c.is_alphabetic() || c == '_';
    if name.len() > 100
        || !name.starts_with(letter)
        || !name.chars().all(|c| letter(c) || c.is_numeric())
    {
        return Some(("not a name that expressions can use".into(), "use letters, digits and _"));
    }
    let constant = CONSTANTS.iter().any(|(n, _)| *n == name);
    if constant || FUNCTIONS.iter().any(|f| f.name == name) {
        let kind = if constant { "constant" } else { "function" };
        return Some((format!("'{name}' is a {kind} of the language"), "choose another name"));
    }
    None
}

/// Warns of parameters without effect.
pub(super) fn unused(table: &Table<'_, '_>, family: &ExpressionFamily) {
    for (quantity, used) in family.quantities.iter().zip(family.used()) {
        if !used {
            let at = table.place("parameters", &quantity.name);
            let path = format!("plant.parameters.{}", quantity.name);
            let remedy = "remove it, or use it in a matrix";
            table.reader.warn(at, &path, "no matrix depends on it", remedy);
        }
    }
}
