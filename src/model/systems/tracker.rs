//! The two-axis tracker.

use faer::{Mat, mat};

use crate::model::systems::names;
use crate::model::{Family, FnFamily, Plant, Time};

/// Position and velocity on two axes, position measured, one-second samples.
///
/// ```text
/// A = rho diag(T, T), T = [1 1; 0 1],  C = c [1 0 0 0; 0 0 1 0],
/// Q = q I4,  R = r I2
/// ```
///
/// The four cases of the paper vary `rho` (case 1), `c` (2), `q` (3), `r` (4).
/// At `rho >= 1` the plant has no stationary state.
///
/// # Source
/// Zhang, Wang, Zhang (2018), section 5, eq. (32).
pub fn tracker() -> impl Family {
    let time = Time::Discrete { dt: 1.0 };
    FnFamily::new(
        &[("rho", 1.0), ("c", 1.0), ("q", 2.0), ("r", 2.0)],
        names(&["x", "vx", "y", "vy"], &[], &["wx", "wvx", "wy", "wvy"], &["x", "y"]),
        time,
        move |theta| {
            let (rho, c, q, r) = (theta[0], theta[1], theta[2], theta[3]);
            Ok(Plant {
                time,
                A: mat![
                    [rho, rho, 0.0, 0.0],
                    [0.0, rho, 0.0, 0.0],
                    [0.0, 0.0, rho, rho],
                    [0.0, 0.0, 0.0, rho]
                ],
                B: Mat::zeros(4, 0),
                G: Mat::identity(4, 4),
                C: mat![[c, 0.0, 0.0, 0.0], [0.0, 0.0, c, 0.0]],
                Q: Mat::<f64>::identity(4, 4) * faer::Scale(q),
                R: Mat::<f64>::identity(2, 2) * faer::Scale(r),
            })
        },
    )
}
