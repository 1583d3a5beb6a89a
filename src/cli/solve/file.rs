//! The file of problems: `{"cases": [{"id", "eq", "A", "B", "Q", "R", "S"}, ..]}`.

use std::fmt;
use std::path::Path;

use serde::Deserialize;
use serde::de::{Deserializer, Visitor};

use crate::scenario::{Diagnostic, Error, source};

/// Largest file that is read, in bytes.
const LIMIT: u64 = 64 << 20;

/// A matrix as its rows; `ragged` ones are found later.
pub(super) type Rows = Vec<Vec<Entry>>;

/// All problems of a file.
#[derive(Deserialize)]
pub(super) struct Problems {
    pub(super) cases: Vec<Case>,
}

/// One equation. Keys that are not listed (a known solution, remarks) are the
/// user's own; `E` would change the equation, so it is read to be refused.
#[derive(Deserialize)]
#[expect(non_snake_case, reason = "capital letters are matrices")]
pub(super) struct Case {
    #[serde(deserialize_with = "name")]
    pub(super) id: String,
    pub(super) eq: Kind,
    pub(super) A: Rows,
    #[serde(default)]
    pub(super) B: Option<Rows>,
    pub(super) Q: Rows,
    #[serde(default)]
    pub(super) R: Option<Rows>,
    #[serde(default)]
    pub(super) S: Option<Rows>,
    #[serde(default)]
    pub(super) E: Option<Rows>,
}

/// The equation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Kind {
    /// `A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0`
    Care,
    /// `A'XA - X - (A'XB + S)(R + B'XB)^-1(B'XA + S') + Q = 0`
    Dare,
    /// `AX + XA' + Q = 0`
    Clyap,
    /// `AXA' - X + Q = 0`
    Dlyap,
}

impl Kind {
    pub(super) fn name(self) -> &'static str {
        match self {
            Kind::Care => "care",
            Kind::Dare => "dare",
            Kind::Clyap => "clyap",
            Kind::Dlyap => "dlyap",
        }
    }

    pub(super) fn is_riccati(self) -> bool {
        matches!(self, Kind::Care | Kind::Dare)
    }

    pub(super) fn is_continuous(self) -> bool {
        matches!(self, Kind::Care | Kind::Clyap)
    }
}

/// An entry of a matrix: a number, or one of the spellings of those that JSON
/// does not have, so that the case is refused and not the file.
#[derive(Clone, Copy)]
pub(super) struct Entry(pub(super) f64);

impl<'de> Deserialize<'de> for Entry {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Number;
        impl Visitor<'_> for Number {
            type Value = Entry;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number")
            }

            fn visit_f64<E>(self, v: f64) -> Result<Entry, E> {
                Ok(Entry(v))
            }

            fn visit_i64<E>(self, v: i64) -> Result<Entry, E> {
                Ok(Entry(v as f64))
            }

            fn visit_u64<E>(self, v: u64) -> Result<Entry, E> {
                Ok(Entry(v as f64))
            }

            fn visit_unit<E>(self) -> Result<Entry, E> {
                Ok(Entry(f64::NAN))
            }

            fn visit_str<E: serde::de::Error>(self, v: &str) -> Result<Entry, E> {
                match v.trim().to_ascii_lowercase().as_str() {
                    "nan" | "?" => Ok(Entry(f64::NAN)),
                    "inf" | "infinity" | "+inf" | "+infinity" => Ok(Entry(f64::INFINITY)),
                    "-inf" | "-infinity" => Ok(Entry(f64::NEG_INFINITY)),
                    _ => Err(E::invalid_type(serde::de::Unexpected::Str(v), &self)),
                }
            }
        }
        from.deserialize_any(Number)
    }
}

/// A name: text, or a number that serves as one.
fn name<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Name {
        Text(String),
        Number(serde_json::Number),
    }
    Ok(match Name::deserialize(from)? {
        Name::Text(text) => text,
        Name::Number(number) => number.to_string(),
    })
}

/// Reads a file of problems.
///
/// # Errors
/// `Read`, `TooLarge`, and `Invalid` with the place of what is not in the schema.
pub(super) fn read(path: &Path) -> Result<Problems, Error> {
    let mut bytes = source::read(path, LIMIT)?;
    spell_out(&mut bytes);
    serde_json::from_slice(&bytes).map_err(|e| {
        let text = e.to_string();
        // the parser repeats the place in its message
        let message = text.rsplit_once(" at line ").map_or(&*text, |(message, _)| message);
        Error::Invalid(vec![Diagnostic {
            file: path.display().to_string(),
            line: e.line().max(1),
            column: e.column().max(1),
            key: String::new(),
            message: message.into(),
            remedy:
                "write {\"cases\": [{\"id\", \"eq\", \"A\", \"B\", \"Q\", \"R\", \"S\"}, ..]}, \
                     matrices as lists of rows"
                    .into(),
        }])
    })
}

/// Puts `NaN`, `Infinity` and `-Infinity`, which some writers of JSON emit, in
/// quotes where they stand alone; a byte for a byte, so that places stay.
fn spell_out(bytes: &mut [u8]) {
    let mut at = 0;
    let mut in_string = false;
    while at < bytes.len() {
        match bytes[at] {
            b'\\' if in_string => at += 1,
            b'"' => in_string = !in_string,
            b'N' | b'I' | b'-' if !in_string => {
                for (word, quoted) in [
                    (&b"NaN"[..], &b"\"?\""[..]),
                    (b"Infinity", b"\"inf\"   "),
                    (b"-Infinity", b"\"-inf\"   "),
                ] {
                    if bytes[at..].starts_with(word) {
                        bytes[at..at + word.len()].copy_from_slice(quoted);
                        at += word.len() - 1;
                        break;
                    }
                }
            }
            _ => {}
        }
        at += 1;
    }
}
