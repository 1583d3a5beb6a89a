//! The same bits for any number of threads and any company.

use mmae::Mat;
use mmae::bank::{Members, Settings};
use mmae::engine::{Mixing, Mmae, Weighting};
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::par::RunControl;
use mmae::sim::{MonteCarlo, Summary, Truth};

use crate::setup::case;

fn run(experiment: &MonteCarlo, threads: usize) -> Summary {
    experiment.run(&RunControl::default().threads(threads)).unwrap()
}

#[test]
fn threads_do_not_matter() {
    let experiment = MonteCarlo { trials: 333, steps: 60, keep: vec![0, 7, 200, 332], ..case(3) };
    let one = run(&experiment, 1);
    assert_eq!(one.kept.len(), 4);
    for threads in [2, 3, 8] {
        assert_eq!(run(&experiment, threads), one);
    }
}

#[test]
fn a_trial_is_the_same_in_any_company() {
    let keep: Vec<u64> = (0..45).collect();
    let whole = run(&MonteCarlo { trials: 45, steps: 40, keep: keep.clone(), ..case(1) }, 2);
    assert_eq!(whole.kept.iter().map(|t| t.trial).collect::<Vec<_>>(), keep);
    for trials in [1, 7, 8, 9, 17, 44] {
        let part = run(&MonteCarlo { trials, steps: 40, keep: keep.clone(), ..case(1) }, 1);
        assert_eq!(part.kept[..], whole.kept[..trials as usize]);
    }
    // and a shorter run is the beginning of a longer one
    let short = run(&MonteCarlo { trials: 45, steps: 20, keep, ..case(1) }, 1);
    for (a, b) in short.kept.iter().zip(&whole.kept) {
        assert_eq!(a.log_p[..], b.log_p[..a.log_p.len()]);
    }
    // sums are over the trials
    let last = whole.last();
    let n = whole.kept[0].log_p.len();
    for i in 0..4 {
        let mean = whole.kept.iter().map(|t| t.log_p[n - 4 + i].exp()).sum::<f64>() / 45.0;
        assert!((mean - last.p[i]).abs() < 1e-14);
    }
}

/// Trials in lanes take several steps at a time; those whose weights are re-seeded (here
/// never) go through the engine one step after the other.
#[test]
fn trials_in_lanes_are_those_of_steps() {
    let mut state = 3_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963);
        (state >> 11) as f64 * 2.0_f64.powi(-52) - 1.0
    };
    for n in 1..=8 {
        for (q, inputs) in [(1, 0), (2, 0), (3, 1)] {
            let mut plant = || Plant {
                time: Time::Discrete { dt: 1.0 },
                A: Mat::from_fn(n, n, |_, _| uniform() / (1.2 * (n as f64).sqrt())),
                B: Mat::from_fn(n, inputs, |_, _| uniform()),
                G: Mat::identity(n, n),
                C: Mat::from_fn(q, n, |_, _| uniform()),
                Q: Mat::identity(n, n),
                R: Mat::identity(q, q),
            };
            let plants = vec![plant(), plant(), plant()];
            let lanes = MonteCarlo {
                truth: Truth::new(plants[1].clone()),
                members: Members::new(ObserverKind::Kalman, plants),
                settings: Settings::default(),
                prior: vec![1.0; 3],
                values: Vec::new(),
                steps: 45,
                trials: 11,
                every: 7,
                keep: (0..11).collect(),
                ..case(1)
            };
            let mixing = Mixing::Reseed { threshold: f64::MIN_POSITIVE };
            let weighting = Weighting { mixing, ..lanes.weighting.clone() };
            let (got, want) = (run(&lanes, 1), run(&MonteCarlo { weighting, ..lanes }, 1));
            for (got, want) in got.kept.iter().zip(&want.kept) {
                assert_eq!((&got.x, &got.y), (&want.x, &want.y), "n = {n}, q = {q}");
                for (a, b) in got.x_hat.iter().zip(&want.x_hat) {
                    assert!((a - b).abs() < 1e-12 * (1.0 + b.abs()), "n = {n}, q = {q}: {a} {b}");
                }
            }
            for (got, want) in got.record.iter().zip(&want.record) {
                for (a, b) in got.nis.iter().zip(&want.nis) {
                    assert!((a - b).abs() < 1e-12 * b.abs(), "n = {n}, q = {q}: {a} {b}");
                }
            }
        }
    }
}

/// A hidden state overflows in the trials where it starts above 1.5 standard
/// deviations, and only there makes the measurement no number.
#[test]
fn trials_that_run_away_leave_the_others_alone() {
    let mut wild = case(1);
    let calm = wild.truth.phases[0].1.clone();
    let with = |hidden: f64, seen: f64| Plant {
        A: Mat::from_fn(5, 5, |i, j| match (i, j) {
            (4, 4) => hidden,
            (i, j) if i < 4 && j < 4 => calm.A[(i, j)],
            _ => 0.0,
        }),
        B: Mat::zeros(5, 0),
        G: Mat::from_fn(5, 4, |i, j| if i == j { 1.0 } else { 0.0 }),
        C: Mat::from_fn(2, 5, |i, j| if j < 4 { calm.C[(i, j)] } else { seen }),
        ..calm.clone()
    };
    wild.truth.phases = vec![(0, with(1.2e8, 1e-308)), (2, with(0.0, 1.0))];
    wild.truth.x0.push(0.0);
    let spread = |i, j| if (i, j) == (4, 4) { 1e300 } else { 0.0 };
    wild.truth.P0 = Some(Mat::from_fn(5, 5, spread));
    wild.truth.phases[0].1.A[(4, 4)] = 1.2e158;
    (wild.trials, wild.steps, wild.every, wild.keep) = (64, 50, 1, (0..64).collect());
    let summary = run(&wild, 1);
    let mut lost = 0;
    for trial in &summary.kept {
        assert!(trial.log_p.iter().all(|l| !l.is_nan()));
        if trial.y.iter().any(|y| !y.is_finite()) {
            lost += 1;
            continue;
        }
        let mut engine =
            Mmae::new(&wild.members, &wild.settings, &wild.weighting, &wild.prior).unwrap();
        for k in 0..50 {
            let e = engine.step(&[], &trial.y[2 * k..][..2]).unwrap();
            for (got, want) in trial.log_p[4 * k..][..4].iter().zip(&e.log_p) {
                assert!((got - want).abs() < 1e-11 * want.abs().max(1.0), "{got} {want}");
            }
        }
    }
    assert!(lost > 2 && lost < 30, "{lost}");
    let last = summary.last();
    assert!(last.failed.iter().all(|f| (f - f64::from(lost) / 64.0).abs() < 1e-12));
    assert!((last.p.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    assert!(!last.x_error_rms.is_finite());
    assert!(last.nis.iter().all(|n| n.is_finite()));
}
