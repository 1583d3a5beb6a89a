//! Published numbers, the oracle, wind-up.

use mmae::adaptive::{Adaptive, Reading, Settings, Tuning};
use mmae::par::RunControl;

use super::example::{TRUTH, input, record, settled, structure, tuning};
use super::json::{close, number, read, vector};
use super::oracle::Oracle;

fn observer(settings: Settings, tuning: Tuning) -> Adaptive {
    Adaptive::new(structure(), settings, vec![tuning]).unwrap()
}

#[test]
fn sampled_steps_are_those_of_the_reference() {
    let all = read("adaptive.json");
    let case = &all["sampled_order2"];
    let (y, u) = (vector(&case["y"]), vector(&case["u"]));
    let mut observer = observer(Settings::new(number(&case["h"])), tuning(number(&case["P0"])));
    let mut compared = 0;
    for k in 0..y.len().min(u.len()) {
        observer.step(&[u[k]], &[y[k]]).unwrap();
        let want = &case["values"][k.to_string()];
        if want.is_null() {
            continue;
        }
        compared += 1;
        let (psi, psi_0) = observer.filters(0);
        for (g, w) in observer.theta(0).iter().zip(vector(&want["theta"])) {
            assert!((g - w).abs() <= 1e-9 * w.abs(), "theta {g} for {w} at {k}");
        }
        close("x_hat", &observer.x_hat(0), &vector(&want["xhat"]), 1e-12, 0.0);
        close("psi_0", &psi_0, &vector(&want["psi0"]), 1e-12, 0.0);
        let rows = vector(&want["Psi"]);
        let columns: Vec<f64> = (0..8).map(|e| rows[(e % 2) * 4 + e / 2]).collect();
        close("Psi", &psi, &columns, 1e-12, 0.0);
        // Lambda P = I
        let (information, p) = (vector(&want["Lambda"]), observer.p(0));
        for i in 0..4 {
            for j in 0..4 {
                let sum: f64 = (0..4).map(|l| information[i * 4 + l] * p[(l, j)]).sum();
                assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-10, "{i} {j}: {sum}");
            }
        }
    }
    assert_eq!(compared, 8);
}

#[test]
fn short_samples_come_to_the_continuous_observer() {
    let want = [
        (Reading::Zhang, [2.9240183493, -2.8782013488, 4.3767295453, -3.7132487472]),
        (Reading::Obs, [3.0166706917, -3.0019789625, 4.5010116564, -4.0129326006]),
        (Reading::Reg, [2.8486782231, -2.7655979499, 4.2787002097, -3.4698944511]),
    ];
    for (reading, want) in want {
        let theta = |h: f64| -> Vec<f64> {
            let steps = (60.0 / h).round() as usize + 1;
            let (u, y) = record(h, steps, input);
            let mut observer = observer(Settings { reading, ..Settings::new(h) }, tuning(1e3));
            observer.record(&RunControl::default(), steps, &u, &y, 0).unwrap();
            observer.theta(0)
        };
        let error =
            |theta: &[f64]| theta.iter().zip(want).map(|(g, w)| (g - w).abs()).fold(0.0, f64::max);
        let coarse = error(&theta(0.01));
        assert!(coarse < 3.1e-4, "{reading:?}: {coarse:e} at 10 ms");
        // what is left at short steps falls in proportion to them (the prior counts from
        // half a step before the start): extrapolated to none
        let (long, short) = (theta(4e-4), theta(2e-4));
        let limit: Vec<f64> = long.iter().zip(&short).map(|(a, b)| 2.0 * b - a).collect();
        let fine = error(&limit);
        assert!(fine < 1e-6, "{reading:?}: {fine:e} in the limit");
    }
}

#[test]
fn parameters_settle_when_the_tables_say() {
    use Reading::{Obs, Reg, Zhang};
    let table = [
        (Obs, 1e3, [38.6, 48.5]),
        (Reg, 1e3, [79.6, 98.1]),
        (Zhang, 1e3, [67.1, 89.5]),
        (Obs, 1e4, [46.3, 67.1]),
        (Reg, 1e4, [37.2, 89.4]),
        (Zhang, 1e4, [40.3, 73.1]),
        // with regressors for the unknown x(0)
        (Zhang, 1e6, [26.9, 37.3]),
    ];
    let h = 0.002;
    let steps = (120.0 / h) as usize + 1;
    let (u, y) = record(h, steps, input);
    for (reading, p0, want) in table {
        let initial_state = p0 == 1e6;
        let settings = Settings { reading, initial_state, ..Settings::new(h) };
        let tuning = Tuning { initial_P0: vec![p0; 2], ..tuning(p0) };
        let mut observer = observer(settings, tuning);
        let theta = observer.record(&RunControl::default(), steps, &u, &y, 1).unwrap();
        let got = [0.05, 0.01].map(|share| settled(&theta, &TRUTH, h, share));
        for (g, w) in got.iter().zip(want) {
            assert!((g - w).abs() < 0.16, "{reading:?}, P0 = {p0:e}: {got:?} for {want:?}");
        }
    }
}

#[test]
fn the_factored_form_is_the_information_form() {
    let h = 0.01;
    let steps = 6001;
    let (u, y) = record(h, steps, input);
    for p0 in [1e2, 1e4, 1e6, 1e8] {
        let mut observer = observer(Settings::new(h), tuning(p0));
        let mut oracle = Oracle::new(h, 0.15, p0);
        let mut worst = 0.0_f64;
        for k in 0..steps {
            observer.step(&[u[k]], &[y[k]]).unwrap();
            oracle.step(u[k], y[k]);
            for (g, w) in observer.theta(0).iter().zip(oracle.theta) {
                worst = worst.max((g - w).abs() / w.abs().max(1.0));
            }
        }
        assert!(worst < 3e-9, "P0 = {p0:e}: {worst:e}");
    }
}

#[test]
fn no_forgetting_above_the_cap_keeps_the_estimate() {
    let h = 0.01;
    let steps = 36_001;
    let quiet = |t: f64| if (120.0..320.0).contains(&t) { 0.0 } else { input(t) };
    let (u, y) = record(h, steps, quiet);
    let run = |trace_cap: f64| {
        let tuning = Tuning { trace_cap, ..tuning(1e3) };
        let mut observer = observer(Settings::new(h), tuning);
        let theta = observer.record(&RunControl::default(), steps, &u, &y, 1).unwrap();
        let error =
            |row: &[f64]| row.iter().zip(TRUTH).map(|(v, w)| (v - w).abs()).fold(0.0, f64::max);
        let late = theta.chunks_exact(4).skip(12_000).map(error).fold(0.0, f64::max);
        (late, observer.theta(0).iter().all(|v| v.is_finite()))
    };
    let (wound, _) = run(f64::INFINITY);
    let (kept, finite) = run(1e5);
    assert!(kept <= 0.15 && finite, "{kept}");
    assert!(wound > 10.0 * kept, "{wound}");
}
