//! A study cut into blocks, and blocks dealt out to shards.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use crate::eip::Study;
use crate::report::write;
use crate::sweep::{Error, Identity};

/// How a plan differs from the usual one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// Plants of a block, at most; by default [`Study::usual_block`], with
    /// `refine` four times as many.
    pub block: Option<usize>,
    /// Compute only the plants around the boundaries between winners
    /// ([`Setup::blocks`](crate::eip::Setup::blocks)).
    pub refine: bool,
}

/// A study in parts.
pub struct Plan {
    pub(crate) study: Study,
    identity: Identity,
}

impl Plan {
    /// Plans `study`; `scenario` are the bytes that it was read from, or any
    /// others that tell it from every other study, `seed` that of its random
    /// numbers.
    ///
    /// # Errors
    /// Bad input that shows without running; `Range` for a block without plants.
    pub fn new(
        study: Study,
        scenario: &[u8],
        seed: Option<u64>,
        options: Options,
    ) -> crate::Result<Self> {
        let usual = study.usual_block() * if options.refine { 4 } else { 1 };
        let block = options.block.unwrap_or(usual);
        if block == 0 {
            return Err(crate::Error::Range {
                what: "plants of a block".into(),
                value: 0.0,
                remedy: "give at least 1".into(),
            });
        }
        let blocks = study.count_blocks(block)?;
        let delays = if study.delays.is_empty() { vec![0.0] } else { study.delays.clone() };
        let identity = Identity {
            version: env!("CARGO_PKG_VERSION").into(),
            scenario: write::sha256(scenario),
            seed,
            grid: study.grid.axes().iter().map(|(name, axis)| (name.clone(), axis.len())).collect(),
            models: study.bank.models.len(),
            delays,
            block,
            blocks,
            refine: options.refine,
        };
        Ok(Self { study, identity })
    }

    /// What its parts are parts of.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.identity.blocks
    }

    /// The study.
    pub fn study(&self) -> &Study {
        &self.study
    }
}

/// One of several parts of about equal size: shard `index` of `of`, from 1.
///
/// ```
/// use mmae::sweep::Shard;
/// let shard: Shard = "2/3".parse()?;
/// assert_eq!(shard.blocks(10), 3..6);
/// assert_eq!(Shard::all(3).flat_map(|s| s.blocks(10)).count(), 10);
/// assert!("0/3".parse::<Shard>().is_err());
/// # Ok::<(), mmae::sweep::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    index: usize,
    of: usize,
}

impl Shard {
    /// Everything.
    pub const WHOLE: Shard = Shard { index: 1, of: 1 };

    /// Shard `index` of `of`.
    ///
    /// # Errors
    /// `Shard` unless `1 <= index <= of`.
    pub fn new(index: usize, of: usize) -> Result<Self, Error> {
        if index < 1 || index > of {
            return Err(Error::Shard { text: format!("{index}/{of}") });
        }
        Ok(Self { index, of })
    }

    /// The shards `1/n` to `n/n`.
    pub fn all(n: usize) -> impl Iterator<Item = Self> {
        (1..=n).map(move |index| Self { index, of: n })
    }

    /// Which one, from 1.
    pub fn index(self) -> usize {
        self.index
    }

    /// Of how many.
    pub fn of(self) -> usize {
        self.of
    }

    /// Its blocks, of `blocks` in all: none for some of more shards than blocks.
    pub fn blocks(self, blocks: usize) -> Range<usize> {
        let share = |i: usize| (blocks as u128 * i as u128 / self.of as u128) as usize;
        share(self.index - 1)..share(self.index)
    }
}

impl FromStr for Shard {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let parts =
            text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        let (index, of) = parts.ok_or_else(|| Error::Shard { text: text.into() })?;
        Self::new(index, of)
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}
