//! Weights of the models: arithmetic on log probabilities, no filters.
//!
//! Everything here keeps `ln p`, never `p`: a model that explains the data a
//! million times worse is still there to come back, nothing underflows, and a
//! prior of zero stays exactly zero. The functions are generic over
//! [`Real`](crate::real::Real): on `f64` for one record, on lanes for eight
//! Monte-Carlo trials at once, with the same bits.
//!
//! | law | one step, up to a common term | source |
//! |---|---|---|
//! | [`Law::Bayes`] | `ln p_i += ln N(r_i; 0, S_i)` | Zhang et al. (2018), (4), (5) |
//! | [`Law::Likelihood`] | `ln p_i += h_i' R^-1 o dy - (\|h_i\|^2 + tr(C_i L_i)) dt / 2` | Aguiar et al. (2007), (5), in Ito's sense |
//! | [`Law::Zhang`] | `ln p_i += min(n_i, n_max) ln(1 - d_i)` | Zhang et al. (2018), (6)-(20) |
//! | [`Law::Ode`] | `d ln p_i / dt = h_i' R^-1 (y - sum p_j h_j)` | Aguiar et al. (2007), (5) |
//! | [`Law::Dwsg`] | `dp_i / dt = lambda (l_i / sum p_j l_j - 1) p_i` | Hassani et al. (2009), (9) |
//!
//! [`Law::Likelihood`] and [`Law::Ode`] are the two readings of Dunn's law; the
//! first is the same posterior as [`Law::Bayes`], of a continuous record.

mod dwsg;
mod law;
mod log;
mod markov;
mod ode;
mod posterior;
mod state;
mod zhang;

pub use law::{DwsgScheme, Law, Modifiers, Window};
pub(crate) use log::TOGETHER;
pub use markov::Transition;
pub use ode::OdeNodes;
pub use posterior::posterior;
pub use state::{Evidence, Weights, check_prior};
