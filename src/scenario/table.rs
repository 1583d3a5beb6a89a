//! Tables and their keys.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeString, DeTable};

use super::reader::{MOST, Reader, Value, clip};
use super::suggest;

/// Most keys of a table whose keys are names: parameters, axes of a grid.
const NAMES: usize = 1000;

/// A table with its path and the keys it may have.
#[derive(Clone, Copy)]
pub(super) struct Table<'r, 'a> {
    pub(super) reader: &'r Reader<'a>,
    /// Dotted path, empty for the top.
    pub(super) path: &'r str,
    /// Where it is declared.
    pub(super) at: usize,
    map: &'r DeTable<'a>,
    known: &'static [&'static str],
}

impl<'r, 'a> Table<'r, 'a> {
    /// A table whose keys are all in `known`; others are reported.
    pub(super) fn new(
        reader: &'r Reader<'a>,
        path: &'r str,
        at: usize,
        map: &'r DeTable<'a>,
        known: &'static [&'static str],
    ) -> Self {
        let table = Self { reader, path, at, map, known };
        table.strangers().take(MOST).for_each(|key| table.unknown(key));
        table
    }

    /// The keys that are not known.
    fn strangers(&self) -> impl Iterator<Item = &'r Spanned<DeString<'a>>> {
        self.map.keys().filter(|k| !self.known.contains(&k.get_ref().as_ref()))
    }

    /// A table whose keys are names that the caller checks.
    pub(super) fn named(
        reader: &'r Reader<'a>,
        path: &'r str,
        at: usize,
        map: &'r DeTable<'a>,
    ) -> Option<Self> {
        if map.len() > NAMES {
            let message = format!("{} keys, over the limit of {NAMES}", map.len());
            return reader.error(at, path, message, "build such a family in code");
        }
        Some(Self { reader, path, at, map, known: &[] })
    }

    fn unknown(&self, key: &Spanned<DeString<'a>>) {
        let known = self.known;
        let word = clip(key.get_ref());
        let place = if self.path.is_empty() { "the top" } else { self.path };
        let mut remedy = suggest::remedy(&word, known, "the keys here are");
        let near = suggest::nearest(&word, known);
        if near.is_none()
            && let Some(home) = super::keys::home(&word)
        {
            remedy = format!("it belongs in [{home}]");
        }
        let message = format!("unknown key in {place}");
        self.reader.error::<()>(key.span().start, &self.key(&word), message, remedy);
    }

    /// The dotted path of `key`.
    pub(super) fn key(&self, key: &str) -> String {
        if self.path.is_empty() { key.into() } else { format!("{}.{key}", self.path) }
    }

    /// Where the key `inner` of the table `key` stands.
    pub(super) fn place(&self, key: &str, inner: &str) -> usize {
        let table = self.get(key).and_then(|value| value.get_ref().as_table());
        let found = table.and_then(|map| map.get_key_value(inner));
        found.map_or(self.at, |(key, _)| key.span().start)
    }

    /// Everything in it.
    pub(super) fn top(&self) -> &'r DeTable<'a> {
        self.map
    }

    /// The value of `key`, if it is there.
    pub(super) fn get(&self, key: &str) -> Option<&'r Value<'a>> {
        self.map.get(key)
    }

    /// Where the value of `key` starts; the table where there is none.
    pub(super) fn at(&self, key: &str) -> usize {
        self.get(key).map_or(self.at, |v| v.span().start)
    }

    /// The value of `key`; reported when there is none, unless a key that was
    /// reported as unknown looks like it.
    pub(super) fn need(&self, key: &str, remedy: &str) -> Option<&'r Value<'a>> {
        let meant = |k: &Spanned<DeString<'a>>| suggest::nearest(k.get_ref(), &[key]).is_some();
        match self.get(key) {
            None if self.strangers().take(MOST).any(meant) => None,
            None => self.error(key, "missing", remedy),
            value => value,
        }
    }

    /// An error at the value of `key`.
    pub(super) fn error<T>(
        &self,
        key: &str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Option<T> {
        self.reader.error(self.at(key), &self.key(key), message, remedy)
    }

    /// Keys, their places and values in the order of the file.
    pub(super) fn in_order(&self) -> Vec<(&'r str, Range<usize>, &'r Value<'a>)> {
        let mut all: Vec<_> =
            self.map.iter().map(|(k, v)| (k.get_ref().as_ref(), k.span(), v)).collect();
        all.sort_by_key(|(_, span, _)| span.start);
        all
    }
}
