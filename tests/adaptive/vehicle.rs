//! Example 4.2 of Liu and Peng: a vehicle's lateral motion.

use std::sync::Arc;

use mmae::adaptive::{
    Adaptive, FnRegressor, Prior, Settings, Structure, Tuning, Unknown, identifiability,
    solve_parameters,
};
use mmae::par::RunControl;
use mmae::{Error, Mat, mat};

use super::example::{runge_kutta, settled};
use super::json::{number, read, vector};

/// `Cf, Cr, a, b, m, Iz`, per unit of mass where it is left out.
const NOMINAL: [f64; 6] = [71000.0, 68000.0, 1.32, 1.58, 1900.0, 3100.0];
const PERTURBED: [f64; 6] = [51000.0, 50000.0, 1.49, 1.41, 2230.0, 3844.0];
const SPEED: f64 = 15.0;

/// `A` without `-v_x` and `B` of (15).
fn plant([cf, cr, a, b, m, iz]: [f64; 6]) -> ([[f64; 2]; 2], [f64; 2]) {
    let cross = 2.0 * (b * cr - a * cf) / SPEED;
    let matrix = [
        [-2.0 * (cf + cr) / (m * SPEED), cross / m],
        [cross / iz, -2.0 * (a * a * cf + b * b * cr) / (iz * SPEED)],
    ];
    (matrix, [2.0 * cf / m, 2.0 * a * cf / iz])
}

fn steering(t: f64) -> f64 {
    let wave = t.mul_add(0.5, 0.0).sin() + (1.7 * t).sin() + 0.8 * (4.1 * t).sin();
    (wave + 0.6 * (9.0 * t).sin()).to_radians()
}

fn record(parameters: [f64; 6], h: f64, steps: usize) -> (Vec<f64>, Vec<f64>) {
    let (a, b) = plant(parameters);
    let flow = |t: f64, x: [f64; 2]| {
        let u = steering(t);
        [
            a[0][0] * x[0] + (a[0][1] - SPEED) * x[1] + b[0] * u,
            a[1][0] * x[0] + a[1][1] * x[1] + b[1] * u,
        ]
    };
    let (mut x, mut us, mut ys) = ([0.0; 2], vec![steering(0.0)], vec![0.0]);
    for k in 1..steps {
        let from = (k - 1) as f64 * h;
        for part in 0..8 {
            x = runge_kutta(&flow, from + f64::from(part) * h / 8.0, h / 8.0, x);
        }
        us.push(steering(k as f64 * h));
        ys.push(x[1]);
    }
    (us, ys)
}

/// `d1, d0, b1, b0` of the transfer function from steering to yaw rate.
fn coefficients(parameters: [f64; 6]) -> [f64; 4] {
    let (a, b) = plant(parameters);
    let full = a[0][1] - SPEED;
    [-a[0][0] - a[1][1], a[0][0] * a[1][1] - full * a[1][0], b[1], a[1][0] * b[0] - a[0][0] * b[1]]
}

/// Observer canonical form on the measured yaw rate and steering.
fn canonical() -> (Structure, Tuning) {
    let given = FnRegressor::new(4, |_, u, y, gamma, _| {
        gamma.copy_from_slice(&[-y[0], 0.0, 0.0, -y[0], u[0], 0.0, 0.0, u[0]]);
    });
    let structure = Structure {
        states: vec!["r".into(), "z".into()],
        outputs: vec!["r".into()],
        inputs: 1,
        unknown: ["d1", "d0", "b1", "b0"].map(Unknown::given).to_vec(),
        regressor: Arc::new(given),
    };
    let a = mat![[0.0, 1.0], [0.0, 0.0]];
    let start = coefficients(NOMINAL).to_vec();
    let gain = mat![[20.0], [96.0]];
    let prior = Prior::uniform(1e12, 4);
    let tuning = Tuning { lambda: 0.15, ..Tuning::new(a, mat![[1.0, 0.0]], gain, start, prior) };
    (structure, tuning)
}

#[test]
fn as_posed_the_vehicle_is_not_identifiable() {
    let given = FnRegressor::new(2, |_, u, y, gamma, known| {
        gamma.copy_from_slice(&[u[0], 0.0, 0.0, u[0]]);
        known[0] = -SPEED * y[0];
    });
    let structure = Structure {
        states: vec!["v_y".into(), "r".into()],
        outputs: vec!["r".into()],
        inputs: 1,
        unknown: vec![
            Unknown::entry("da1", 0, 0),
            Unknown::entry("da2", 1, 0),
            Unknown::entry("da3", 0, 1),
            Unknown::entry("da4", 1, 1),
            Unknown::given("b1"),
            Unknown::given("b2"),
        ],
        regressor: Arc::new(given),
    };
    let (a, b) = plant(NOMINAL);
    let a = Mat::from_fn(2, 2, |i, j| a[i][j]);
    let gain = mat![[-10.0 / SPEED], [10.0 / SPEED]];
    let theta = vec![0.0, 0.0, 0.0, 0.0, b[0], b[1]];
    let tuning = Tuning::new(a, mat![[0.0, 1.0]], gain, theta, Prior::uniform(1e10, 6));
    let found = identifiability(&structure, &tuning).unwrap();
    assert_eq!(
        found.rank,
        number(&read("adaptive.json")["ex42"]["identifiable_rank_of_6"]) as usize
    );
    assert!(found.singular[3] > 1e3 * found.singular[4], "{:?}", found.singular);
    assert_eq!(found.words, ["v_y -> alpha v_y + beta r leaves y unchanged"]);
    let refused = Adaptive::new(structure, Settings::new(0.02), vec![tuning]);
    let Err(Error::AllFailed { source, .. }) = refused else { panic!("{refused:?}") };
    assert!(matches!(*source, Error::NotIdentifiable { rank: 4, parameters: 6, .. }), "{source}");
    assert!(source.to_string().contains("v_y -> alpha v_y + beta r leaves y unchanged"));
}

#[test]
fn the_transfer_function_is_identified() {
    let all = read("adaptive.json");
    let truth = coefficients(PERTURBED);
    let close =
        |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12 * b.abs());
    assert!(close(&truth, &vector(&all["ex42"]["tf_perturbed"])));
    // sampled coarsely the straight lines between samples bias the result
    let h = 0.001;
    let steps = 60_001;
    let (u, y) = record(PERTURBED, h, steps);
    let (structure, tuning) = canonical();
    let found = identifiability(&structure, &tuning).unwrap();
    assert_eq!((found.rank, found.words.len()), (4, 0));
    let table = &all["ex42"]["canonical"];
    for p0 in ["1e+10", "1e+12"] {
        let case = &table[format!("x1.0/P0={p0}")];
        let prior = Prior::uniform(p0.parse().unwrap(), 4);
        let tuning = Tuning { prior, ..tuning.clone() };
        let mut observer =
            Adaptive::new(structure.clone(), Settings::new(h), vec![tuning]).unwrap();
        let theta = observer.record(&RunControl::default(), steps, &u, &y, 1).unwrap();
        for (share, key) in [(0.05, "t5"), (0.01, "t1")] {
            let (got, want) = (settled(&theta, &truth, h, share), number(&case[key]));
            assert!((got - want).abs() < 0.02 * want, "P0 = {p0}, {key}: {got} for {want}");
        }
        let got = observer.theta(0);
        let want = vector(&case["TF"]["60"]);
        for (g, w) in got.iter().zip(want) {
            assert!((g - w).abs() < 2e-3 * w.abs(), "P0 = {p0}: {got:?}");
        }
    }
}

#[test]
fn masses_and_stiffnesses_follow_from_the_transfer_function() {
    // Cf/m, Cr/m, Iz/m and a, the wheelbase known
    let of = |[cf, cr, a, _, m, iz]: [f64; 6]| vec![cf / m, cr / m, iz / m, a];
    let map = |phi: &[f64], theta: &mut [f64]| {
        let parameters = [phi[0], phi[1], phi[3], 2.9 - phi[3], 1.0, phi[2]];
        theta.copy_from_slice(&coefficients(parameters));
    };
    let theta = coefficients(PERTURBED);
    let (phi, slope) = solve_parameters(map, &theta, &of(NOMINAL)).unwrap();
    for (g, w) in phi.iter().zip(of(PERTURBED)) {
        assert!((g - w).abs() < 1e-9 * w.abs(), "{phi:?}");
    }
    // the derivative, by a difference
    let moved: Vec<f64> =
        theta.iter().enumerate().map(|(i, v)| v + if i == 1 { 1e-6 } else { 0.0 }).collect();
    let (other, _) = solve_parameters(map, &moved, &phi).unwrap();
    for i in 0..4 {
        let want = (other[i] - phi[i]) / 1e-6;
        assert!((slope[(i, 1)] - want).abs() < 1e-2 * want.abs(), "{i}");
    }
}
