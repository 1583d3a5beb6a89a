//! Built-in example systems: the plants of the papers, as families.
//!
//! | name | plant | parameters |
//! |---|---|---|
//! | `oscillator` | [`oscillator`] | `wn`, `zeta` |
//! | `pendulum` | [`pendulum`], with [`pendulum_surroundings`] | `L`, `M`, `m`, `g`, `b`, `k` |
//! | `tracker` | [`tracker`] | `rho`, `c`, `q`, `r` |
//! | `bicycle` | [`bicycle`] | `Cf`, `Cr`, `a`, `b`, `m`, `Iz`, `vx` |

mod bicycle;
mod oscillator;
mod pendulum;
mod tracker;

pub use bicycle::bicycle;
pub use oscillator::oscillator;
pub use pendulum::{pendulum, pendulum_surroundings};
pub use tracker::tracker;

use std::sync::Arc;

use crate::model::{Family, Names};

/// Names of the built-in families.
pub const NAMES: [&str; 4] = ["oscillator", "pendulum", "tracker", "bicycle"];

/// The built-in family called `name`, one of [`NAMES`].
pub fn by_name(name: &str) -> Option<Arc<dyn Family>> {
    match name {
        "oscillator" => Some(Arc::new(oscillator())),
        "pendulum" => Some(Arc::new(pendulum())),
        "tracker" => Some(Arc::new(tracker())),
        "bicycle" => Some(Arc::new(bicycle())),
        _ => None,
    }
}

fn names(states: &[&str], inputs: &[&str], disturbances: &[&str], outputs: &[&str]) -> Names {
    let list = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect();
    Names {
        states: list(states),
        inputs: list(inputs),
        disturbances: list(disturbances),
        outputs: list(outputs),
    }
}
