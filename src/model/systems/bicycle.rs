//! The lateral dynamics of a car: the bicycle model.

use faer::mat;

use crate::model::systems::names;
use crate::model::{Family, FnFamily, Plant, Time};

/// Lateral velocity and yaw rate of a car at constant speed, yaw rate
/// measured, steered by the front wheels (angle in rad).
///
/// ```text
/// A = [ -2(Cf + Cr)/(m vx)          -vx + 2(b Cr - a Cf)/(m vx)    ]
///     [ 2(b Cr - a Cf)/(Iz vx)      -2(a^2 Cf + b^2 Cr)/(Iz vx)    ]
/// B = [2 Cf/m, 2 a Cf/Iz]',  C = [0 1]
/// ```
///
/// `Cf`, `Cr` cornering stiffness (N/rad), `a`, `b` axle distances (m), `m`
/// mass (kg), `Iz` yaw inertia (kg m^2), `vx` speed (m/s). The disturbance is a
/// lateral force (1e6 N^2/Hz); the yaw rate carries noise of 2.5e-7 rad^2/s
/// (0.005 rad/s at 100 Hz).
///
/// # Source
/// Liu and Peng, eq. (15) and section 4.2; the noise intensities are ours.
pub fn bicycle() -> impl Family {
    FnFamily::new(
        &[
            ("Cf", 71_000.0),
            ("Cr", 68_000.0),
            ("a", 1.32),
            ("b", 1.58),
            ("m", 1900.0),
            ("Iz", 3100.0),
            ("vx", 15.0),
        ],
        names(&["vy", "r"], &["steer"], &["side_force"], &["r"]),
        Time::Continuous,
        |p| {
            let (cf, cr, a, b, m, iz, vx) = (p[0], p[1], p[2], p[3], p[4], p[5], p[6]);
            let moment = 2.0 * (b * cr - a * cf);
            Ok(Plant {
                time: Time::Continuous,
                A: mat![
                    [-2.0 * (cf + cr) / (m * vx), -vx + moment / (m * vx)],
                    [moment / (iz * vx), -2.0 * (a * a * cf + b * b * cr) / (iz * vx)]
                ],
                B: mat![[2.0 * cf / m], [2.0 * a * cf / iz]],
                G: mat![[1.0 / m], [0.0]],
                C: mat![[0.0, 1.0]],
                Q: mat![[1e6]],
                R: mat![[2.5e-7]],
            })
        },
    )
}
