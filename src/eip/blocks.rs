//! A study in blocks: plants that are judged, handed over and forgotten.

use std::ops::Range;

use crate::eip::collect::{Seen, collect};
use crate::eip::judge::Judge;
use crate::eip::setup::Setup;
use crate::eip::slabs::Slabs;
use crate::eip::sparse;
use crate::eip::{Case, Model, Study};
use crate::error::{Error, Result};
use crate::par::RunControl;

/// Pairs of plant and model in a block of the usual size.
const PAIRS: usize = 1 << 18;
/// Plants of a block of the usual size: at least, and at most.
const PLANTS: [usize; 2] = [256, 4096];

/// Some consecutive plants of the grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Which plants of the grid.
    pub plants: Range<usize>,
    /// One case a delay. `upsilon`, `error`, `winner` and `margin` hold the
    /// plants of the block only; indices in `unstable`, `failed` and `undecided`
    /// are those of the grid. Boundaries and intervals are empty.
    pub cases: Vec<Case>,
    /// Which plants were computed, one list a case: all, or with refinement
    /// those that decide. The others have a winner and neither Upsilon nor
    /// margin.
    pub computed: Vec<Vec<bool>>,
}

impl Study {
    /// Plants of a block of the usual size: some 2^18 pairs, from 256 to 4096
    /// plants.
    pub fn usual_block(&self) -> usize {
        let pairs = self.bank.models.len().max(1) * self.delays.len().max(1);
        (PAIRS / pairs).clamp(PLANTS[0], PLANTS[1])
    }

    /// Blocks of at most `plants` plants that the grid has.
    ///
    /// # Errors
    /// Bad input that shows without running.
    pub fn count_blocks(&self, plants: usize) -> Result<usize> {
        crate::eip::setup::check(self)?;
        Ok(Slabs::new(&self.grid, plants.max(1)).len())
    }

    /// As [`Study::prepare`] for a run in blocks of at most `plants` plants:
    /// what must fit in memory is a block and not the grid.
    ///
    /// # Errors
    /// As [`Study::prepare`].
    pub fn prepare_blocks(&self, plants: usize) -> Result<Setup> {
        let bytes = self.block_bytes(plants)?;
        if bytes > self.memory_limit {
            return Err(Error::Limit {
                what: format!("a block of {plants} plants"),
                bytes,
                limit: self.memory_limit,
                remedy: "use smaller blocks, or raise memory_limit",
            });
        }
        Setup::new(self)
    }
}

/// The grid of a prepared study in blocks, each computed alone.
///
/// A block has the same bits whichever blocks were computed before it, on any
/// number of threads, and those of [`Setup::run`] for the same plants.
///
/// ```
/// use std::sync::Arc;
/// use mmae::eip::{Bank, Study};
/// use mmae::model::{Axis, Grid, systems};
/// use mmae::observer::ObserverKind;
/// use mmae::par::RunControl;
///
/// let bank = Bank::along(ObserverKind::KalmanBucy, "L", &[1.025, 1.287, 1.526]);
/// let grid = Grid::new(vec![
///     ("L".into(), Axis::Linear { from: 0.9, to: 1.9, points: 11 }),
///     ("m".into(), Axis::Linear { from: 0.7, to: 0.8, points: 5 }),
/// ])?;
/// let mut study = Study::new(Arc::new(systems::pendulum()), bank, grid);
/// study.surroundings = systems::pendulum_surroundings();
/// let control = RunControl::default();
/// let setup = study.prepare_blocks(20)?;
/// let mut blocks = setup.blocks(20, false)?;
/// let whole = study.run(&control)?;
/// for k in 0..blocks.len() {
///     let block = blocks.run(k, &control)?;
///     assert_eq!(block.cases[0].winner, whole.cases[0].winner[block.plants.clone()]);
/// }
/// # Ok::<(), mmae::Error>(())
/// ```
pub struct Blocks<'a> {
    setup: &'a Setup,
    slabs: Slabs,
    refine: bool,
    judges: Vec<Judge<'a>>,
}

impl Setup {
    /// The grid in blocks of at most `plants` plants, all of them computed or,
    /// with `refine`, only those around the boundaries between winners.
    ///
    /// With `refine` cells of up to eight steps a side are judged at their
    /// corners. Where one model wins at all of them, ahead of every other by more
    /// than a quarter of what its lead varies over the corners, it is taken to
    /// win inside; other cells are halved along every side. Plants that are
    /// computed have the numbers that they have without `refine`.
    ///
    /// # Errors
    /// A mistake in the study; `AllFailed` if no plant can be built.
    pub fn blocks(&self, plants: usize, refine: bool) -> Result<Blocks<'_>> {
        let delays = if self.study.delays.is_empty() { &[0.0][..] } else { &self.study.delays };
        let judges: Result<_> = delays.iter().map(|&delay| Judge::new(self, delay)).collect();
        let slabs = Slabs::new(&self.study.grid, plants.max(1));
        Ok(Blocks { setup: self, slabs, refine, judges: judges? })
    }

    /// The models, as a result lists them.
    pub fn models(&self) -> &[Model] {
        &self.models
    }
}

impl Blocks<'_> {
    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.slabs.len()
    }

    /// Never true: a grid has plants.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Plants of block `k`.
    ///
    /// # Panics
    /// If `k >= len()`.
    pub fn plants(&self, k: usize) -> Range<usize> {
        assert!(k < self.len(), "block {k} of {}", self.len());
        self.slabs.plants(k)
    }

    /// Computes block `k`.
    ///
    /// # Errors
    /// A mistake in the study, `Cancelled`. Plants without Upsilon are part of
    /// the result.
    ///
    /// # Panics
    /// If `k >= len()`.
    pub fn run(&mut self, k: usize, control: &RunControl<'_>) -> Result<Block> {
        let plants = self.plants(k);
        let (mut cases, mut computed) = (Vec::new(), Vec::new());
        for judge in &mut self.judges {
            let all = if self.refine {
                sparse::refine(judge, plants.start, &self.slabs.shape(k), control)?
            } else {
                let all: Vec<usize> = plants.clone().collect();
                judge.judge(&all, control)?.into()
            };
            computed.push(all.seen.iter().map(|s| matches!(s, Seen::Judged(_))).collect());
            let silent = RunControl { progress: None, ..*control };
            let (mut case, found) = collect(judge, plants.start, all, &silent)?;
            (case.upsilon, case.error) = (found.upsilon, found.error);
            cases.push(case);
        }
        Ok(Block { plants, cases, computed })
    }

    /// The study.
    pub fn study(&self) -> &Study {
        &self.setup.study
    }

    /// The models, as a result lists them.
    pub fn models(&self) -> &[Model] {
        self.setup.models()
    }
}
