//! The study as JSON, schema `mmae.eip/1` (see the guide, page "results").

use std::io::{self, Write};

use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::eip::{
    Boundary, Case, Convention, Doubt, EipSets, Failed, Interval, Method, Undecidable, Undecided,
    Unstable,
};
use crate::report::identify::IdentificationFields;
use crate::report::robust::{RobustFields, SweepFields};

/// Name and version of the layout.
pub const SCHEMA: &str = "mmae.eip/1";

/// Writes the study as one JSON object, one key a line, and a line break.
///
/// Numbers are the shortest decimals that read back as the same bits; what is
/// not defined is `null`. Indices count from 0.
///
/// # Errors
/// Whatever `out` reports.
pub fn write(sets: &EipSets, out: impl Write) -> io::Result<()> {
    let mut out = out;
    let mut serializer = serde_json::Serializer::with_formatter(&mut out, Lines::default());
    Document::new(sets).serialize(&mut serializer)?;
    out.write_all(b"\n")
}

/// The study as a JSON text, as [`write()`] writes it.
pub fn to_string(sets: &EipSets) -> String {
    let mut bytes = Vec::new();
    // writing to memory does not fail, and JSON is UTF-8
    let _ = write(sets, &mut bytes);
    String::from_utf8(bytes).unwrap_or_default()
}

#[derive(serde::Serialize)]
struct Document<'a> {
    schema: &'static str,
    version: &'static str,
    title: Option<&'a str>,
    parameter: Option<&'a str>,
    parameters: &'a [String],
    models: Vec<ModelValues<'a>>,
    labels: Vec<&'a str>,
    convention: &'static str,
    dt: Option<f64>,
    grid: GridValues<'a>,
    delays: Vec<f64>,
    #[serde(flatten)]
    first: Option<CaseFields<'a>>,
    undecidable: Vec<UndecidableFields<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    robust: Option<RobustFields<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    delay_interval: Option<SweepFields<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    identification: Option<IdentificationFields<'a>>,
    upsilon_at_nominals: Rows<'a>,
    pseudo_norm: Vec<Vec<f64>>,
    failures: Vec<Failure>,
    duplicates: Vec<Duplicate>,
    method: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    cases: Option<Vec<CaseFields<'a>>>,
}

impl<'a> Document<'a> {
    fn new(sets: &'a EipSets) -> Self {
        let n = sets.models.len();
        let axes = sets.grid.axes();
        let cases = sets.cases.iter().map(|case| CaseFields::new(case, n));
        let failures = sets.models.iter().enumerate().filter_map(|(model, m)| {
            m.failure.as_ref().map(|e| Failure { model, message: e.to_string() })
        });
        let duplicates = sets
            .models
            .iter()
            .enumerate()
            .filter_map(|(model, m)| m.duplicate_of.map(|of| Duplicate { model, of }));
        Self {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            title: sets.title.as_deref(),
            parameter: match axes {
                [(name, _)] => Some(name),
                _ => None,
            },
            parameters: &sets.parameters,
            models: sets
                .models
                .iter()
                .map(|m| ModelValues { names: &sets.parameters, values: &m.values })
                .collect(),
            labels: sets.models.iter().map(|m| m.label.as_str()).collect(),
            convention: sets.convention.name(),
            dt: match sets.convention {
                Convention::Baram { dt } => Some(dt),
                _ => None,
            },
            grid: GridValues(sets),
            delays: sets.cases.iter().map(|c| c.delay).collect(),
            first: cases.clone().next(),
            undecidable: sets.undecidable.iter().map(UndecidableFields::new).collect(),
            robust: sets.robust.as_ref().map(RobustFields::new),
            delay_interval: sets.delay_sweep.as_ref().map(SweepFields::new),
            identification: sets.identification.as_ref().map(IdentificationFields::new),
            upsilon_at_nominals: Rows { data: &sets.at_nominals, width: n },
            pseudo_norm: sets.pseudo_norms().chunks(n.max(1)).map(<[f64]>::to_vec).collect(),
            failures: failures.collect(),
            duplicates: duplicates.collect(),
            method: method(sets.method),
            cases: (sets.cases.len() > 1).then(|| cases.collect()),
        }
    }
}

/// `doubling` or `modal`, as scenario files spell it.
pub(crate) fn method(method: Method) -> &'static str {
    match method {
        Method::Doubling => "doubling",
        Method::Modal => "modal",
    }
}

#[derive(serde::Serialize)]
struct CaseFields<'a> {
    delay: f64,
    upsilon: Rows<'a>,
    winner: &'a [Option<usize>],
    margin: &'a [f64],
    boundaries: Vec<BoundaryFields>,
    sets: Vec<SetFields>,
    unstable: Vec<UnstableFields<'a>>,
    unstable_intervals: Vec<[f64; 2]>,
    failed: Vec<FailedFields<'a>>,
    failed_intervals: Vec<[f64; 2]>,
    undecided: Vec<UndecidedFields<'a>>,
    undecided_intervals: Vec<[f64; 2]>,
    error: RowsOrNone<'a>,
    route_difference: Option<f64>,
    checked_pairs: usize,
    replaced: usize,
}

impl<'a> CaseFields<'a> {
    fn new(case: &'a Case, n: usize) -> Self {
        Self {
            delay: case.delay,
            upsilon: Rows { data: &case.upsilon, width: n },
            winner: &case.winner,
            margin: &case.margin,
            boundaries: case.boundaries.iter().map(BoundaryFields::new).collect(),
            sets: case
                .sets
                .iter()
                .enumerate()
                .map(|(model, set)| SetFields { model, intervals: set.iter().map(pair).collect() })
                .collect(),
            unstable: case.unstable.iter().map(UnstableFields::new).collect(),
            unstable_intervals: case.unstable_intervals.iter().map(pair).collect(),
            failed: case.failed.iter().map(FailedFields::new).collect(),
            failed_intervals: case.failed_intervals.iter().map(pair).collect(),
            undecided: case.undecided.iter().map(UndecidedFields::new).collect(),
            undecided_intervals: case.undecided_intervals.iter().map(pair).collect(),
            error: RowsOrNone { data: &case.error, width: n, rows: case.winner.len() },
            route_difference: (case.checked_pairs > 0).then_some(case.route_difference),
            checked_pairs: case.checked_pairs,
            replaced: case.replaced,
        }
    }
}

#[derive(serde::Serialize)]
struct BoundaryFields {
    value: f64,
    left: usize,
    right: usize,
    uncertainty: f64,
}

impl BoundaryFields {
    fn new(b: &Boundary) -> Self {
        Self { value: b.value, left: b.left, right: b.right, uncertainty: b.uncertainty }
    }
}

#[derive(serde::Serialize)]
struct SetFields {
    model: usize,
    intervals: Vec<[f64; 2]>,
}

#[derive(serde::Serialize)]
struct UnstableFields<'a> {
    plant: usize,
    values: &'a [f64],
    mode: Mode,
    states: &'a str,
}

#[derive(serde::Serialize)]
struct Mode {
    re: f64,
    im: f64,
}

impl<'a> UnstableFields<'a> {
    fn new(u: &'a Unstable) -> Self {
        let mode = Mode { re: u.mode.re, im: u.mode.im };
        Self { plant: u.plant, values: &u.values, mode, states: &u.states }
    }
}

#[derive(serde::Serialize)]
struct FailedFields<'a> {
    plant: usize,
    values: &'a [f64],
    message: String,
}

impl<'a> FailedFields<'a> {
    fn new(f: &'a Failed) -> Self {
        Self { plant: f.plant, values: &f.values, message: f.error.to_string() }
    }
}

#[derive(serde::Serialize)]
struct UndecidedFields<'a> {
    plant: usize,
    values: &'a [f64],
    models: &'a [usize],
    margin: Option<f64>,
    error: Option<f64>,
}

impl<'a> UndecidedFields<'a> {
    fn new(u: &'a Undecided) -> Self {
        let (margin, error) = match u.doubt {
            Doubt::Margin { margin, error, .. } => (Some(margin), Some(error)),
            Doubt::NoNumber { .. } => (None, None),
        };
        Self { plant: u.plant, values: &u.values, models: u.doubt.models(), margin, error }
    }
}

#[derive(serde::Serialize)]
struct UndecidableFields<'a> {
    interval: [f64; 2],
    models: &'a [usize],
}

impl<'a> UndecidableFields<'a> {
    fn new(u: &'a Undecidable) -> Self {
        Self { interval: pair(&u.interval), models: &u.models }
    }
}

#[derive(serde::Serialize)]
struct Failure {
    model: usize,
    message: String,
}

#[derive(serde::Serialize)]
struct Duplicate {
    model: usize,
    of: usize,
}

fn pair(interval: &Interval) -> [f64; 2] {
    [interval.from, interval.to]
}

/// A matrix by rows, written without a copy.
struct Rows<'a> {
    data: &'a [f64],
    width: usize,
}

impl Serialize for Rows<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.data.chunks(self.width.max(1)))
    }
}

/// As [`Rows`]; rows of null where the data are empty.
struct RowsOrNone<'a> {
    data: &'a [f64],
    width: usize,
    rows: usize,
}

impl Serialize for RowsOrNone<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.data.is_empty() && self.rows > 0 {
            let none = vec![f64::NAN; self.width];
            return serializer.collect_seq((0..self.rows).map(|_| &none));
        }
        Rows { data: self.data, width: self.width }.serialize(serializer)
    }
}

/// The nominal value of a model of one parameter, else an object by name.
struct ModelValues<'a> {
    names: &'a [String],
    values: &'a [f64],
}

impl Serialize for ModelValues<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.values {
            [value] => serializer.serialize_f64(*value),
            _ => serializer.collect_map(self.names.iter().zip(self.values)),
        }
    }
}

/// The values of one axis, or an object of axes by name.
struct GridValues<'a>(&'a EipSets);

impl Serialize for GridValues<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.grid.axes() {
            [(_, axis)] => serializer.collect_seq(axis.values()),
            axes => {
                let mut map = serializer.serialize_map(Some(axes.len()))?;
                for (name, axis) in axes {
                    map.serialize_entry(name, &axis.values())?;
                }
                map.end()
            }
        }
    }
}

/// One key a line, and inside a key one composite element a line: short enough
/// to read, long enough for `diff`.
#[derive(Default)]
struct Lines {
    /// The open brackets.
    open: Vec<Bracket>,
}

struct Bracket {
    object: bool,
    /// An element stands on its own line, so the closing bracket does too.
    broken: bool,
}

impl Lines {
    fn open(&mut self, out: &mut (impl ?Sized + Write), object: bool) -> io::Result<()> {
        // an element of an array that is itself the value of a top-level key
        if self.open.len() == 2
            && let Some(parent) = self.open.last_mut()
            && !parent.object
        {
            parent.broken = true;
            out.write_all(b"\n    ")?;
        }
        self.open.push(Bracket { object, broken: false });
        out.write_all(if object { b"{" } else { b"[" })
    }

    fn close(&mut self, out: &mut (impl ?Sized + Write), bracket: &[u8]) -> io::Result<()> {
        if self.open.pop().is_some_and(|b| b.broken) {
            out.write_all(if self.open.is_empty() { b"\n" } else { b"\n  " })?;
        }
        out.write_all(bracket)
    }

    fn comma(&self, out: &mut (impl ?Sized + Write), first: bool) -> io::Result<()> {
        if first {
            return Ok(());
        }
        // what stands on its own line brings its own white space
        let broken = self.open.last().is_some_and(|b| b.broken);
        out.write_all(if broken { b"," } else { b", " })
    }
}

impl serde_json::ser::Formatter for Lines {
    fn begin_array<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.open(out, false)
    }

    fn end_array<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.close(out, b"]")
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        self.comma(out, first)
    }

    fn begin_object<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.open(out, true)
    }

    fn end_object<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.close(out, b"}")
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        self.comma(out, first)?;
        let depth = self.open.len();
        if depth > 2 {
            return Ok(());
        }
        if let Some(bracket) = self.open.last_mut() {
            bracket.broken = true;
        }
        out.write_all(if depth == 1 { b"\n  " } else { b"\n    " })
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        out.write_all(b": ")
    }
}
