//! The inverted pendulum on a cart, with its controller and disturbance.

use faer::{Mat, mat};

use crate::model::systems::names;
use crate::model::{Controller, Family, FnFamily, Plant, Shaping, Surroundings, Time};

/// An inverted pendulum of unknown length `L` (m) on a cart held by a spring.
///
/// ```text
/// A = [0 0 1 0; 0 0 0 1; -k/M -mg/M -b/M 0; k/(LM) (m+M)g/(LM) b/(LM) 0]
/// B = [0 0 1/M -1/(LM)]',  G = -B,  C = [I2 0],  R = diag(1e-7, 1e-8)
/// ```
///
/// The plant is unstable: use it with [`pendulum_surroundings`].
///
/// # Source
/// Hassani, Aguiar, Pascoal, Athans (2009), section IV; the printed `A` and
/// `B` have three rows and `C` one, corrected here.
pub fn pendulum() -> impl Family {
    FnFamily::new(
        &[("L", 1.4), ("M", 1.0), ("m", 0.75), ("g", 9.8), ("b", 0.1), ("k", 0.15)],
        names(&["x", "theta", "x_dot", "theta_dot"], &["force"], &["d"], &["x", "theta"]),
        Time::Continuous,
        |p| {
            let (l, cart, ball, g, b, k) = (p[0], p[1], p[2], p[3], p[4], p[5]);
            let lm = l * cart;
            Ok(Plant {
                time: Time::Continuous,
                A: mat![
                    [0.0, 0.0, 1.0, 0.0],
                    [0.0, 0.0, 0.0, 1.0],
                    [-k / cart, -ball * g / cart, -b / cart, 0.0],
                    [k / lm, (ball + cart) * g / lm, b / lm, 0.0]
                ],
                B: mat![[0.0], [0.0], [1.0 / cart], [-1.0 / lm]],
                G: mat![[0.0], [0.0], [-1.0 / cart], [1.0 / lm]],
                C: mat![[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
                Q: mat![[1.0]],
                R: mat![[1e-7, 0.0], [0.0, 1e-8]],
            })
        },
    )
}

/// The controller (an LQG design at `L = 1.3`, its rounded entries taken as
/// exact) and the disturbance `d' = -d + xi`, `xi` white of unit intensity.
///
/// Closed-loop abscissa at most -0.428 over `L` in [0.9, 1.9]; smallest delay
/// margin 94 ms.
pub fn pendulum_surroundings() -> Surroundings {
    Surroundings {
        controller: Some(Controller {
            A: mat![
                [-8.3102, 42.3799, 1.0, 0.0],
                [4.238, -35.4808, 0.0, 1.0],
                [-123.3216, 959.7797, 2.3258, 13.7622],
                [92.681, -741.3301, -1.789, -10.5863]
            ],
            B: mat![
                [8.3102, -42.3799],
                [-4.238, 35.4808],
                [124.3327, -921.2726],
                [-93.4589, 719.2477]
            ],
            C: mat![[1.1612, 45.8571, 2.4258, 13.7622]],
            D: Mat::zeros(1, 2),
        }),
        disturbance: Some(Shaping {
            A: mat![[-1.0]],
            B: mat![[1.0]],
            C: mat![[1.0]],
            Q: mat![[1.0]],
            states: vec!["d".into()],
        }),
        input: None,
        pade_order: 0,
    }
}
