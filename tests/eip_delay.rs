//! Stability with an exact actuator delay, where a Pade approximation misjudges it.

use std::sync::Arc;

use mmae::eip::{Bank, Study, Verify};
use mmae::model::{Axis, Controller, Family, Grid, Plant, systems};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::small::{Cx, Dyn, cx_solve};

/// `C (jw - A)^-1 B`, one column.
fn response(a: &faer::Mat<f64>, b: &[f64], c: &faer::Mat<f64>, w: f64) -> Vec<Cx<f64>> {
    let n = a.nrows();
    let mut m: Vec<Cx<f64>> = (0..n * n)
        .map(|k| Cx::new(-a[(k / n, k % n)], if k % (n + 1) == 0 { w } else { 0.0 }))
        .collect();
    let mut x: Vec<Cx<f64>> = b.iter().map(|&b| Cx::real(b)).collect();
    assert!(cx_solve(Dyn(n), Dyn(1), &mut m, &mut x));
    let entry = |i: usize| (0..n).fold(Cx::zero(), |s: Cx<f64>, j| s + x[j].scale(c[(i, j)]));
    (0..c.nrows()).map(entry).collect()
}

/// The loop gain `K(jw) P(jw)` of one input.
fn gain(plant: &Plant, k: &Controller, w: f64) -> Cx<f64> {
    let b: Vec<f64> = (0..plant.nx()).map(|i| plant.B[(i, 0)]).collect();
    let y = response(&plant.A, &b, &plant.C, w);
    let mut u = Cx::zero();
    for (j, &y) in y.iter().enumerate() {
        let b: Vec<f64> = (0..k.A.nrows()).map(|i| k.B[(i, j)]).collect();
        u = u + response(&k.A, &b, &k.C, w)[0] * y;
    }
    u
}

/// The smallest delay with a mode on the axis: `|L| = 1` and `e^{-jw tau} L = 1`.
fn delay_margin(plant: &Plant, k: &Controller) -> f64 {
    let excess = |w: f64| gain(plant, k, w).norm_sqr() - 1.0;
    let mut margin = f64::INFINITY;
    let at = |i: usize| 10f64.powf(-2.0 + i as f64 / 500.0);
    for i in 0..2500 {
        let (mut low, mut high) = (at(i), at(i + 1));
        if excess(low) * excess(high) >= 0.0 {
            continue;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if excess(low) * excess(middle) < 0.0 { high = middle } else { low = middle }
        }
        let l = gain(plant, k, low);
        let angle = l.im.atan2(l.re).rem_euclid(std::f64::consts::TAU);
        margin = margin.min(angle / low);
    }
    margin
}

fn study(lengths: Vec<f64>, delays: Vec<f64>, pade_order: usize) -> Study {
    let grid = Grid::new(vec![
        ("L".into(), Axis::Explicit(lengths)),
        ("b".into(), Axis::Explicit(vec![0.1])),
    ]);
    let bank = Bank::along(ObserverKind::KalmanBucy, "L", &[1.0, 1.4, 1.8]);
    let mut study = Study::new(Arc::new(systems::pendulum()), bank, grid.unwrap());
    study.surroundings = systems::pendulum_surroundings();
    study.surroundings.pade_order = pade_order;
    study.delays = delays;
    study
}

#[test]
fn the_exact_delay_decides_stability() {
    let family = systems::pendulum();
    let controller = systems::pendulum_surroundings().controller.unwrap();
    for length in [0.9, 1.3, 1.9] {
        let plant = family.plant(&family.theta_with(&[("L", length)]).unwrap()).unwrap();
        let margin = delay_margin(&plant, &controller);
        assert!(margin > 0.05 && margin < 0.5, "{margin}");
        for pade_order in [1, 2, 4, 8] {
            let delays: Vec<f64> =
                [0.5, 0.99, 1.0 - 1e-6, 1.0 + 1e-6, 1.01, 1.2].map(|f| f * margin).to_vec();
            let mut study = study(vec![length], delays, pade_order);
            study.verify = Verify::None;
            let sets = study.run(&RunControl::default()).unwrap();
            for (case, stable) in sets.cases.iter().zip([true, true, true, false, false, false]) {
                let at = format!("L = {length}, delay {}, order {pade_order}", case.delay);
                assert_eq!(case.unstable.is_empty(), stable, "{at}");
                if stable {
                    // a loop near the limit has a number or none, never a wrong one
                    let known = case.upsilon.iter().all(|u| *u > 0.0);
                    let withheld = case.upsilon.iter().all(|u| u.is_nan());
                    assert!(known || withheld, "{at}: {:?}", case.upsilon);
                    assert!(known || case.delay > 0.9 * margin, "{at}");
                } else {
                    assert!(case.upsilon.iter().all(|u| u.is_nan()), "{at}");
                    assert!(case.unstable[0].mode.re > 0.0, "{at}");
                }
            }
        }
    }
}

#[test]
fn first_order_pade_at_94_milliseconds() {
    // Pade loops are stable here, the exact ones are not for all lengths
    let lengths: Vec<f64> = (0..21).map(|k| 0.9 + 0.05 * k as f64).collect();
    let exact = study(lengths.clone(), vec![0.0935, 0.0945, 0.0955], 10);
    let coarse = study(lengths, vec![0.0935, 0.0945, 0.0955], 1);
    let control = RunControl::default();
    let (exact, coarse) = (exact.run(&control).unwrap(), coarse.run(&control).unwrap());
    for (e, c) in exact.cases.iter().zip(&coarse.cases) {
        let plants = |case: &mmae::eip::Case| -> Vec<usize> {
            case.unstable.iter().map(|u| u.plant).collect()
        };
        assert_eq!(plants(e), plants(c), "delay {}", e.delay);
    }
    assert!(exact.cases[0].unstable.is_empty());
    assert!(!exact.cases[1].unstable.is_empty());
}
