//! A recorded measurement stream: CSV with a header.

use std::borrow::Cow;
use std::path::Path;

use crate::model::Names;
use crate::scenario::{Diagnostic, Error, source};

/// Largest file that is read, in bytes.
const LIMIT: u64 = 1 << 30;
/// Names of a column of times.
const TIMES: [&str; 2] = ["t", "time"];

/// Samples in their order.
pub(super) struct Record {
    /// One time a sample, where the file has a column of them.
    pub(super) t: Option<Vec<f64>>,
    /// Shape (sample, output); NaN is missing.
    pub(super) y: Vec<f64>,
    /// Shape (sample, input).
    pub(super) u: Vec<f64>,
    pub(super) len: usize,
}

struct Place<'a> {
    file: &'a str,
}

impl Place<'_> {
    fn error<T>(
        &self,
        (line, column): (usize, usize),
        key: &str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Result<T, Error> {
        Err(Error::Invalid(vec![Diagnostic {
            file: self.file.into(),
            line,
            column,
            key: key.into(),
            message: message.into(),
            remedy: remedy.into(),
        }]))
    }
}

/// Reads the columns that `names` asks for; others are left alone.
///
/// # Errors
/// `Read`, `TooLarge`; `Invalid` with line and field number for a column that is
/// missing, an entry that is no number, an input or time that is blank.
pub(super) fn read(path: &Path, names: &Names) -> Result<Record, Error> {
    let bytes = source::read(path, LIMIT)?;
    let file = path.display().to_string();
    let place = Place { file: &file };
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let text = single_column(bytes);
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(&text[..]);
    let header = match reader.headers() {
        Ok(header) => header.clone(),
        Err(e) => return place.error((1, 1), "", e.to_string(), "give a header of names"),
    };
    let find = |name: &str| header.iter().position(|h| h == name);
    let mut columns = Vec::new();
    for name in names.outputs.iter().chain(&names.inputs) {
        match find(name) {
            Some(column) => columns.push(column),
            None => {
                let known: Vec<&str> = header.iter().collect();
                let remedy = format!("name it in the header, which has {}", known.join(", "));
                return place.error((1, 1), name, "no such column", remedy);
            }
        }
    }
    // an output may well be called t
    let time = TIMES.iter().find_map(|name| find(name)).filter(|c| !columns.contains(c));
    let outputs = names.outputs.len();
    let mut record = Record { t: time.map(|_| Vec::new()), y: vec![], u: vec![], len: 0 };
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
                        let name = header.get(column).unwrap_or("");
                        let message = format!("'{}' is not a finite number", clip(text));
                        let remedy = "write a number, or leave the field blank if it is missing";
                        place.error((at, column + 1), name, message, remedy)
                    }
                },
            }
        };
        for (k, &column) in columns.iter().enumerate() {
            let value = field(column)?;
            if k < outputs {
                record.y.push(value);
            } else if value.is_nan() {
                let name = header.get(column).unwrap_or("");
                let remedy = "inputs are known: write what was applied";
                return place.error((at, column + 1), name, "the input is missing", remedy);
            } else {
                record.u.push(value);
            }
        }
        if let (Some(column), Some(t)) = (time, &mut record.t) {
            let value = field(column)?;
            if value.is_nan() || t.last().is_some_and(|&last| value <= last) {
                let name = header.get(column).unwrap_or("");
                let remedy = "give a time later than that of the row before";
                return place.error((at, column + 1), name, "times must increase", remedy);
            }
            t.push(value);
        }
        record.len += 1;
    }
    if record.len == 0 {
        return place.error((1, 1), "", "no samples", "give a row a measurement");
    }
    Ok(record)
}

fn clip(text: &str) -> String {
    text.chars().take(30).collect()
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
