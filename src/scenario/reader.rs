//! Tables, keys and plain values of a scenario, with a diagnostic for each one
//! that is not what it should be.

use std::cell::RefCell;
use std::collections::HashMap;

use toml::Spanned;
use toml::de::{DeArray, DeInteger, DeValue};

use super::diagnostic::{Diagnostic, Error};
use super::expression::Entry;
use super::source::Source;
use super::suggest;

/// Diagnostics kept; a file with more is not what it claims to be.
pub(super) const MOST: usize = 20;

/// A value with its place, as the parser gives it.
pub(super) type Value<'a> = Spanned<DeValue<'a>>;

/// The source and what was found in it so far.
pub(super) struct Reader<'a> {
    pub(super) source: &'a Source<'a>,
    errors: RefCell<Vec<Diagnostic>>,
    warnings: RefCell<Vec<Diagnostic>>,
    engine: RefCell<Option<(Diagnostic, crate::Error)>>,
    /// Compiled expressions by the names in scope and text.
    pub(super) compiled: RefCell<HashMap<(u64, String), Entry>>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(source: &'a Source<'a>) -> Self {
        Self {
            source,
            errors: RefCell::default(),
            warnings: RefCell::default(),
            engine: RefCell::default(),
            compiled: RefCell::default(),
        }
    }

    /// A diagnostic at byte `at`.
    pub(super) fn diagnostic(
        &self,
        at: usize,
        key: &str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Diagnostic {
        let (line, column) = self.source.position(at);
        Diagnostic {
            file: self.source.name.into(),
            line,
            column,
            key: key.into(),
            message: message.into(),
            remedy: remedy.into(),
        }
    }

    /// Records an error at byte `at`; always `None`, for use as a result.
    pub(super) fn error<T>(
        &self,
        at: usize,
        key: &str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Option<T> {
        let mut errors = self.errors.borrow_mut();
        if errors.len() < MOST {
            errors.push(self.diagnostic(at, key, message, remedy));
        }
        None
    }

    /// Records something odd that is no error.
    pub(super) fn warn(
        &self,
        at: usize,
        key: &str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        let mut warnings = self.warnings.borrow_mut();
        if warnings.len() < MOST {
            warnings.push(self.diagnostic(at, key, message, remedy));
        }
    }

    /// As [`Reader::warn`], at a line and column.
    pub(super) fn warn_at(&self, place: (usize, usize), key: &str, message: &str, remedy: &str) {
        let (line, column) = place;
        let at = self.diagnostic(0, key, message, remedy);
        let mut warnings = self.warnings.borrow_mut();
        if warnings.len() < MOST {
            warnings.push(Diagnostic { line, column, ..at });
        }
    }

    /// True after the first error.
    pub(super) fn failed(&self) -> bool {
        !self.errors.borrow().is_empty()
    }

    /// Records what the engine refuses, with the place responsible; the first
    /// stands.
    pub(super) fn engine<T>(&self, at: usize, key: &str, error: crate::Error) -> Option<T> {
        let (message, remedy) = super::places::split(&error);
        self.refuse(self.diagnostic(at, key, message, remedy), error);
        None
    }

    /// As [`Reader::engine`], with the diagnostic made already.
    pub(super) fn refuse(&self, at: Diagnostic, error: crate::Error) {
        self.engine.borrow_mut().get_or_insert((at, error));
    }

    /// The warnings, or what is wrong: everything of the file's own, else what
    /// the engine refuses. Both in file order.
    pub(super) fn finish(self) -> Result<Vec<Diagnostic>, Error> {
        let (mut errors, mut warnings) = (self.errors.into_inner(), self.warnings.into_inner());
        if !errors.is_empty() {
            errors.sort_by_key(|d| (d.line, d.column));
            return Err(Error::Invalid(errors));
        }
        if let Some((at, source)) = self.engine.into_inner() {
            return Err(Error::Engine { at: Box::new(at), source });
        }
        warnings.sort_by_key(|d| (d.line, d.column));
        Ok(warnings)
    }

    /// The type that was given in place of `wanted`.
    pub(super) fn wrong_type<T>(&self, key: &str, value: &Value<'_>, wanted: &str) -> Option<T> {
        let (given, remedy) = match value.get_ref() {
            DeValue::String(s) if s.trim().parse::<f64>().is_ok() => {
                (format!("the string \"{}\"", clip(s)), format!("write {} without quotes", clip(s)))
            }
            DeValue::String(s) => {
                (format!("the string \"{}\"", clip(s)), format!("write {wanted}"))
            }
            DeValue::Integer(_) => ("an integer".into(), format!("write {wanted}")),
            DeValue::Float(_) => {
                ("a number with a decimal point".into(), format!("write {wanted}"))
            }
            DeValue::Boolean(b) => (format!("{b}"), format!("write {wanted}")),
            DeValue::Datetime(_) => ("a date".into(), format!("write {wanted}")),
            DeValue::Array(_) => ("a list".into(), format!("write {wanted}")),
            DeValue::Table(_) => ("a table".into(), format!("write {wanted}")),
        };
        self.error(value.span().start, key, format!("{given} where {wanted} should be"), remedy)
    }

    /// A finite number.
    pub(super) fn number(&self, key: &str, value: &Value<'_>) -> Option<f64> {
        let at = value.span().start;
        let number = match value.get_ref() {
            DeValue::Integer(i) => self.integer_text(key, at, i)? as f64,
            DeValue::Float(f) => match f.as_str().parse::<f64>() {
                Ok(number) => number,
                Err(_) => return self.wrong_type(key, value, "a number"),
            },
            _ => return self.wrong_type(key, value, "a number"),
        };
        if number.is_finite() {
            return Some(number);
        }
        let text = &self.source.text[value.span()];
        self.error(
            at,
            key,
            format!("{} is not a finite number", clip(text)),
            "give a finite number",
        )
    }

    /// A whole number of at least `least`.
    pub(super) fn integer(&self, key: &str, value: &Value<'_>, least: i64) -> Option<u64> {
        let at = value.span().start;
        match value.get_ref() {
            DeValue::Integer(i) => match self.integer_text(key, at, i)? {
                n if n >= least => u64::try_from(n).ok(),
                n => self.error(at, key, format!("{n} is too small"), format!("at least {least}")),
            },
            _ => self.wrong_type(key, value, "a whole number"),
        }
    }

    fn integer_text(&self, key: &str, at: usize, integer: &DeInteger<'_>) -> Option<i64> {
        i64::from_str_radix(integer.as_str(), integer.radix()).ok().or_else(|| {
            let message = format!("the integer {} does not fit 64 bits", clip(integer.as_str()));
            self.error(at, key, message, "write it with a decimal point, or smaller")
        })
    }

    /// A list of finite numbers, at least one.
    pub(super) fn numbers(&self, key: &str, value: &Value<'_>) -> Option<Vec<f64>> {
        let list = self.list(key, value, "a list of numbers")?;
        if list.is_empty() {
            return self.error(value.span().start, key, "the list is empty", "give at least one");
        }
        let each = |(i, v)| self.number(&format!("{key}[{i}]"), v);
        all(list.iter().enumerate().map(each))
    }

    /// A list of anything.
    pub(super) fn list<'v>(
        &self,
        key: &str,
        value: &'v Value<'a>,
        wanted: &str,
    ) -> Option<&'v DeArray<'a>> {
        match value.get_ref() {
            DeValue::Array(list) => Some(list),
            _ => self.wrong_type(key, value, wanted),
        }
    }

    pub(super) fn string<'v>(&self, key: &str, value: &'v Value<'a>) -> Option<&'v str> {
        match value.get_ref() {
            DeValue::String(s) => Some(s),
            _ => self.wrong_type(key, value, "a string"),
        }
    }

    pub(super) fn boolean(&self, key: &str, value: &Value<'_>) -> Option<bool> {
        match value.get_ref() {
            DeValue::Boolean(b) => Some(*b),
            _ => self.wrong_type(key, value, "true or false"),
        }
    }

    /// One of `choices` by name.
    pub(super) fn choice<T: Copy>(
        &self,
        key: &str,
        value: &Value<'a>,
        choices: &[(&str, T)],
    ) -> Option<T> {
        let word = self.string(key, value)?;
        if let Some((_, choice)) = choices.iter().find(|(name, _)| *name == word) {
            return Some(*choice);
        }
        let known: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
        let remedy = suggest::remedy(word, &known, "the choices are");
        self.error(value.span().start, key, format!("no choice is called '{}'", clip(word)), remedy)
    }

    /// A list of names, all different, none empty.
    pub(super) fn names(&self, key: &str, value: &Value<'a>) -> Option<Vec<String>> {
        let list = self.list(key, value, "a list of names")?;
        let names: Vec<String> = all(list.iter().enumerate().map(|(i, v)| {
            let key = format!("{key}[{i}]");
            let name = self.string(&key, v)?;
            if name.trim().is_empty() || name.len() > 100 || name.contains(char::is_control) {
                let remedy = "give 1 to 100 printable characters";
                return self.error(v.span().start, &key, "not a name", remedy);
            }
            Some(name.to_string())
        }))?;
        let mut sorted: Vec<(&String, usize)> = names.iter().zip(0..).collect();
        sorted.sort_unstable();
        let twice = sorted.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| w[1].1).min();
        match twice {
            Some(i) => {
                let message = format!("the name '{}' is given twice", names[i]);
                let key = format!("{key}[{i}]");
                self.error(list[i].span().start, &key, message, "give each its own name")
            }
            None => Some(names),
        }
    }
}

/// Every value, or `None` if one is missing; all of them are looked at, so that
/// each has its say.
pub(super) fn all<T>(values: impl Iterator<Item = Option<T>>) -> Option<Vec<T>> {
    let (mut good, mut complete) = (Vec::new(), true);
    for value in values {
        match value {
            Some(value) => good.push(value),
            None => complete = false,
        }
    }
    complete.then_some(good)
}

/// At most the first 40 characters, for messages.
pub(super) fn clip(text: &str) -> String {
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}
