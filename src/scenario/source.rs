//! The bytes of a scenario: bounded reading, encoding, lines and columns.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use super::diagnostic::{Diagnostic, Error};

/// Largest file that is read, in bytes.
pub(crate) const LIMIT: u64 = 8 << 20;
/// Deepest nesting of brackets; a matrix in an inline table needs four.
const DEPTH: usize = 32;
/// Most parts of a dotted key or table header.
const PARTS: usize = 16;

/// Reads the file at `path`, which must be a regular file of at most `limit`
/// bytes; anything else is refused before a byte is read.
pub(crate) fn read(path: &Path, limit: u64) -> Result<Vec<u8>, Error> {
    let fail = |source: io::Error| Error::Read { path: path.into(), source };
    let meta = std::fs::metadata(path).map_err(fail)?;
    if meta.is_dir() {
        let message = "is a directory: name the file in it";
        return Err(fail(io::Error::new(io::ErrorKind::IsADirectory, message)));
    }
    if !meta.is_file() {
        // a FIFO would block and /dev/zero never ends
        let message = "is not a regular file: write its text to one first";
        return Err(fail(io::Error::new(io::ErrorKind::InvalidInput, message)));
    }
    let too_large = |bytes| Error::TooLarge { path: path.into(), bytes, limit };
    if meta.len() > limit {
        return Err(too_large(meta.len()));
    }
    let mut bytes = Vec::new();
    // the file may grow between the two calls, so the read is bounded as well
    File::open(path)
        .map_err(fail)?
        .take(limit.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(fail)?;
    if bytes.len() as u64 > limit {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

/// The text of a scenario with its name and line starts.
#[derive(Debug)]
pub(super) struct Source<'a> {
    /// What the caller calls it.
    pub(super) name: &'a str,
    /// Without byte order mark.
    pub(super) text: &'a str,
    lines: Vec<usize>,
}

impl<'a> Source<'a> {
    /// Decodes and scans `bytes`; after this the text can be handed to the
    /// parser without fear for the stack.
    pub(super) fn new(name: &'a str, bytes: &'a [u8]) -> Result<Self, Error> {
        let whole = |line, column, message: &str, remedy: &str| {
            Err(Error::Invalid(vec![Diagnostic {
                file: name.into(),
                line,
                column,
                key: String::new(),
                message: message.into(),
                remedy: remedy.into(),
            }]))
        };
        if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
            return whole(1, 1, "the text is UTF-16", "save the file as UTF-8");
        }
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let text = match std::str::from_utf8(bytes) {
            Ok(text) => text,
            Err(e) => {
                let good = String::from_utf8_lossy(&bytes[..e.valid_up_to()]);
                let line = good.matches('\n').count() + 1;
                let column = good.chars().rev().take_while(|&c| c != '\n').count() + 1;
                return whole(line, column, "a byte is not UTF-8", "save the file as UTF-8");
            }
        };
        let starts = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i + 1);
        let source = Self { name, text, lines: std::iter::once(0).chain(starts).collect() };
        if text.trim().is_empty() {
            let remedy = "start from `mmae new pendulum`, which writes a commented scenario";
            return whole(1, 1, "the file is empty", remedy);
        }
        if let Some(at) = text.find('\0') {
            let (line, column) = source.position(at);
            return whole(line, column, "a NUL character", "remove it (or save the file as UTF-8)");
        }
        if let Some((at, message, remedy)) = too_deep(text) {
            let (line, column) = source.position(at);
            return whole(line, column, message, remedy);
        }
        Ok(source)
    }

    /// Line and column (in characters) of byte `at`, both from 1.
    pub(super) fn position(&self, at: usize) -> (usize, usize) {
        let mut at = at.min(self.text.len());
        while !self.text.is_char_boundary(at) {
            at -= 1;
        }
        let line = self.lines.partition_point(|&start| start <= at);
        let start = self.lines[line - 1];
        (line, self.text[start..at].chars().count() + 1)
    }
}

/// Place and complaint where brackets or dotted keys nest deeper than the
/// recursion of parser and drop glue should follow.
///
/// Only strings and comments are told apart from the rest: whatever else is
/// wrong is left for the parser to report.
fn too_deep(text: &str) -> Option<(usize, &'static str, &'static str)> {
    let bytes = text.as_bytes();
    let (mut at, mut depth, mut parts) = (0, 0_usize, 1_usize);
    while at < bytes.len() {
        match bytes[at] {
            b'#' => {
                at += bytes[at..].iter().position(|&b| b == b'\n').unwrap_or(bytes.len() - at);
                continue;
            }
            quote @ (b'"' | b'\'') => {
                at = after_string(bytes, at, quote);
                continue;
            }
            b'[' | b'{' => {
                depth += 1;
                if depth > DEPTH {
                    let remedy = "a scenario needs arrays of arrays, no deeper";
                    return Some((at, "brackets nest more than 32 deep", remedy));
                }
                parts = 1;
            }
            b']' | b'}' => {
                depth = depth.saturating_sub(1);
                parts = 1;
            }
            b'=' | b',' | b'\n' => parts = 1,
            b'.' => {
                parts += 1;
                if parts > PARTS {
                    let remedy = "the deepest key of a scenario has four parts";
                    return Some((at, "a key has more than 16 parts", remedy));
                }
            }
            _ => {}
        }
        at += 1;
    }
    None
}

/// Index after the TOML string that opens at `at`; a single-line string that
/// is not closed ends at its line.
fn after_string(bytes: &[u8], at: usize, quote: u8) -> usize {
    let triple = [quote; 3];
    let long = bytes[at..].starts_with(&triple);
    let mut i = at + if long { 3 } else { 1 };
    while i < bytes.len() {
        match bytes[i] {
            b'\\' if quote == b'"' => i += 1,
            b'\n' if !long => return i,
            b if b == quote && !long => return i + 1,
            b if b == quote && bytes[i..].starts_with(&triple) => {
                // up to two quotes may stand before the closing three
                let run = bytes[i..].iter().take(5).take_while(|&&b| b == quote).count();
                return i + run;
            }
            _ => {}
        }
        i += 1;
    }
    bytes.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_characters_and_lines() -> Result<(), Error> {
        let source = Source::new("f", "\u{feff}\u{e9}=1\r\nb = 2".as_bytes())?;
        assert_eq!(source.position(0), (1, 1));
        assert_eq!(source.position(2), (1, 2));
        assert_eq!(source.position(6), (2, 1));
        assert_eq!(source.position(999), (2, 6));
        Ok(())
    }

    #[test]
    fn brackets_in_strings_and_comments_do_not_nest() {
        let brackets = "[".repeat(100);
        for text in [
            format!("# {brackets}\na = 1"),
            format!("a = \"{brackets}\""),
            format!("a = '{brackets}'"),
            format!("a = \"\"\"\n{brackets}\\\"\"\"\"\"\nb = 1"),
            format!("a = '''\n{brackets}'''\nb = 1"),
        ] {
            assert_eq!(too_deep(&text), None, "{text}");
            assert!(too_deep(&format!("{text}\nc = {brackets}")).is_some(), "{text}");
        }
        assert!(too_deep(&format!("{}a = 1", "a.".repeat(10_000))).is_some());
    }
}
