//! The oscillator behind a low-pass filter.

use faer::mat;

use crate::model::systems::names;
use crate::model::{Family, FnFamily, Plant, Time};

/// A second-order oscillator of unknown natural frequency `wn` (rad/s), driven
/// through a first-order lag.
///
/// ```text
/// A = [-5 0 0; 0 0 1; wn^2 -wn^2 -2 zeta wn],  B = G = [5 0 0]',  C = [0 1 0]
/// ```
///
/// `Q = 100`, `R = 0.1` are intensities.
///
/// # Source
/// Aguiar, Athans, Pascoal (2007), section V, with the corrected dimensions.
pub fn oscillator() -> impl Family {
    FnFamily::new(
        &[("wn", 1.0), ("zeta", 0.1)],
        names(&["lag", "position", "velocity"], &["u"], &["w"], &["position"]),
        Time::Continuous,
        |theta| {
            let (wn, zeta) = (theta[0], theta[1]);
            let stiffness = wn * wn;
            Ok(Plant {
                time: Time::Continuous,
                A: mat![
                    [-5.0, 0.0, 0.0],
                    [0.0, 0.0, 1.0],
                    [stiffness, -stiffness, -2.0 * zeta * wn]
                ],
                B: mat![[5.0], [0.0], [0.0]],
                G: mat![[5.0], [0.0], [0.0]],
                C: mat![[0.0, 1.0, 0.0]],
                Q: mat![[100.0]],
                R: mat![[0.1]],
            })
        },
    )
}
