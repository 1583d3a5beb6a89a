//! `mmae bench`: how fast this version is on this machine.

mod latency;
mod peak;
mod work;

use std::io::{self, Write};
use std::time::Instant;

use serde::Serialize;

use super::arguments::BenchArguments;
use super::failure::Failure;
use super::output;
use super::progress::Progress;
use super::signals::Signals;
use crate::par::RunControl;
use crate::real::Tier;
use crate::report::{layout, significant};
use latency::Latency;
use peak::{Memory, fma_gflops};

/// Seconds of a kernel in a round.
const SLICE: f64 = 0.3;
/// Seconds of a pass at least: shorter ones show the clock.
const PASS: f64 = 0.002;
/// Seconds of the measurements of latency, a round and number of models.
const LATENCY: f64 = 0.1;
/// Rounds of a full and of a quick run.
const ROUNDS: [usize; 2] = [20, 4];

/// A kernel with its best round.
#[derive(Serialize)]
struct Timed {
    name: &'static str,
    rate: f64,
    unit: &'static str,
    /// Operations it takes at least, as a share of the peak of one core.
    share_of_peak: f64,
}

#[derive(Serialize)]
struct Document {
    schema: &'static str,
    version: &'static str,
    cpu_tier: &'static str,
    threads: usize,
    fma_gflops: f64,
    read_gbytes: f64,
    rounds: usize,
    kernels: Vec<Timed>,
    latency: Vec<Latency>,
}

pub(super) fn run(args: &BenchArguments, signals: &Signals) -> Result<(), Failure> {
    let numerical = |e: crate::Error| Failure::Numerical(vec![e.to_string()]);
    let works = work::all().map_err(numerical)?;
    let rounds = ROUNDS[usize::from(args.quick)];
    let control = RunControl::default().threads(1).cancel(signals.cancel());
    let progress = Progress::of("rounds");
    let memory = Memory::new();
    let (mut fma, mut read) = (0.0_f64, 0.0_f64);
    let mut best = vec![(0.0_f64, 0.0_f64); works.len()];
    // the kernels take turns, so that a disturbance meets all of them
    for round in 0..rounds {
        for _ in 0..4 {
            fma = fma.max(fma_gflops());
        }
        read = read.max(memory.gbytes());
        for (work, best) in works.iter().zip(&mut best) {
            let (start, mut rate) = (Instant::now(), (0.0, 0.0));
            // the best pass of a slice counts
            while start.elapsed().as_secs_f64() < SLICE {
                let pass = Instant::now();
                let (mut items, mut flops, mut spent) = (0.0, 0.0, 0.0);
                while spent < PASS {
                    let done = work.run(&control);
                    if signals.raised() {
                        return Err(Failure::Cancelled);
                    }
                    let done = done.map_err(numerical)?;
                    (items, flops) = (items + done.items, flops + done.flops);
                    spent = pass.elapsed().as_secs_f64();
                }
                if items / spent > rate.0 {
                    rate = (items / spent, flops / spent);
                }
            }
            if rate.0 > best.0 {
                *best = rate;
            }
        }
        progress.update(round as u64 + 1, rounds as u64);
    }
    progress.finish();
    let latency = latency::measure(LATENCY * rounds as f64).map_err(numerical)?;
    let kernels = works.iter().zip(&best).map(|(work, &(rate, flops))| Timed {
        name: work.name,
        rate,
        unit: work.unit,
        share_of_peak: flops * 1e-9 / fma,
    });
    let document = Document {
        schema: "mmae.bench/1",
        version: env!("CARGO_PKG_VERSION"),
        cpu_tier: Tier::best().name(),
        threads: 1,
        fma_gflops: fma,
        read_gbytes: read,
        rounds,
        kernels: kernels.collect(),
        latency,
    };
    output::print(Some(signals), |out| {
        if args.json {
            serde_json::to_writer(&mut *out, &document)?;
            out.write_all(b"\n")
        } else {
            text(out, &document)
        }
    })
}

fn text(out: &mut dyn Write, document: &Document) -> io::Result<()> {
    writeln!(
        out,
        "mmae {}, one core, {}: multiply-add peak {} GFLOP/s, reads {} GB/s; best of {} rounds.\n",
        document.version,
        document.cpu_tier,
        significant(document.fma_gflops, 4),
        significant(document.read_gbytes, 3),
        document.rounds
    )?;
    let rows = document.kernels.iter().map(|k| {
        [
            k.name.to_string(),
            format!("{:.3e}", k.rate),
            k.unit.to_string(),
            format!("{:.1} %", 100.0 * k.share_of_peak),
        ]
    });
    out.write_all(layout::grid(&["kernel", "rate", "", "share of peak"], rows).as_bytes())?;
    writeln!(out, "\nOne measurement in real time, Kalman filters of four states:\n")?;
    let rows = document
        .latency
        .iter()
        .map(|l| [l.models.to_string(), significant(l.median_us, 3), significant(l.p999_us, 3)]);
    let head = ["models", "median, us", "99.9 % within, us"];
    out.write_all(layout::grid(&head, rows).as_bytes())
}
