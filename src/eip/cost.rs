//! Which method a study takes, from a count of operations.

use crate::eip::Method;

/// Doublings of a usual study: modes spread over a factor of a hundred.
const DOUBLINGS: f64 = 9.0;
/// What the modal form needs more for a plant of order one, and with the cube of the
/// order: its eigenvalues and vectors. Measured, as [`MODAL_PAIR`], on the pendulum
/// (orders 9 and 5) and on two oscillators (4 and 4) with 2 to 64 models by each method
/// (AVX2): 6.7 and 1.7 us more a plant, 0.7 and 0.2 us a pair by doubling (21 and 14
/// Gflop/s), 0.14 and 0.06 us by the modal form. They break even near 12 and 10
/// models, by these constants at 18 and 10.
const MODAL_PLANT: f64 = 300.0;
/// Cost of one pair of eigenvalues in the modal form, in flops of the lane
/// kernels: the division, and what is done for each pair besides.
const MODAL_PAIR: f64 = 70.0;

impl Method {
    /// The cheaper method for plant blocks of order `np`, observers of order
    /// `n` and `models` models.
    pub(crate) fn cheaper(np: usize, n: usize, models: usize) -> Method {
        let cost = |method| Self::flops_per_plant(method, np, n, models);
        if cost(Method::Modal) < cost(Method::Doubling) { Method::Modal } else { Method::Doubling }
    }

    /// Flops of one plant against all models, in flops of the lane kernels.
    pub(crate) fn flops_per_plant(method: Method, np: usize, n: usize, models: usize) -> f64 {
        let (p, n, models) = (np as f64, n as f64, models as f64);
        let plant = 2.0 * p * p * p * (3.0 * DOUBLINGS + 4.0);
        match method {
            Method::Doubling => {
                let step = 2.0 * p * n * (p + n);
                plant + models * step * (DOUBLINGS + 3.0)
            }
            Method::Modal => plant + MODAL_PLANT * p * p * p + models * MODAL_PAIR * p * n,
        }
    }

    /// Flops of the search for one boundary: some six batches of eight plants
    /// with two models, one with all of them; all by doubling, as if the modal form did
    /// not spare most of the last.
    pub(crate) fn flops_per_boundary(np: usize, n: usize, models: usize) -> f64 {
        let of = |models| 8.0 * Self::flops_per_plant(Method::Doubling, np, n, models);
        6.0 * of(models.min(2)) + of(models)
    }

    /// Flops of the frequency integral of one plant with all models: some
    /// hundred complex systems, a few times as many where a delay ripples; the
    /// models' own responses are shared by the plants.
    pub(crate) fn flops_per_check(delay: bool, np: usize, n: usize, models: usize) -> f64 {
        let (p, n, models) = (np as f64, n as f64, models as f64);
        let points = if delay { 1000.0 } else { 250.0 };
        points * (4.0 * p * p * p + 20.0 * p * p + models * 30.0 * n)
    }
}
