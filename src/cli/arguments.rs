//! What the command line may say.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::sweep::Shard;

const EXIT_CODES: &str = "\
Exit codes:
  0    done (a partial result is told on the standard error)
  2    wrong usage
  3    the input file is wrong: file:line:column, key and remedy
  4    numerical failure: no plant has a winner, no equation a solution
  5    parts are missing, damaged or of another study
  6    a file cannot be read or written
  7    over a limit of size or memory; nothing was allocated
  130  interrupted (SIGINT), 143 terminated (SIGTERM): nothing was written";

/// Multiple-model adaptive estimation: EIP sets, banks of observers, Riccati equations.
#[derive(Debug, Parser)]
#[command(name = "mmae", version, after_help = EXIT_CODES, max_term_width = 80)]
pub(super) struct Arguments {
    #[command(subcommand)]
    pub(super) command: Command,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Compute the EIP sets of a scenario: which model each plant is identified as
    Eip(EipArguments),
    /// Join the parts that mmae eip --shard has written
    Merge(MergeArguments),
    /// Place nominal values whose EIP sets are the cells wanted
    Place(PlaceArguments),
    /// Validate a scenario, print its sizes and a cost estimate
    Check(CheckArguments),
    /// Write a commented scenario to start from
    New(NewArguments),
    /// Run the bank of a scenario on recorded data
    Estimate(EstimateArguments),
    /// Simulate trials of the bank of a scenario
    Run(RunArguments),
    /// Solve a file of Riccati and Lyapunov equations
    Solve(SolveArguments),
    /// Measure the speed of this version on this machine
    Bench(BenchArguments),
}

#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
pub(super) struct EipArguments {
    /// The scenario
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// Also write eip.json, upsilon.parquet, eip.svg, report.html and manifest.json there
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Print JSON in place of the tables
    #[arg(long)]
    pub(super) json: bool,
    /// Threads, 0 for one per CPU; results do not depend on it
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(u16).range(0..=1024)
    )]
    pub(super) threads: u16,
    /// Replace an earlier result in DIR
    #[arg(long)]
    pub(super) force: bool,
    /// Compute one of n parts of the grid, block by block, into DIR; mmae merge joins them
    #[arg(long, value_name = "I/N", requires = "out", help_heading = "Large grids")]
    pub(super) shard: Option<Shard>,
    /// Keep the parts that DIR holds already and compute the rest
    #[arg(long, requires = "out", conflicts_with = "force", help_heading = "Large grids")]
    pub(super) resume: bool,
    /// Compute only the plants around the boundaries between winners
    #[arg(long, requires = "out", help_heading = "Large grids")]
    pub(super) refine: bool,
    /// Plants of a block, at most
    #[arg(long, value_name = "PLANTS", requires = "out", help_heading = "Large grids")]
    pub(super) block: Option<NonZeroUsize>,
}

impl EipArguments {
    /// Whether the result is a directory of parts.
    pub(super) fn in_parts(&self) -> bool {
        self.shard.is_some() || self.resume || self.refine || self.block.is_some()
    }
}

#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
pub(super) struct MergeArguments {
    /// Directories of parts, of all shards of one study
    #[arg(value_name = "DIR", required = true)]
    pub(super) dirs: Vec<PathBuf>,
    /// Where to join them
    #[arg(long, value_name = "DIR", required_unless_present = "check")]
    pub(super) out: Option<PathBuf>,
    /// Only say what is missing or damaged
    #[arg(long, conflicts_with = "out")]
    pub(super) check: bool,
    /// Print JSON in place of the table
    #[arg(long)]
    pub(super) json: bool,
    /// Replace an earlier result in the directory of --out
    #[arg(long)]
    pub(super) force: bool,
}

#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
pub(super) struct CheckArguments {
    /// The scenario
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// Print JSON, diagnostics included
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
pub(super) struct NewArguments {
    /// Which one
    #[arg(value_enum, default_value_t = Kind::Pendulum)]
    pub(super) kind: Kind,
    /// Write to FILE in place of the standard output
    #[arg(long, value_name = "FILE")]
    pub(super) out: Option<PathBuf>,
    /// Replace FILE if it exists
    #[arg(long)]
    pub(super) force: bool,
}

#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
pub(super) struct EstimateArguments {
    /// The scenario, with [bank] and perhaps [weighting]
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// The record: CSV with a header or Parquet, columns named as the outputs and inputs of the
    /// scenario and perhaps t; blanks are missing
    #[arg(long, value_name = "FILE")]
    pub(super) data: PathBuf,
    /// Also report every K-th step
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub(super) every: u64,
    /// Also write estimate.json, weights.svg, record.svg and manifest.json there
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Replace an earlier result in DIR
    #[arg(long)]
    pub(super) force: bool,
    /// Another law in place of the scenario's
    #[arg(long, value_name = "NAME", value_enum)]
    pub(super) weighting: Option<LawName>,
    /// Print JSON in place of the tables
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
pub(super) struct RunArguments {
    /// The scenario, with [bank], [run] and perhaps [weighting] and [truth]
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// Also write run.json, weights.svg, errors.svg, trial.svg, report.html and manifest.json
    /// there
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Print JSON in place of the tables
    #[arg(long)]
    pub(super) json: bool,
    /// Another seed in place of the scenario's
    #[arg(long, value_name = "S")]
    pub(super) seed: Option<u64>,
    /// Another number of trials in place of the scenario's
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u64).range(1..))]
    pub(super) trials: Option<u64>,
    /// Threads, 0 for one per CPU; results do not depend on it
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(u16).range(0..=1024)
    )]
    pub(super) threads: u16,
    /// Another law in place of the scenario's
    #[arg(long, value_name = "NAME", value_enum)]
    pub(super) weighting: Option<LawName>,
    /// Another value of a parameter of the plant, or model=NUMBER; may be repeated
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    pub(super) truth: Vec<(String, f64)>,
    /// Replace an earlier result in DIR
    #[arg(long)]
    pub(super) force: bool,
}

/// `name=value`.
fn assignment(text: &str) -> Result<(String, f64), String> {
    let Some((name, value)) = text.split_once('=') else {
        return Err("write NAME=VALUE, as in L=1.2".into());
    };
    match value.trim().parse::<f64>() {
        Ok(number) if number.is_finite() => Ok((name.trim().into(), number)),
        _ => Err(format!("'{value}' is not a finite number")),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum LawName {
    /// Posterior probabilities of samples
    Bayes,
    /// Zhang's Algorithm 1
    Zhang1,
    /// Zhang's Algorithm 2
    Zhang2,
    /// Dunn's law as a likelihood (continuous observers)
    Dunn,
    /// Dunn's law as a differential equation (continuous observers)
    DunnOde,
    /// The dynamic weighting signal generator; lambda is the scenario's, or 1/dt
    Dwsg,
}

#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
#[command(group = clap::ArgGroup::new("wanted").multiple(false))]
pub(super) struct PlaceArguments {
    /// The scenario, with [bank] and [eip]; with several parameters in its grid the nominal values
    /// descend to a minimum of the mean excess
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// So many cells of equal width; the number of models by default
    #[arg(long, value_name = "N", group = "wanted", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) cells: Option<u16>,
    /// Inner edges of the cells, or all with the ends of the grid
    #[arg(
        long,
        value_name = "A,B,..",
        group = "wanted",
        value_delimiter = ',',
        allow_negative_numbers = true
    )]
    pub(super) edges: Vec<f64>,
    /// As few cells of equal width as keep the excess within this bound
    #[arg(long, value_name = "E", group = "wanted", allow_negative_numbers = true)]
    pub(super) excess: Option<f64>,
    /// As few cells of equal width as keep the state-error penalty within this bound
    #[arg(long, value_name = "E", group = "wanted", allow_negative_numbers = true)]
    pub(super) penalty: Option<f64>,
    /// The first nominal value; the one of smallest worst excess by default
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    pub(super) anchor: Option<f64>,
    /// Print JSON in place of the table
    #[arg(long)]
    pub(super) json: bool,
    /// Also draw the sets before and after there, an SVG file (one parameter)
    #[arg(long, value_name = "FILE")]
    pub(super) picture: Option<PathBuf>,
    /// Also write the scenario with the new nominal values there
    #[arg(long, value_name = "FILE")]
    pub(super) out: Option<PathBuf>,
    /// Replace FILE
    #[arg(long)]
    pub(super) force: bool,
}

#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
pub(super) struct BenchArguments {
    /// Print JSON in place of the table
    #[arg(long)]
    pub(super) json: bool,
    /// Fewer rounds: some ten seconds in place of a minute
    #[arg(long)]
    pub(super) quick: bool,
}

#[derive(Debug, Args)]
#[command(after_help = EXIT_CODES)]
pub(super) struct SolveArguments {
    /// The problems: {"cases": [{"id", "eq", "A", "B", "Q", "R", "S"}, ..]}, eq one of
    /// care, dare, clyap, dlyap
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// Print JSON in place of the table
    #[arg(long)]
    pub(super) json: bool,
    /// Threads, 0 for one per CPU; results do not depend on it
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(u16).range(0..=1024)
    )]
    pub(super) threads: u16,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Kind {
    /// Cart and pendulum of unknown length with its controller
    Pendulum,
    /// Oscillator of unknown natural frequency
    Oscillator,
    /// Every key, commented
    Blank,
}

#[cfg(test)]
mod tests {
    use super::Arguments;
    use clap::CommandFactory;

    #[test]
    fn the_definition_is_consistent() {
        Arguments::command().debug_assert();
    }
}
