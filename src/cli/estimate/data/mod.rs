//! A recorded measurement stream, from a CSV file with a header or a Parquet table.

mod csv;
mod parquet;

use std::path::Path;

use crate::model::Names;
use crate::scenario::{Diagnostic, Error, source};

/// Largest file that is read, in bytes.
const LIMIT: u64 = 1 << 30;
/// Names of a column of times.
const TIMES: [&str; 2] = ["t", "time"];
/// The first bytes of a Parquet file.
const PARQUET: &[u8] = b"PAR1";

/// Samples in their order.
pub(in super::super) struct Record {
    /// One time a sample, where the file has a column of them.
    pub(in super::super) t: Option<Vec<f64>>,
    /// Shape (sample, output); NaN is missing.
    pub(in super::super) y: Vec<f64>,
    /// Shape (sample, input).
    pub(in super::super) u: Vec<f64>,
    pub(in super::super) len: usize,
}

/// Reads the columns that `names` asks for; others are left alone.
///
/// # Errors
/// `Read`, `TooLarge`; `Invalid` with line (row of a table) and field number for a
/// column that is missing, an entry that is no number, an input or time that is
/// blank.
pub(in super::super) fn read(path: &Path, names: &Names) -> Result<Record, Error> {
    let bytes = source::read(path, LIMIT)?;
    let place = Place { file: path.display().to_string() };
    let record = if bytes.starts_with(PARQUET) {
        parquet::read(bytes, names, &place)?
    } else {
        csv::read(&bytes, names, &place)?
    };
    if record.len == 0 {
        return place.error((1, 1), "", "no samples", "give a row a measurement");
    }
    Ok(record)
}

/// The file, for messages.
struct Place {
    file: String,
}

impl Place {
    fn error<T>(
        &self,
        (line, column): (usize, usize),
        key: &str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Result<T, Error> {
        Err(Error::Invalid(vec![Diagnostic {
            file: self.file.clone(),
            line,
            column,
            key: key.into(),
            message: message.into(),
            remedy: remedy.into(),
        }]))
    }
}

/// The columns that are wanted, and what was read of them.
struct Columns<'a> {
    place: &'a Place,
    header: Vec<String>,
    /// Outputs, then inputs.
    wanted: Vec<usize>,
    outputs: usize,
    time: Option<usize>,
    record: Record,
}

impl<'a> Columns<'a> {
    fn new(header: Vec<String>, names: &Names, place: &'a Place) -> Result<Self, Error> {
        let find = |name: &str| header.iter().position(|h| h == name);
        if header.iter().all(String::is_empty) {
            return place.error((1, 1), "", "no header", "give a header of names");
        }
        if let Some(name) = names.inputs.iter().find(|name| names.outputs.contains(name)) {
            let remedy = "give them names of their own in the scenario";
            return place.error((1, 1), name, "both an input and an output", remedy);
        }
        let asked = names.outputs.iter().chain(&names.inputs).map(String::as_str);
        for name in asked.chain(TIMES) {
            let mut columns = (0..header.len()).filter(|&c| header[c] == name);
            if let (Some(_), Some(second)) = (columns.next(), columns.next()) {
                let remedy = "keep one column of this name";
                return place.error((1, second + 1), name, "the name stands twice", remedy);
            }
        }
        let mut wanted = Vec::new();
        for name in names.outputs.iter().chain(&names.inputs) {
            match find(name) {
                Some(column) => wanted.push(column),
                None => {
                    let remedy = format!("name it in the header, which has {}", header.join(", "));
                    return place.error((1, 1), name, "no such column", remedy);
                }
            }
        }
        // an output may well be called t
        let times: Vec<usize> =
            TIMES.iter().filter_map(|name| find(name)).filter(|c| !wanted.contains(c)).collect();
        if let [_, second, ..] = times[..] {
            let (what, remedy) = ("two columns of times", "keep t or time");
            return place.error((1, second + 1), &header[second], what, remedy);
        }
        let time = times.first().copied();
        let record = Record { t: time.map(|_| Vec::new()), y: vec![], u: vec![], len: 0 };
        Ok(Self { place, header, wanted, outputs: names.outputs.len(), time, record })
    }

    /// Takes in the row at `line`; `field` gives the number in a column, NaN where
    /// it is missing.
    fn row(
        &mut self,
        line: usize,
        field: impl Fn(usize) -> Result<f64, Error>,
    ) -> Result<(), Error> {
        for (k, &column) in self.wanted.iter().enumerate() {
            let value = field(column)?;
            if k < self.outputs {
                self.record.y.push(value);
            } else if value.is_nan() {
                let name = &self.header[column];
                let remedy = "inputs are known: write what was applied";
                return self.place.error((line, column + 1), name, "the input is missing", remedy);
            } else {
                self.record.u.push(value);
            }
        }
        if let (Some(column), Some(t)) = (self.time, &mut self.record.t) {
            let value = field(column)?;
            if value.is_nan() {
                let name = &self.header[column];
                let remedy = "give every row its time, or remove the column";
                return self.place.error((line, column + 1), name, "the time is missing", remedy);
            }
            if t.last().is_some_and(|&last| value <= last) {
                let name = &self.header[column];
                let remedy = "give a time later than that of the row before";
                return self.place.error((line, column + 1), name, "times must increase", remedy);
            }
            t.push(value);
        }
        self.record.len += 1;
        Ok(())
    }
}
