//! Laws of weights on given evidence.

use mmae::weight::{DwsgScheme, Evidence, Law, Modifiers, Weights};

use crate::json::{close, list, number, read, vector};

fn dwsg(scheme: DwsgScheme, lambda: f64, prior: &[f64]) -> Weights<f64> {
    let law = Law::Dwsg { lambda, tempering: 1.0, scheme };
    Weights::new(law, Modifiers::default(), None, prior).unwrap()
}

fn evidence<'a>(log_lik: &'a [f64], dt: f64) -> Evidence<'a, f64> {
    Evidence { log_lik, increment: log_lik, energy: log_lik, dt, nodes: None }
}

fn p(w: &Weights<f64>) -> Vec<f64> {
    let mut p = vec![0.0; w.log_p().len()];
    w.p_into(&mut p);
    p
}

fn minus(v: &[f64]) -> Vec<f64> {
    v.iter().map(|x| -x).collect()
}

#[test]
fn dwsg_along_a_record_left_and_trapezoid() {
    let data = read("dwsg.json");
    let record = &data["dwsg_record"];
    let w: Vec<Vec<f64>> = list(&record["w"]).iter().map(vector).collect();
    for (scheme, name) in [(DwsgScheme::Left, "p_left"), (DwsgScheme::Trapezoid, "p_trap")] {
        let want: Vec<Vec<f64>> = list(&record[name]).iter().map(vector).collect();
        let mut weights = dwsg(scheme, 5.0, &[0.2, 0.5, 0.3]);
        if scheme == DwsgScheme::Trapezoid {
            weights.step(&evidence(&minus(&w[0]), 0.05));
        }
        for k in 0..40 {
            let at = if scheme == DwsgScheme::Left { k } else { k + 1 };
            assert!(weights.step(&evidence(&minus(&w[at]), 0.05)));
            close(name, &p(&weights), &want[k + 1], 0.0, 1e-13);
        }
    }
}

#[test]
fn dwsg_with_frozen_likelihoods_is_exact() {
    for item in list(&read("dwsg.json")["dwsg_frozen"]) {
        let log_p0: Vec<f64> = match item["p0"].as_array() {
            Some(_) => vector(&item["p0"]).iter().map(|p| p.ln()).collect(),
            None => vector(&item["lnp0"]),
        };
        let mut weights = dwsg(DwsgScheme::Left, 1.0, &vec![1.0; log_p0.len()]);
        weights.log_p_mut().copy_from_slice(&log_p0);
        let lambda = item.get("lambda").map_or(1.0, number);
        let dt = number(&item["h"]) * lambda;
        weights.step(&evidence(&minus(&vector(&item["w"])), dt));
        close("frozen", &p(&weights), &vector(&item["p"]), 0.0, 1e-13);
    }
}

/// The printed theorem says that model 1 wins; it oscillates for ever.
#[test]
fn the_counterexample_has_its_limit_cycle() {
    let mut weights = dwsg(DwsgScheme::Left, 1.0, &[0.5, 0.5]);
    let mut last = [0.0; 2];
    for k in 0..400 {
        let w = if k % 2 == 0 { 0.0 } else { 2.2 };
        weights.step(&evidence(&[-1.0, -w], 0.5));
        last[k % 2] = p(&weights)[0];
    }
    assert!((last[0] - 0.5143503879).abs() < 1e-10, "{last:?}");
    assert!((last[1] - 0.6351073661).abs() < 1e-10, "{last:?}");
}

#[test]
fn zero_priors_stay_zero_and_nothing_underflows() {
    let modifiers = Modifiers { floor: 1e-3, ..Modifiers::default() };
    let mut w = Weights::new(Law::Bayes, modifiers, None, &[0.0, 0.5, 0.5]).unwrap();
    for _ in 0..1000 {
        w.step(&evidence(&[0.0, -50.0, -60.0], 1.0));
    }
    let now = p(&w);
    assert_eq!(now[0], 0.0);
    assert!((now[2] - 1e-3 / 1.001).abs() < 1e-7, "{now:?}");

    let mut w: Weights<f64> =
        Weights::new(Law::Bayes, Modifiers::default(), None, &[1.0, 1.0]).unwrap();
    for _ in 0..1_000_000 {
        w.step(&evidence(&[-1.0, -1.5], 1.0));
    }
    assert!((w.log_p()[1] + 500_000.0).abs() < 1e-6, "{:?}", w.log_p());
    // and all of it can be taken back
    for _ in 0..1_000_000 {
        w.step(&evidence(&[-1.5, -1.0], 1.0));
    }
    assert!((p(&w)[0] - 0.5).abs() < 1e-6);
}

#[test]
fn a_measurement_that_no_model_explains_changes_nothing() {
    let mut w: Weights<f64> =
        Weights::new(Law::Bayes, Modifiers::default(), None, &[0.2, 0.8]).unwrap();
    let before = w.log_p().to_vec();
    assert!(!w.step(&evidence(&[f64::NEG_INFINITY, f64::NEG_INFINITY], 1.0)));
    assert!(!w.step(&evidence(&[f64::NAN, f64::NAN], 1.0)));
    assert_eq!(w.log_p(), before);
    // a member that failed is out, the other takes its share
    assert!(w.step(&evidence(&[f64::NAN, -1e300], 1.0)));
    assert_eq!(p(&w), [0.0, 1.0]);
}

#[test]
fn priors_are_checked() {
    for bad in [&[][..], &[0.0, 0.0], &[1.0, -1e-3], &[f64::NAN, 1.0], &[f64::INFINITY]] {
        assert!(Weights::<f64>::new(Law::Bayes, Modifiers::default(), None, bad).is_err());
    }
    let tiny = Weights::<f64>::new(Law::Bayes, Modifiers::default(), None, &[1e-320, 2e-320]);
    assert!((p(&tiny.unwrap())[1] - 2.0 / 3.0).abs() < 1e-3);
}

/// A model without weight is no measure for the others.
#[test]
fn zero_priors_do_not_matter_to_the_rest() {
    let laws = [
        Law::Bayes,
        Law::Zhang { n_max: 1.0 },
        Law::Dwsg { lambda: 0.5, tempering: 1.0, scheme: DwsgScheme::Left },
        Law::Dwsg { lambda: 0.5, tempering: 1.0, scheme: DwsgScheme::Mixture },
    ];
    for law in laws {
        let modifiers = Modifiers { clip: 1.0, ..Modifiers::default() };
        let mut with = Weights::<f64>::new(law, modifiers.clone(), None, &[0.0, 1.0, 1.0]).unwrap();
        let mut without = Weights::<f64>::new(law, modifiers, None, &[1.0, 1.0]).unwrap();
        for k in 0..30 {
            let l = [-(k as f64), -900.0 - k as f64, -902.0];
            let e = [0.1, 3.0, 2.0 + 0.1 * k as f64];
            let of = |from: usize| Evidence {
                log_lik: &l[from..],
                increment: &l[from..],
                energy: &e[from..],
                dt: 1.0,
                nodes: None,
            };
            assert!(with.step(&of(0)) && without.step(&of(1)));
        }
        assert_eq!(p(&with)[1..], p(&without)[..], "{law:?}");
    }
}

#[test]
fn the_mixture_with_mu_one_is_bayes_however_far() {
    let scheme = DwsgScheme::Mixture;
    let mut far = dwsg(scheme, 1.0, &[0.5, 0.5]);
    let mut bayes: Weights<f64> =
        Weights::new(Law::Bayes, Modifiers::default(), None, &[0.5, 0.5]).unwrap();
    for _ in 0..10 {
        far.step(&evidence(&[0.0, -1e5], 1.0));
        bayes.step(&evidence(&[0.0, -1e5], 1.0));
    }
    close("mu = 1", far.log_p(), bayes.log_p(), 1e-14, 1e-12);
    // and the way back
    for _ in 0..10 {
        far.step(&evidence(&[-1e5, 0.0], 1.0));
    }
    assert!((p(&far)[0] - 0.5).abs() < 1e-9);
}
