//! CSV with a header.

use std::borrow::Cow;

use super::{Columns, Place, Record};
use crate::model::Names;
use crate::scenario::Error;

pub(super) fn read(bytes: &[u8], names: &Names, place: &Place) -> Result<Record, Error> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = single_column(bytes);
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(&text[..]);
    let header = match reader.headers() {
        Ok(header) => header.iter().map(String::from).collect::<Vec<_>>(),
        Err(e) => return place.error((1, 1), "", e.to_string(), "give a header of names"),
    };
    let mut columns = Columns::new(header.clone(), names, place)?;
    let mut row = csv::StringRecord::new();
    loop {
        let line = reader.position().line() as usize;
        match reader.read_record(&mut row) {
            Ok(true) => {}
            Ok(false) => break,
            Err(e) => {
                let at = e.position().map_or(line, |p| p.line() as usize);
                let remedy = "give every row as many fields as the header";
                return place.error((at, 1), "", e.to_string(), remedy);
            }
        }
        let at = row.position().map_or(line, |p| p.line() as usize);
        let field = |column: usize| {
            let text = row.get(column).unwrap_or("");
            match text {
                "" | "NA" | "na" | "nan" | "NaN" | "null" | "." => Ok(f64::NAN),
                text => match text.parse::<f64>() {
                    Ok(v) if v.is_finite() => Ok(v),
                    _ => {
                        let name = header.get(column).map_or("", String::as_str);
                        let clip: String = text.chars().take(30).collect();
                        let message = format!("'{clip}' is not a finite number");
                        let remedy = "write a number, or leave the field blank if it is missing";
                        place.error((at, column + 1), name, message, remedy)
                    }
                },
            }
        };
        columns.row(at, field)?;
    }
    Ok(columns.record)
}

/// In a file of one column an empty line is a sample that is missing: readers of
/// CSV skip it, so it is put in quotes. Empty lines at the end stay what they are.
fn single_column(bytes: &[u8]) -> Cow<'_, [u8]> {
    let header = bytes.split(|b| *b == b'\n').next().unwrap_or(&[]);
    if header.iter().any(|b| matches!(b, b',' | b'"')) {
        return Cow::Borrowed(bytes);
    }
    let end = bytes.iter().rposition(|b| !b.is_ascii_whitespace()).map_or(0, |k| k + 1);
    let mut out = Vec::with_capacity(bytes.len());
    for line in bytes[..end].split(|b| *b == b'\n') {
        let blank = line.iter().all(u8::is_ascii_whitespace);
        out.extend_from_slice(if blank { b"\"\"" } else { line });
        out.push(b'\n');
    }
    Cow::Owned(out)
}
