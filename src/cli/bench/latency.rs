//! How long one measurement takes in real time.

use std::time::Instant;

use serde::Serialize;

use crate::bank::{Members, Settings};
use crate::engine::{Mmae, Weighting};
use crate::error::Result;
use crate::model::{Family, Plant, systems};
use crate::observer::ObserverKind;

/// Numbers of models.
const MODELS: [usize; 3] = [8, 64, 1024];
/// Steps before the clock counts.
const WARM: usize = 100;

/// Time of [`Mmae::step`] with steady Kalman filters of four states.
#[derive(Serialize)]
pub(super) struct Latency {
    pub(super) models: usize,
    pub(super) median_us: f64,
    /// 99.9 % of the steps take no longer.
    pub(super) p999_us: f64,
}

/// Steps one after the other for every number of models; `seconds` each.
///
/// # Errors
/// None that a user could cause.
pub(super) fn measure(seconds: f64) -> Result<Vec<Latency>> {
    let family = systems::tracker();
    let model = |rho: f64| family.plant(&family.theta_with(&[("rho", rho)])?);
    let of = |models: usize| {
        let rho = |i: usize| 0.9 + 0.1 * i as f64 / models as f64;
        let plants: Vec<Plant> = (0..models).map(rho).map(model).collect::<Result<_>>()?;
        let members = Members::new(ObserverKind::Kalman, plants);
        let prior = vec![1.0; models];
        let mut mmae = Mmae::new(&members, &Settings::default(), &Weighting::default(), &prior)?;
        let mut spent = Vec::new();
        let (start, mut k) = (Instant::now(), 0_u32);
        while start.elapsed().as_secs_f64() < seconds || spent.len() < 10 * WARM {
            let y = [f64::from(k % 7) - 3.0, f64::from(k % 5) - 2.0];
            let step = Instant::now();
            mmae.step(&[], &y)?;
            spent.push(step.elapsed().as_secs_f64() * 1e6);
            k += 1;
        }
        let mut spent = spent.split_off(WARM);
        spent.sort_by(f64::total_cmp);
        let at = |share: f64| spent[((spent.len() - 1) as f64 * share) as usize];
        Ok(Latency { models, median_us: at(0.5), p999_us: at(0.999) })
    };
    MODELS.into_iter().map(of).collect()
}
