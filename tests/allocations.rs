//! A step takes no memory once it runs.

use allocation_counter::measure;
use mmae::bank::{GainMode, Members, Settings};
use mmae::engine::{Innovation, Mixing, Mmae, Weighting};
use mmae::mat;
use mmae::model::{Plant, Time};
use mmae::observer::ObserverKind;
use mmae::weight::{DwsgScheme, Law, Transition};

fn plant(time: Time, k: f64) -> Plant {
    let a = match time {
        Time::Continuous => mat![[0.0, 1.0], [-k, -0.4]],
        Time::Discrete { .. } => mat![[0.9, 0.1], [-0.1 * k, 0.8]],
    };
    Plant {
        time,
        A: a,
        B: mat![[0.0], [1.0]],
        G: mat![[0.0], [1.0]],
        C: mat![[1.0, 0.0]],
        Q: mat![[1.0]],
        R: mat![[0.01]],
    }
}

fn members(observer: ObserverKind) -> Members {
    let time = match observer.is_continuous() {
        true => Time::Continuous,
        false => Time::Discrete { dt: 0.01 },
    };
    Members::new(observer, (1..=9).map(|i| plant(time, f64::from(i) / 3.0)).collect())
}

fn weightings(continuous: bool) -> Vec<Weighting> {
    let sticky = || Transition::sticky(9, 0.99).unwrap();
    let mut laws = vec![
        Law::Zhang { n_max: 1.0 },
        Law::Zhang { n_max: f64::INFINITY },
        Law::Dwsg { lambda: 2.0, tempering: 0.5, scheme: DwsgScheme::Left },
        Law::Dwsg { lambda: 2.0, tempering: 1.0, scheme: DwsgScheme::Trapezoid },
    ];
    laws.extend(match continuous {
        true => [Law::Likelihood, Law::Ode { substeps: 4 }],
        false => [Law::Bayes, Law::Bayes],
    });
    let law = laws[4];
    let mut all: Vec<Weighting> =
        laws.into_iter().map(|law| Weighting { law, ..Weighting::default() }).collect();
    let mut mixings = vec![Mixing::Markov(sticky()), Mixing::Reseed { threshold: 0.05 }];
    if !continuous {
        mixings.push(Mixing::Imm(sticky()));
    }
    all.extend(mixings.into_iter().map(|mixing| Weighting { law, mixing, ..Weighting::default() }));
    let innovation = Innovation::Common(mat![[2.0]]);
    all.push(Weighting { law, innovation, ..Weighting::default() });
    all
}

/// Allocations of 50 steps, the first so many left out.
fn allocations(engine: &mut Mmae, warm: usize, missing: bool) -> u64 {
    let mut step = |k: usize| {
        let u = [(0.1 * k as f64).sin()];
        let y = [if missing && k.is_multiple_of(5) { f64::NAN } else { (0.3 * k as f64).cos() }];
        engine.step(&u, &y).map(|e| e.step).unwrap()
    };
    for k in 0..warm {
        step(k);
    }
    let info = measure(|| {
        for k in warm..warm + 50 {
            step(k);
        }
    });
    info.count_total
}

#[test]
fn a_step_allocates_nothing() {
    for observer in [ObserverKind::Kalman, ObserverKind::KalmanBucy, ObserverKind::Krener] {
        let members = members(observer);
        for gains in [GainMode::Steady, GainMode::Recursive] {
            // a Riccati equation that has come to rest is not solved any more
            let warm =
                if observer.is_continuous() && gains == GainMode::Recursive { 9000 } else { 3 };
            for weighting in weightings(observer.is_continuous()) {
                let settings = Settings { gains, dt: Some(0.01), ..Settings::default() };
                let mut engine = Mmae::new(&members, &settings, &weighting, &[1.0; 9]).unwrap();
                let count = allocations(&mut engine, warm, false);
                assert_eq!(count, 0, "{observer:?} {gains:?} {weighting:?}");
            }
        }
    }
}

/// Missing samples change the gains, in place too.
#[test]
fn a_missing_sample_allocates_nothing() {
    let members = members(ObserverKind::Kalman);
    for gains in [GainMode::Steady, GainMode::Recursive] {
        for weighting in weightings(false) {
            let settings = Settings { gains, ..Settings::default() };
            let mut engine = Mmae::new(&members, &settings, &weighting, &[1.0; 9]).unwrap();
            let count = allocations(&mut engine, 10, true);
            assert_eq!(count, 0, "{gains:?} {weighting:?}");
        }
    }
}
