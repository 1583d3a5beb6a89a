//! Whether a plant in its loop is stable, where the doubling did not prove it.

use crate::eip::batch::LoopBatch;
use crate::eip::delay::{DelayedBatch, Winding};
use crate::error::{Eigenvalue, Result};
use crate::small::Cx;
use crate::solve::{Mode, least_stable_mode};

/// A mode decays clearly if it does so by this share of its rate (a sample in
/// discrete time).
const DECAYS: f64 = 1e-9;

/// Whether a plant has any Upsilon.
pub(crate) enum Stability {
    Stable,
    Unstable(Mode),
    /// On the limit, as near as can be told.
    Unknown,
}

/// Of block `k`, whose doubling `proved` it stable or not: a loop far from normal
/// can be stable without a proof.
pub(crate) fn stability(batch: &LoopBatch, k: usize, proved: bool) -> Result<Stability> {
    if proved {
        return Ok(Stability::Stable);
    }
    let block = batch.block(k);
    let continuous = block.time.is_continuous();
    let mode = least_stable_mode(block.A.as_ref(), continuous)?;
    let Eigenvalue { re, im } = mode.eigenvalue;
    let decay = if continuous { -re / re.hypot(im) } else { 1.0 - re.hypot(im) };
    Ok(if decay > DECAYS { Stability::Stable } else { Stability::Unstable(mode) })
}

/// Of block `k` with its exact delay, which has `count` unstable modes; `proved`
/// concerns the approximation of the delay.
pub(crate) fn delayed_stability(
    winding: &Winding,
    batch: &LoopBatch,
    delayed: &DelayedBatch,
    k: usize,
    proved: bool,
    count: Option<usize>,
) -> Result<Stability> {
    let count = match count {
        Some(count) if proved && count > 0 => winding.count_again(delayed, k),
        count => count,
    };
    match count {
        Some(0) => return Ok(Stability::Stable),
        None if proved => return Ok(Stability::Unknown),
        _ => {}
    }
    let mut mode = least_stable_mode(batch.block(k).A.as_ref(), true)?;
    if mode.eigenvalue.re < 0.0 {
        let Eigenvalue { re, im } = mode.eigenvalue;
        match winding.zero_near(delayed, k, Cx::new(re, im)) {
            Some(zero) if zero.re > 0.0 => {
                mode.eigenvalue = Eigenvalue { re: zero.re, im: zero.im.abs() };
            }
            _ => return Ok(Stability::Unknown),
        }
    }
    Ok(Stability::Unstable(mode))
}
