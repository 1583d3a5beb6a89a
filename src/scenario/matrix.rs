//! Matrices of a scenario: rows of numbers or expressions.

use std::hash::{DefaultHasher, Hash, Hasher};

use faer::Mat;
use toml::de::DeValue;

use super::expression::Entry;
use super::reader::{Reader, Value, all, clip};

/// Most different expressions of a scenario; each takes some 20 kB.
const EXPRESSIONS: usize = 5000;

/// What expressions may mention.
#[derive(Clone, Copy)]
pub(super) struct Scope<'n> {
    /// Names of the values, in the order of their indices.
    pub(super) names: &'n [&'n str],
    /// What to do about a name that is like none of them.
    pub(super) otherwise: &'static str,
}

impl Scope<'_> {
    /// A number that tells the names of two scopes apart.
    fn fingerprint(self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.names.hash(&mut hasher);
        hasher.finish()
    }
}

/// The scope of matrices that are the same for every plant.
pub(super) const CONSTANT: Scope<'static> = Scope {
    names: &[],
    otherwise: "entries here do not follow the plant's parameters: use numbers, pi and e",
};

/// A wanted number of rows or columns and what it counts.
#[derive(Clone, Copy)]
pub(super) struct Size<'n> {
    /// `None` where the matrix itself decides.
    pub(super) n: Option<usize>,
    /// `states` and so on.
    pub(super) of: &'n str,
}

impl<'n> Size<'n> {
    pub(super) fn new(n: usize, of: &'n str) -> Self {
        Self { n: Some(n), of }
    }

    pub(super) fn free(of: &'n str) -> Self {
        Self { n: None, of }
    }

    fn admits(self, n: usize) -> bool {
        self.n.is_none_or(|want| want == n)
    }
}

/// A matrix as it was written.
pub(super) struct Written {
    pub(super) rows: usize,
    pub(super) cols: usize,
    /// Entries by rows.
    pub(super) entries: Vec<Entry>,
    /// Where each entry starts.
    pub(super) at: Vec<usize>,
}

impl Written {
    /// The value at the parameter values `values`; the first entry that is not
    /// finite is reported under `key`.
    pub(super) fn evaluate(
        &self,
        reader: &Reader<'_>,
        key: &str,
        names: &[&str],
        values: &[f64],
    ) -> Option<Mat<f64>> {
        let flat: Vec<f64> = self.entries.iter().map(|e| e.value(values)).collect();
        if let Some(k) = flat.iter().position(|v| !v.is_finite()) {
            let used: Vec<String> = self.entries[k]
                .variables()
                .iter()
                .map(|&v| format!("{} = {}", names[v], values[v]))
                .collect();
            let message = if used.is_empty() {
                "the entry is not a finite number".into()
            } else {
                format!("the entry is not finite at the nominal values ({})", used.join(", "))
            };
            let key = format!("{key}[{}][{}]", k / self.cols, k % self.cols);
            return reader.error(
                self.at[k],
                &key,
                message,
                "look for a division by zero, or a root or logarithm of a negative number",
            );
        }
        Some(Mat::from_fn(self.rows, self.cols, |i, j| flat[i * self.cols + j]))
    }
}

impl<'a> Reader<'a> {
    /// A matrix: a list of rows; a plain list where one side is 1; a single
    /// entry where both are.
    pub(super) fn matrix(
        &self,
        key: &str,
        value: &Value<'a>,
        scope: Scope<'_>,
        [rows, cols]: [Size<'_>; 2],
    ) -> Option<Written> {
        let start = value.span().start;
        let DeValue::Array(list) = value.get_ref() else {
            let entry = self.entry(key, value, scope)?;
            if !(rows.admits(1) && cols.admits(1)) {
                let message = format!("a single entry where {} should be", want(rows, cols));
                return self.error(start, key, message, "write rows: [[..], [..]]");
            }
            return Some(Written { rows: 1, cols: 1, entries: vec![entry], at: vec![start] });
        };
        if list.is_empty() {
            let message = format!("empty, where {} should be", want(rows, cols));
            return self.error(start, key, message, "write rows: [[..], [..]]");
        }
        let nested = list.iter().filter(|v| v.get_ref().is_array()).count();
        if nested == 0 {
            let (r, c) = match list.len() {
                n if cols.n == Some(1) || (cols.n.is_none() && rows.n == Some(n)) => (n, 1),
                n if rows.n == Some(1) => (1, n),
                n => {
                    let message = format!("a list of {n} where {} should be", want(rows, cols));
                    return self.error(start, key, message, "write rows: [[..], [..]]");
                }
            };
            if !(rows.admits(r) && cols.admits(c)) {
                return self.wrong_shape(key, start, [r, c], [rows, cols]);
            }
            let name =
                |k: usize| if c == 1 { format!("{key}[{k}][0]") } else { format!("{key}[0][{k}]") };
            let entries = list.iter().enumerate().map(|(k, v)| self.entry(&name(k), v, scope));
            let at = list.iter().map(|v| v.span().start).collect();
            return Some(Written { rows: r, cols: c, entries: all(entries)?, at });
        }
        // one diagnostic for a wrong shape, not one a row
        let mut width = None;
        for (i, row) in list.iter().enumerate() {
            let row_key = format!("{key}[{i}]");
            let row_at = row.span().start;
            let DeValue::Array(row) = row.get_ref() else {
                let message = "a single entry where a row should be";
                return self.error(row_at, &row_key, message, "put the row in brackets");
            };
            let first = *width.get_or_insert(row.len());
            if row.len() != first {
                let message = format!("the row has {} entries, row 0 has {first}", row.len());
                return self.error(row_at, &row_key, message, "give every row as many entries");
            }
        }
        let (r, c) = (list.len(), width.unwrap_or(0));
        if !(rows.admits(r) && cols.admits(c)) || c == 0 {
            return self.wrong_shape(key, start, [r, c], [rows, cols]);
        }
        let cells = || {
            list.iter().enumerate().flat_map(|(i, row)| {
                let row = row.get_ref().as_array().map_or(&[][..], |r| r);
                row.iter().enumerate().map(move |(j, v)| (i, j, v))
            })
        };
        let entries = cells().map(|(i, j, v)| self.entry(&format!("{key}[{i}][{j}]"), v, scope));
        let at = cells().map(|(_, _, v)| v.span().start).collect();
        Some(Written { rows: r, cols: c, entries: all(entries)?, at })
    }

    /// A covariance of order `n`: a number on the whole diagonal, a list of
    /// diagonal entries, or a matrix.
    pub(super) fn covariance(
        &self,
        key: &str,
        value: &Value<'a>,
        scope: Scope<'_>,
        size: Size<'_>,
    ) -> Option<Written> {
        let start = value.span().start;
        let n = size.n.unwrap_or(1);
        let diagonal = match value.get_ref() {
            DeValue::Array(list) if list.iter().any(|v| v.get_ref().is_array()) => {
                return self.matrix(key, value, scope, [size, size]);
            }
            DeValue::Array(list) => {
                if list.len() != n {
                    let message =
                        format!("a diagonal of {} entries, wanted {n} ({})", list.len(), size.of);
                    return self.error(start, key, message, "give one entry a channel");
                }
                let each = list.iter().enumerate();
                let entry = |(i, v): (usize, &Value<'a>)| {
                    Some((self.entry(&format!("{key}[{i}][{i}]"), v, scope)?, v.span().start))
                };
                all(each.map(entry))?
            }
            _ => vec![(self.entry(key, value, scope)?, start); n],
        };
        let (mut entries, mut at) = (vec![Entry::Constant(0.0); n * n], vec![start; n * n]);
        for (i, (entry, place)) in diagonal.into_iter().enumerate() {
            entries[i * n + i] = entry;
            at[i * n + i] = place;
        }
        Some(Written { rows: n, cols: n, entries, at })
    }

    /// A number or an expression.
    pub(super) fn entry(&self, key: &str, value: &Value<'a>, scope: Scope<'_>) -> Option<Entry> {
        let DeValue::String(text) = value.get_ref() else {
            return match value.get_ref() {
                DeValue::Integer(_) | DeValue::Float(_) => {
                    self.number(key, value).map(Entry::Constant)
                }
                _ => self.wrong_type(key, value, "a number or an expression in quotes"),
            };
        };
        let known = (scope.fingerprint(), text.to_string());
        if let Some(entry) = self.compiled.borrow().get(&known) {
            return Some(entry.clone());
        }
        match Entry::compile(text, scope.names) {
            Ok(entry) => {
                let mut compiled = self.compiled.borrow_mut();
                if compiled.len() >= EXPRESSIONS {
                    let message = format!("over {EXPRESSIONS} different expressions");
                    return self.error(value.span().start, key, message, "build the plant in code");
                }
                compiled.insert(known, entry.clone());
                Some(entry)
            }
            Err(fault) => {
                let span = value.span();
                // without escapes the text stands in the file as it is, after
                // one or three quotes
                let inside =
                    self.source.text[span.clone()].find(text.as_ref()).map(|i| i + fault.at);
                let at = span.start + inside.unwrap_or(0);
                let remedy = match (fault.unknown, scope.names) {
                    (false, _) => fault.remedy,
                    (true, []) => scope.otherwise.to_string(),
                    (true, _) => format!("{} ({})", scope.otherwise, fault.remedy),
                };
                let message = format!("in \"{}\": {}", clip(text), fault.message);
                self.error(at, key, message, remedy)
            }
        }
    }

    fn wrong_shape<T>(
        &self,
        key: &str,
        at: usize,
        got: [usize; 2],
        [rows, cols]: [Size<'_>; 2],
    ) -> Option<T> {
        let message = format!("{} by {}, wanted {}", got[0], got[1], want(rows, cols));
        let swapped = rows.admits(got[1]) && cols.admits(got[0]);
        let remedy = if swapped {
            "transpose it: each inner list is a row"
        } else {
            "each inner list is a row; sizes follow the lists of names"
        };
        self.error(at, key, message, remedy)
    }
}

fn want(rows: Size<'_>, cols: Size<'_>) -> String {
    let side = |s: Size<'_>| match s.n {
        Some(n) => format!("{n} ({})", s.of),
        None => format!("any number ({})", s.of),
    };
    format!("{} by {}", side(rows), side(cols))
}
