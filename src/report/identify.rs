//! What the weights settle on, in text and JSON.

use serde::Serialize;

use crate::eip::{EipSets, Identification, Lemma, Outcome, OutcomeKind, WeightLaw};
use crate::report::layout::{Table, left, line, right};
use crate::report::significant;

#[derive(Serialize)]
pub(super) struct IdentificationFields<'a> {
    law: &'static str,
    lambda: Option<f64>,
    tempering: Option<f64>,
    dt: Option<f64>,
    outcome: Vec<Option<&'static str>>,
    model: Vec<Option<usize>>,
    exponent: Vec<Option<f64>>,
    weights: Vec<Option<&'a [f64]>>,
    cells: Vec<CellFields>,
    bands: Vec<BandFields>,
    #[serde(skip_serializing_if = "Option::is_none")]
    smooth: Option<Vec<Option<&'a [f64]>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lemma: Option<Vec<Option<LemmaFields>>>,
}

#[derive(Serialize)]
struct CellFields {
    model: usize,
    outcome: &'static str,
    interval: [f64; 2],
}

#[derive(Serialize)]
struct BandFields {
    tempering: f64,
    intervals: Vec<[f64; 2]>,
    width: f64,
}

#[derive(Serialize)]
struct LemmaFields {
    eps: f64,
    mu: f64,
    bound: f64,
}

impl LemmaFields {
    fn new(lemma: &Lemma) -> Self {
        Self { eps: lemma.eps, mu: lemma.mu, bound: lemma.bound }
    }
}

impl<'a> IdentificationFields<'a> {
    pub(super) fn new(found: &'a Identification) -> Self {
        let (lambda, tempering) = match found.law {
            WeightLaw::Dwsg { lambda, tempering, .. } => (Some(lambda), Some(tempering)),
            _ => (None, None),
        };
        let ode = found.law == WeightLaw::Ode;
        fn each<'a, T>(found: &'a Identification, of: impl Fn(&'a Outcome) -> T) -> Vec<Option<T>> {
            found.outcomes.iter().map(|o| o.as_ref().map(&of)).collect()
        }
        let cells = found.stretches.iter().map(|s| CellFields {
            model: s.model,
            outcome: s.kind.name(),
            interval: [s.interval.from, s.interval.to],
        });
        let bands = found.bands.iter().map(|b| BandFields {
            tempering: b.tempering,
            intervals: b.intervals.iter().map(|i| [i.from, i.to]).collect(),
            width: b.intervals.iter().map(|i| i.to - i.from).sum(),
        });
        Self {
            law: found.law.name(),
            lambda,
            tempering,
            dt: found.dt,
            outcome: each(found, |o| o.kind.name()),
            model: each(found, |o| o.model),
            exponent: each(found, |o| o.exponent),
            weights: each(found, |o| o.weights.as_slice()),
            cells: cells.collect(),
            bands: bands.collect(),
            smooth: ode
                .then(|| found.outcomes.iter().map(|o| o.as_ref()?.smooth.as_deref()).collect()),
            lemma: ode.then(|| {
                let lemma =
                    |o: &Option<Outcome>| Some(LemmaFields::new(o.as_ref()?.lemma.as_ref()?));
                found.outcomes.iter().map(lemma).collect()
            }),
        }
    }
}

/// The section on the weights.
pub(super) fn text(out: &mut String, sets: &EipSets) {
    let Some(found) = &sets.identification else { return };
    out.push('\n');
    let law = match found.law {
        WeightLaw::Posterior => "the posterior".into(),
        WeightLaw::Ode => "Dunn's differential equation".into(),
        WeightLaw::Dwsg { lambda, tempering, .. } => format!(
            "the dynamic weighting signal generator (lambda {}, tempering {})",
            significant(lambda, 6),
            significant(tempering, 6)
        ),
    };
    let count = |kind| found.outcomes.iter().flatten().filter(|o| o.kind == kind).count();
    line(
        out,
        &format!(
            "With {law} {} plants are identified, {} are averaged, {} are undecided.",
            count(OutcomeKind::Identifies),
            count(OutcomeKind::Averages),
            count(OutcomeKind::Undecided),
        ),
    );
    cells(out, sets, found);
    if found.bands.len() > 1 {
        line(out, "Bands in which no model is stable, by tempering:");
        let mut table = Table::default();
        table.row([right("tempering"), right("width"), left("intervals")].into());
        for band in &found.bands {
            let interval = |i: &crate::eip::Interval| {
                format!("[{}, {}]", significant(i.from, 6), significant(i.to, 6))
            };
            let all: Vec<String> = band.intervals.iter().take(4).map(interval).collect();
            let width: f64 = band.intervals.iter().map(|i| i.to - i.from).sum();
            table.row(vec![
                right(&significant(band.tempering, 4)),
                right(&significant(width, 4)),
                left(&all.join(" ")),
            ]);
        }
        table.print(out);
    }
}

/// The cells of one parameter: what happens, and the strongest rate.
fn cells(out: &mut String, sets: &EipSets, found: &Identification) {
    let [(name, axis)] = sets.grid.axes() else { return };
    let values = axis.values();
    let unit = match (found.law, found.dt) {
        (WeightLaw::Dwsg { .. }, _) => "in the unit of lambda",
        (_, Some(_)) => "1/sample",
        _ => "1/s",
    };
    let mut table = Table::default();
    let exponent = format!("exponent, {unit}");
    table.row([right("cell"), left(name), left("weights"), left(&exponent)].into());
    for s in found.stretches.iter().take(100) {
        let inside = values.iter().zip(&found.outcomes);
        let inside = inside.filter(|(v, _)| s.interval.from <= **v && **v <= s.interval.to);
        let rates: Vec<f64> = inside.filter_map(|(_, o)| Some(o.as_ref()?.exponent)).collect();
        let (low, high) = rates
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), r| (l.min(*r), h.max(*r)));
        let range = match rates.len() {
            0 => String::new(),
            _ => format!("{} .. {}", significant(low, 4), significant(high, 4)),
        };
        table.row(vec![
            right(&(s.model + 1).to_string()),
            left(&format!(
                "[{}, {}]",
                significant(s.interval.from, 8),
                significant(s.interval.to, 8)
            )),
            left(s.kind.name()),
            left(&range),
        ]);
    }
    table.print(out);
}
