//! Trials in lanes against the engine, one trial at a time.

use mmae::engine::{Innovation, Mixing, Mmae, Weighting};
use mmae::par::RunControl;
use mmae::sim::MonteCarlo;
use mmae::weight::{DwsgScheme, Law, Modifiers, Transition, Window};

use crate::setup::case;

fn weightings() -> Vec<(&'static str, Weighting)> {
    let plain = Weighting::default;
    let law = |law| Weighting { law, ..plain() };
    let modified = |m| Weighting { modifiers: m, ..plain() };
    let all = Modifiers::default;
    vec![
        ("bayes", plain()),
        ("steady", Weighting { innovation: Innovation::Steady, ..plain() }),
        (
            "common",
            Weighting {
                innovation: Innovation::Common(mmae::mat![[0.5, 0.1], [0.1, 0.25]]),
                ..plain()
            },
        ),
        ("zhang1", law(Law::Zhang { n_max: 1.0 })),
        ("zhang2", law(Law::Zhang { n_max: 20.0 })),
        (
            "window",
            Weighting {
                modifiers: Modifiers { window: Window::Sliding(7), ..all() },
                ..law(Law::Zhang { n_max: 1.0 })
            },
        ),
        ("dwsg", law(Law::Dwsg { lambda: 0.2, tempering: 0.5, scheme: DwsgScheme::Left })),
        (
            "trapezoid",
            law(Law::Dwsg { lambda: 0.2, tempering: 1.0, scheme: DwsgScheme::Trapezoid }),
        ),
        ("floor", modified(Modifiers { floor: 1e-3, forgetting: 0.95, clip: 5.0, ..all() })),
        (
            "markov",
            Weighting { mixing: Mixing::Markov(Transition::sticky(4, 0.98).unwrap()), ..plain() },
        ),
        ("imm", Weighting { mixing: Mixing::Imm(Transition::sticky(4, 0.98).unwrap()), ..plain() }),
        ("reseed", Weighting { mixing: Mixing::Reseed { threshold: 1e-3 }, ..plain() }),
    ]
}

/// What the engine makes of the measurements that a trial kept.
#[test]
fn trials_are_those_of_the_engine() {
    for (name, weighting) in weightings() {
        let prior = vec![0.4, 0.3, 0.0, 0.3];
        let experiment = MonteCarlo {
            weighting,
            prior,
            steps: 80,
            trials: 11,
            every: 1,
            keep: vec![0, 4, 9, 10],
            ..case(3)
        };
        let summary = experiment.run(&RunControl::default()).unwrap();
        for trial in &summary.kept {
            let e = &experiment;
            let mut engine = Mmae::new(&e.members, &e.settings, &e.weighting, &e.prior).unwrap();
            for k in 0..80 {
                let e = engine.step(&[], &trial.y[2 * k..][..2]).unwrap();
                for (got, want) in trial.log_p[4 * k..][..4].iter().zip(&e.log_p) {
                    let near = got == want || (got - want).abs() < 1e-11 * want.abs().max(1.0);
                    assert!(near, "{name} step {}: {got} for {want}", k + 1);
                }
                for (got, want) in trial.x_hat[4 * k..][..4].iter().zip(&e.x_hat) {
                    assert!(
                        (got - want).abs() < 1e-11 * want.abs().max(1.0),
                        "{name}: {got} {want}"
                    );
                }
            }
        }
    }
}
