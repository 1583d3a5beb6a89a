//! Statistics over trials against the trials themselves.

use mmae::engine::{Mixing, Mmae, Weighting};
use mmae::par::RunControl;
use mmae::sim::{LEVELS, MonteCarlo, Summary};

use crate::setup::case;

fn run(experiment: &MonteCarlo) -> Summary {
    experiment.run(&RunControl::default()).unwrap()
}

fn close(got: f64, want: f64, name: &str) {
    let near = (got - want).abs() <= 1e-9 * want.abs().max(1e-3);
    assert!(near || (got.is_nan() && want.is_nan()), "{name}: {got} for {want}");
}

/// Linear interpolation between order statistics.
fn quantiles(mut values: Vec<f64>) -> [f64; 5] {
    values.sort_by(f64::total_cmp);
    LEVELS.map(|s| {
        let at = s * (values.len() - 1) as f64;
        let (k, rest) = (at as usize, at.fract());
        values[k] + rest * (values[(k + 1).min(values.len() - 1)] - values[k])
    })
}

/// `e' P^-1 e` by elimination.
fn mahalanobis(p: &[Vec<f64>], e: &[f64]) -> f64 {
    let n = e.len();
    let (mut a, mut b) = (p.to_vec(), e.to_vec());
    for k in 0..n {
        for i in k + 1..n {
            let factor = a[i][k] / a[k][k];
            for j in k..n {
                a[i][j] -= factor * a[k][j];
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            b[k] -= a[k][j] * b[j];
        }
        b[k] /= a[k][k];
    }
    b.iter().zip(e).map(|(b, e)| b * e).sum()
}

#[test]
fn numbers_are_those_of_the_trials() {
    let trials = 70_u64;
    let keep: Vec<u64> = (0..trials).collect();
    let experiment = MonteCarlo { trials, steps: 30, every: 10, keep, ..case(3) };
    let summary = run(&experiment);
    let count = trials as f64;
    for (row, moment) in summary.record.iter().enumerate() {
        let mut weights = vec![Vec::new(); 4];
        let (mut theta, mut norms) = (Vec::new(), Vec::new());
        let mut errors = vec![Vec::new(); 4];
        let (mut nees, mut fused) = (vec![0.0; 4], 0.0);
        for trial in &summary.kept {
            let e = &experiment;
            let mut engine = Mmae::new(&e.members, &e.settings, &e.weighting, &e.prior).unwrap();
            // measurements are kept where they are reported, so run it by hand
            let whole = run(&MonteCarlo {
                keep: vec![trial.trial],
                trials: trial.trial + 1,
                every: 1,
                steps: moment.step,
                ..e.clone()
            });
            for y in whole.kept[0].y.chunks(2) {
                engine.step(&[], y).unwrap();
            }
            let p = &engine.estimate().p;
            theta.push(engine.estimate().mean(&[2.0, 1.0, 1.2, 1.4]));
            let e: Vec<f64> =
                (0..4).map(|j| trial.x[row * 4 + j] - trial.x_hat[row * 4 + j]).collect();
            norms.push(e.iter().map(|e| e * e).sum::<f64>().sqrt());
            for j in 0..4 {
                errors[j].push(e[j]);
            }
            let rows = |m: mmae::Mat<f64>| -> Vec<Vec<f64>> {
                (0..4).map(|i| (0..4).map(|j| m[(i, j)]).collect()).collect()
            };
            for i in 0..4 {
                weights[i].push(p[i]);
                let mut x = [0.0; 4];
                engine.bank().x_hat_into(i, &mut x);
                let own: Vec<f64> = (0..4).map(|j| trial.x[row * 4 + j] - x[j]).collect();
                nees[i] += mahalanobis(&rows(engine.bank().covariance(i)), &own) / count;
            }
            fused += mahalanobis(&rows(engine.covariance()), &e) / count;
        }
        for i in 0..4 {
            close(moment.nees[i], nees[i], "NEES");
            for (got, want) in moment.p_quantiles[i].iter().zip(quantiles(weights[i].clone())) {
                close(*got, want, "quantile of a weight");
            }
            let mean = errors[i].iter().sum::<f64>() / count;
            let square = errors[i].iter().map(|e| (e - mean).powi(2)).sum::<f64>() / count;
            close(moment.x_error_mean[i], mean, "mean error");
            close(moment.x_error_std[i], square.sqrt(), "spread of the error");
            for (got, want) in moment.x_error_quantiles[i].iter().zip(quantiles(errors[i].clone()))
            {
                close(*got, want, "quantile of an error");
            }
        }
        close(moment.nees_fused, fused, "fused NEES");
        for (got, want) in moment.theta_hat_quantiles[0].iter().zip(quantiles(theta)) {
            close(*got, want, "quantile of the parameter");
        }
        for (got, want) in moment.x_error_norm_quantiles.iter().zip(quantiles(norms)) {
            close(*got, want, "quantile of the norm");
        }
    }
}

/// Chi-square numbers of the model that is right; the others are not consistent.
#[test]
fn the_right_filter_is_consistent() {
    let experiment = MonteCarlo { trials: 4000, ..case(1) };
    let summary = run(&experiment);
    let [low, high] = summary.nees_band;
    assert!(low < 4.0 && high > 4.0 && high - low < 0.25, "{low} {high}");
    let (mut nees, mut nis) = (0, 0);
    for m in &summary.record {
        nees += usize::from((low..=high).contains(&m.nees[2]));
        nis += usize::from((summary.nis_band[0]..=summary.nis_band[1]).contains(&m.nis[2]));
        assert!((m.nees_inside[2] - 0.95).abs() < 0.02, "{}", m.nees_inside[2]);
        assert!((m.nis_inside[2] - 0.95).abs() < 0.02, "{}", m.nis_inside[2]);
        let mean: f64 = m.x_error_mean.iter().map(|e| e * e).sum();
        let std: f64 = m.x_error_std.iter().map(|e| e * e).sum();
        assert!((m.x_error_rms.powi(2) / (mean + std) - 1.0).abs() < 1e-9);
    }
    // 20 dependent means, each outside of its band one time in 20
    assert!(nees >= 15 && nis >= 15, "{nees} {nis}");
    let end = summary.last();
    assert!(end.nees[0] > 10.0 && end.nees_inside[0] < 0.7, "{:?}", end.nees);
    assert!((end.nees_fused - 4.0).abs() < 0.3, "{}", end.nees_fused);
    // counted quantiles against the exact ones of a quarter of the trials
    let few = run(&MonteCarlo { trials: 1000, ..experiment });
    for (a, b) in end.p_quantiles.iter().zip(&few.last().p_quantiles) {
        assert!((a[2] - b[2]).abs() < 0.05, "{a:?} {b:?}");
    }
}

/// Trials one by one have the statistics of trials in lanes.
#[test]
fn lanes_and_single_trials_agree() {
    let lanes = MonteCarlo { trials: 13, steps: 40, every: 20, ..case(4) };
    // re-seeding that never happens
    let mixing = Mixing::Reseed { threshold: 1e-300 };
    let alone =
        MonteCarlo { weighting: Weighting { mixing, ..Weighting::default() }, ..lanes.clone() };
    let (a, b) = (run(&lanes), run(&alone));
    for (a, b) in a.record.iter().zip(&b.record) {
        close(a.nees_fused, b.nees_fused, "fused NEES");
        close(a.nees_fused_inside, b.nees_fused_inside, "fused NEES");
        for i in 0..4 {
            close(a.nees[i], b.nees[i], "NEES");
            close(a.x_error_std[i], b.x_error_std[i], "spread");
            for k in 0..5 {
                close(a.p_quantiles[i][k], b.p_quantiles[i][k], "weights");
                close(a.x_error_quantiles[i][k], b.x_error_quantiles[i][k], "errors");
            }
        }
    }
    let wrong = MonteCarlo { values: vec![vec![1.0]; 3], ..lanes };
    assert!(wrong.run(&RunControl::default()).is_err());
}
