//! Lanes, threads, missing outputs, boxes, resets.

use mmae::adaptive::{Adaptive, Prior, Reading, Records, Settings, Tuning, run_records};
use mmae::par::RunControl;
use mmae::{Error, mat};

use super::example::{TRUTH, input, record, structure, tuning};

/// Eleven observers that differ in everything an item may differ in.
fn many() -> Vec<Tuning> {
    (0..11)
        .map(|i| {
            let i = f64::from(i);
            Tuning {
                A: mat![[0.0, 1.0], [-7.0 + 0.1 * i, -2.0]],
                K: mat![[5.0 + 0.2 * i], [-5.0]],
                lambda: 0.05 * i,
                trace_cap: if i > 5.0 { 1e4 } else { f64::INFINITY },
                bounds: vec![[-10.0, 10.0], [-10.0, 2.4], [0.0, 4.0 + 0.1 * i], [-10.0, 10.0]],
                resets: if i > 7.0 { vec![3.0, 7.5] } else { Vec::new() },
                ..tuning(10_f64.powf(2.0 + 0.5 * i))
            }
        })
        .collect()
}

fn bits(list: &[f64]) -> Vec<u64> {
    list.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn items_have_the_same_bits_alone_in_lanes_and_on_any_threads() {
    let (h, steps) = (0.02, 1001);
    let (u, mut y) = record(h, steps, input);
    for k in (40..steps).step_by(97) {
        y[k] = f64::NAN;
    }
    for reading in [Reading::Zhang, Reading::Obs, Reading::Reg] {
        let initial_state = reading == Reading::Zhang;
        let settings = Settings { reading, initial_state, window: 100, ..Settings::new(h) };
        let all = |threads: usize| {
            let mut batch = Adaptive::new(structure(), settings.clone(), many()).unwrap();
            let control = RunControl::default().threads(threads);
            let theta = batch.record(&control, steps, &u, &y, 100).unwrap();
            (theta, batch)
        };
        let (one, batch) = all(1);
        assert!(one.iter().all(|v| v.is_finite()), "{reading:?}");
        for threads in [2, 4] {
            assert_eq!(bits(&all(threads).0), bits(&one));
        }
        for (i, tuning) in many().into_iter().enumerate() {
            let mut alone = Adaptive::new(structure(), settings.clone(), vec![tuning]).unwrap();
            for (u, y) in u.iter().zip(&y) {
                alone.step(&[*u], &[*y]).unwrap();
            }
            assert_eq!(bits(&alone.theta(0)), bits(&batch.theta(i)), "{reading:?} {i}");
            assert_eq!(bits(&alone.x_hat(0)), bits(&batch.x_hat(i)), "{reading:?} {i}");
            assert_eq!(alone.window(0), batch.window(i));
        }
    }
}

#[test]
fn a_reset_starts_again() {
    let (h, steps) = (0.02, 401);
    let (u, y) = record(h, steps, input);
    let mut batch = Adaptive::new(structure(), Settings::new(h), many()).unwrap();
    let control = RunControl::default();
    let first = batch.record(&control, steps, &u, &y, 10).unwrap();
    batch.reset();
    assert_eq!(bits(&batch.record(&control, steps, &u, &y, 10).unwrap()), bits(&first));
}

#[test]
fn a_bad_item_is_flagged_and_leaves_the_others_alone() {
    let (h, steps) = (0.02, 301);
    let (u, y) = record(h, steps, input);
    let run = |tunings: Vec<Tuning>| {
        let mut batch = Adaptive::new(structure(), Settings::new(h), tunings).unwrap();
        batch.record(&RunControl::default(), steps, &u, &y, 0).unwrap();
        batch
    };
    let good = run(many());
    let mut broken = many();
    broken[0].K = mat![[-5.0], [5.0]];
    broken[4].theta[1] = f64::NAN;
    let batch = run(broken);
    assert!(matches!(batch.failures()[0], Some(Error::ObserverUnstable { opposite: true, .. })));
    assert!(matches!(batch.failures()[4], Some(Error::NonFinite { .. })));
    for i in 0..11 {
        if i == 0 || i == 4 {
            assert!(batch.theta(i).iter().all(|v| v.is_nan()) && !batch.is_sound(i));
        } else {
            assert_eq!(bits(&batch.theta(i)), bits(&good.theta(i)), "{i}");
        }
    }
}

#[test]
fn estimates_stay_in_their_box_and_settle_inside_it() {
    let (h, steps) = (0.01, 9001);
    let (u, y) = record(h, steps, input);
    let boxed =
        Tuning { bounds: vec![[-5.0, 5.0], [-5.0, 2.4], [0.0, 4.2], [-5.0, 5.0]], ..tuning(1e4) };
    let mut batch = Adaptive::new(structure(), Settings::new(h), vec![boxed, tuning(1e4)]).unwrap();
    let control = RunControl::default();
    let theta = batch.record(&control, steps, &u, &y, 1).unwrap();
    for row in theta[..steps * 4].chunks_exact(4) {
        assert!(row[1] <= 2.4 && (0.0..=4.2).contains(&row[2]), "{row:?}");
    }
    // b = 4.5 is outside
    let [held, free] = [0, 1].map(|i| batch.estimate(i));
    assert_eq!(held.at_bound, [false, false, true, false]);
    assert!(!held.is_settled(1.0));
    assert!(free.is_settled(0.05), "{:?}", free.window);
    let error = free.theta.iter().zip(TRUTH).map(|(v, w)| (v - w).abs()).fold(0.0, f64::max);
    assert!(error < 0.05, "{error}");
}

#[test]
fn the_window_sees_a_lack_of_excitation() {
    let h = 0.01;
    let steps = 4001;
    let condition = |u: &dyn Fn(f64) -> f64| {
        let (u, y) = record(h, steps, u);
        let mut one = Adaptive::new(structure(), Settings::new(h), vec![tuning(1e3)]).unwrap();
        one.record(&RunControl::default(), steps, &u, &y, 0).unwrap();
        one.window(0).condition
    };
    let (rich, poor) = (condition(&input), condition(&|_| 1.0));
    assert!(rich < 1e6 && poor > 1e3 * rich, "{rich:e} {poor:e}");
}

#[test]
fn standard_deviations_cover_the_errors_that_noise_makes() {
    // sixteen records with white noise on y, truth in the box of three deviations
    let (h, steps, sigma) = (0.02, 3001, 1e-3);
    let (u, y) = record(h, steps, input);
    let mut streams = mmae::sim::Streams::new(5, 0);
    let mut noisy = Vec::new();
    for _ in 0..16 {
        for y in &y {
            // a sum of uniform numbers is normal enough
            let sum: f64 = (0..3).map(|_| streams.uniforms()[0] + streams.uniforms()[1]).sum();
            noisy.push(y + sigma * (sum - 3.0) / 0.5_f64.sqrt());
        }
    }
    let prior = Prior::Sigma { theta: vec![10.0; 4], noise: sigma };
    let all = vec![Tuning { prior, x_hat: vec![0.0; 2], ..tuning(1.0) }; 16];
    let mut batch = Adaptive::new(structure(), Settings::new(h), all).unwrap();
    batch.record(&RunControl::default(), steps, &u, &noisy, 0).unwrap();
    let mut share = [0.0; 4];
    for i in 0..16 {
        let e = batch.estimate(i);
        assert!((e.window.residual / sigma - 1.0).abs() < 0.25, "{:?}", e.window);
        for (k, share) in share.iter_mut().enumerate() {
            assert!(e.std[k] > 0.0 && e.correlation[(k, k)] > 0.999);
            *share += ((e.theta[k] - TRUTH[k]) / e.std[k]).powi(2) / 16.0;
        }
    }
    // an upper bound: the mean square is at most about one
    assert!(share.iter().all(|s| *s < 2.0), "{share:?}");
}

/// Courses of many tunings along many records are those of each observer alone, sample by
/// sample, with a gap in the times and a tuning that cannot be used among them.
#[test]
fn courses_of_records_are_those_of_each_alone() {
    let (h, samples, count) = (0.02, 301, 10);
    let settings = Settings { window: 100, ..Settings::new(h) };
    let mut tunings = many();
    tunings[3].K = mat![[-5.0], [5.0]];
    let (mut all_u, mut all_y) = (Vec::new(), Vec::new());
    for record_ in 0..count {
        let scale = 1.0 + 0.1 * f64::from(record_);
        let (u, mut y) = record(h, samples, |t| scale * input(t));
        y[50] = f64::NAN;
        all_u.extend(u);
        all_y.extend(y);
    }
    let mut intervals = vec![1; samples];
    intervals[120] = 4;
    let reports = [99, 119, 120, 300];
    let records = Records {
        records: count as usize,
        samples,
        y: &all_y,
        u: &all_u,
        intervals: &intervals,
        reports: &reports,
    };
    let run = |threads: usize| {
        let control = RunControl::default().threads(threads);
        run_records(&structure(), &settings, &tunings, &records, 0.5, &control).unwrap()
    };
    let got = run(1);
    let two = run(2);
    assert_eq!((bits(&two.theta), bits(&two.drift)), (bits(&got.theta), bits(&got.drift)));
    assert!(matches!(got.failures[3], Some(Error::ObserverUnstable { .. })));
    for (i, tuning) in tunings.iter().enumerate() {
        for j in 0..records.records {
            let course = i * records.records + j;
            if i == 3 {
                assert!(!got.sound[course] && got.theta[course * 16..][..16][0].is_nan());
                continue;
            }
            let one = vec![tuning.clone()];
            let mut alone = Adaptive::new(structure(), settings.clone(), one).unwrap();
            let (u, y) = (&all_u[j * samples..], &all_y[j * samples..]);
            let mut report = 0;
            for k in 0..samples {
                for gap in 1..intervals[k] {
                    let share = gap as f64 / intervals[k] as f64;
                    let between = u[k - 1] + share * (u[k] - u[k - 1]);
                    alone.step(&[between], &[f64::NAN]).unwrap();
                }
                alone.step(&[u[k]], &[y[k]]).unwrap();
                if reports.get(report) == Some(&k) {
                    let (e, row) = (alone.estimate(0), course * reports.len() + report);
                    assert_eq!(bits(&e.theta), bits(&got.theta[row * 4..][..4]));
                    assert_eq!(bits(&e.std), bits(&got.theta_std[row * 4..][..4]));
                    assert_eq!(bits(&e.x_std), bits(&got.x_std[row * 2..][..2]));
                    assert_eq!(
                        e.correlation[(1, 2)].to_bits(),
                        got.correlation[row * 16 + 6].to_bits()
                    );
                    assert_eq!(e.window.condition.to_bits(), got.condition[row].to_bits());
                    assert_eq!(e.is_settled(0.5), got.settled[row]);
                    assert_eq!(y[k].to_bits(), got.y[j * reports.len() + report].to_bits());
                    report += 1;
                }
            }
            assert!(got.sound[course]);
        }
    }
}

#[test]
fn records_that_do_not_fit_are_refused() {
    let (u, y) = (vec![0.0; 20], vec![0.0; 20]);
    let good = Records { records: 2, samples: 10, y: &y, u: &u, intervals: &[], reports: &[4, 9] };
    let refused = |records: Records<'_>, tolerance: f64| {
        let settings = Settings::new(0.02);
        let all = [tuning(1e3)];
        let control = RunControl::default();
        run_records(&structure(), &settings, &all, &records, tolerance, &control).err()
    };
    assert_eq!(refused(good, 0.02), None);
    assert!(matches!(refused(Records { y: &y[1..], ..good }, 0.02), Some(Error::Shape { .. })));
    assert!(matches!(refused(Records { u: &u[3..], ..good }, 0.02), Some(Error::Shape { .. })));
    let list = [1; 3];
    let short = Records { intervals: &list, ..good };
    assert!(matches!(refused(short, 0.02), Some(Error::Shape { .. })));
    for reports in [&[4, 4][..], &[10], &[]] {
        let wrong = Records { reports, ..good };
        assert!(matches!(refused(wrong, 0.02), Some(Error::Range { .. })), "{reports:?}");
    }
    assert!(matches!(refused(good, f64::NAN), Some(Error::Range { .. })));
    let odd = vec![f64::INFINITY; 20];
    let infinite = Records { y: &odd, ..good };
    assert!(matches!(refused(infinite, 0.02), Some(Error::NonFinite { .. })));
    let none = Records { samples: 0, y: &[], u: &[], ..good };
    assert!(matches!(refused(none, 0.02), Some(Error::Empty { .. })));
}
