//! What valid scenarios mean.

use std::error::Error;
use std::path::PathBuf;

use mmae::eip::{Convention, Method, Verify};
use mmae::mat;
use mmae::model::{Axis, Family, Time};
use mmae::observer::ObserverKind;
use mmae::scenario::{Scenario, Template, template};

type Outcome = Result<(), Box<dyn Error>>;

/// A small valid scenario: `plant` goes into `[plant]`, `rest` after it.
fn spring(plant: &str, rest: &str) -> Result<Scenario, mmae::scenario::Error> {
    let text = format!(
        "format = 1\n[plant]\nstates = [\"x\", \"v\"]\noutputs = [\"x\"]\nC = [1, 0]\n\
         A = [[0, 1], [\"-k\", \"-c\"]]\n{plant}\n[plant.parameters]\nk = 2\nc = 0.5\n{rest}"
    );
    Scenario::parse("spring.toml", &text)
}

const CONTINUOUS: &str = "time = \"continuous\"\nR = 0.01\n\
                          disturbances = [\"w\"]\nG = [0, 1]\nQ = 1";

/// A study of the small scenario: `bank` and `eip` replace the defaults.
fn study(bank: &str, eip: &str) -> Result<Scenario, mmae::scenario::Error> {
    let models = if bank.contains("models") { "" } else { "models = { k = [1, 2] }\n" };
    let grid = if eip.contains("grid") { "" } else { "grid = { k = [1, 2, 3] }\n" };
    spring(CONTINUOUS, &format!("[bank]\n{models}{bank}\n[eip]\n{grid}{eip}"))
}

fn examples() -> Result<Vec<PathBuf>, std::io::Error> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/examples"))? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "toml") {
            all.push(path);
        }
    }
    Ok(all)
}

#[test]
fn the_examples_parse_without_warnings() -> Outcome {
    let all = examples()?;
    assert!(all.len() >= 6);
    for path in all {
        let scenario = Scenario::from_file(&path)?;
        assert_eq!(scenario.warnings(), [], "{}", path.display());
        assert!(scenario.title().is_some());
        let text = std::fs::read_to_string(&path)?;
        if !text.contains("\n[bank]") {
            // adaptive observers alone
            assert!(!scenario.adaptive_observers().is_empty());
            assert!(!scenario.adaptive_cases(&[])?.is_empty());
            continue;
        }
        if !text.contains("[eip]") {
            // a bank that only runs
            let estimator = scenario.estimator()?;
            assert!(estimator.start()?.bank().failures().iter().all(Option::is_none));
            continue;
        }
        let study = scenario.study()?;
        // every plant and every model of the example can be built and is sound
        for index in [0, study.grid.len() / 2, study.grid.len() - 1] {
            let point = study.grid.point(index);
            let axes = study.grid.axes().iter().map(|(name, _)| name.as_str());
            let values: Vec<(&str, f64)> = axes.zip(point).collect();
            let family = scenario.family();
            family.plant(&family.theta_with(&values)?)?.check()?;
        }
        for model in &study.bank.models {
            let names = study.bank.parameters.iter().map(String::as_str);
            let values: Vec<(&str, f64)> = names.zip(model.iter().copied()).collect();
            let family = scenario.family();
            family.plant(&family.theta_with(&values)?)?.check()?;
        }
    }
    Ok(())
}

#[test]
fn the_scenario_of_the_guide_parses() -> Outcome {
    let guide = include_str!("../../src/guide/scenario.md");
    let text = guide.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next());
    let scenario = Scenario::parse("guide.toml", text.ok_or("no scenario in the guide")?)?;
    assert_eq!(scenario.warnings(), []);
    assert_eq!(scenario.study()?.grid.len(), 91);
    Ok(())
}

#[test]
fn the_templates_parse() -> Outcome {
    for kind in [Template::Pendulum, Template::Oscillator, Template::Blank] {
        let scenario = Scenario::parse("new.toml", template(kind))?;
        assert_eq!(scenario.warnings(), []);
        scenario.study()?;
    }
    Ok(())
}

#[test]
fn every_optional_line_of_the_blank_scenario_is_valid() -> Outcome {
    // the lines that are commented out, switched on, but for those that belong to
    // discrete time, another law or another number of states
    let others = ["dt", "u", "x0", "P0", "start", "n_max", "lambda", "window", "innovation"];
    let prose = |key: &str| key.contains([' ', '\'']) || others.contains(&key);
    let text: String = template(Template::Blank)
        .lines()
        .map(|line| match line.strip_prefix("# ") {
            Some(code) if code.starts_with('[') => code,
            Some(code) => match code.split_once(" = ") {
                Some((key, _)) if prose(key) => line,
                Some(_) => code,
                None => line,
            },
            None => line,
        })
        .filter(|line| !line.starts_with("delay "))
        .flat_map(|line| [line, "\n"])
        .collect();
    let scenario = Scenario::parse("blank.toml", &text)?;
    let study = scenario.study()?;
    assert_eq!(study.delays, [0.0, 0.002]);
    assert_eq!(study.surroundings.pade_order, 4);
    assert!(study.surroundings.input.is_some());
    assert!(study.surroundings.disturbance.is_some());
    assert!(study.surroundings.controller.is_some());
    assert_eq!(study.bank.labels.len(), 3);
    assert_eq!(study.bank.Q, Some(mat![[1.0]]));
    Ok(())
}

#[test]
fn the_pendulum_is_the_pendulum() -> Outcome {
    let scenario = Scenario::parse("pendulum.toml", template(Template::Pendulum))?;
    let family = scenario.family();
    assert_eq!(family.time(), Time::Continuous);
    assert_eq!(family.names().inputs, ["force"]);
    let (length, mass, bob, gravity, friction, spring) = (0.9, 1.0, 0.75, 9.8, 0.1, 0.15);
    let plant = family.plant(&family.theta_with(&[("L", length)])?)?;
    let lm = length * mass;
    let want = mat![
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
        [-spring / mass, -bob * gravity / mass, -friction / mass, 0.0],
        [spring / lm, (bob + mass) * gravity / lm, friction / lm, 0.0],
    ];
    assert_eq!(plant.A, want);
    assert_eq!(plant.B, mat![[0.0], [0.0], [1.0 / mass], [-1.0 / lm]]);
    assert_eq!(plant.R, mat![[1e-7, 0.0], [0.0, 1e-8]]);
    let study = scenario.study()?;
    assert_eq!(study.bank.models, [[1.025], [1.287], [1.526], [1.778]]);
    assert_eq!(study.bank.observer, ObserverKind::KalmanBucy);
    assert!(study.bank.shaping);
    assert_eq!(study.grid.axes()[0].1, Axis::Linear { from: 0.9, to: 1.9, points: 401 });
    assert_eq!(study.memory_limit, 4 << 30);
    let k = study.surroundings.controller.ok_or("no controller")?;
    assert_eq!(k.A[(3, 3)], -10.5863);
    assert_eq!(k.D, mat![[0.0, 0.0]]);
    Ok(())
}

#[test]
fn matrices_have_short_forms() -> Outcome {
    let rows = spring(
        "time = \"continuous\"\nR = [[0.01]]\ndisturbances = [\"w\"]\nG = [[0], [1]]\nQ = [[1]]",
        "",
    )?;
    let short = spring(CONTINUOUS, "")?;
    let theta = [2.0, 0.5];
    assert_eq!(rows.family().plant(&theta)?, short.family().plant(&theta)?);
    // a number and a list stand for a diagonal
    let two = |q: &str| {
        spring(
            &format!(
                "time = \"continuous\"\nR = 0.01\ndisturbances = [\"w\", \"z\"]\n\
                 G = [[1, 0], [0, 1]]\nQ = {q}"
            ),
            "",
        )
    };
    let covariance =
        |q: &str| -> Result<_, Box<dyn Error>> { Ok(two(q)?.family().plant(&theta)?.Q) };
    assert_eq!(covariance("3")?, mat![[3.0, 0.0], [0.0, 3.0]]);
    assert_eq!(covariance("[3, \"c\"]")?, mat![[3.0, 0.0], [0.0, 0.5]]);
    assert_eq!(covariance("[[3, 1], [1, \"k\"]]")?, mat![[3.0, 1.0], [1.0, 2.0]]);
    Ok(())
}

#[test]
fn derived_parameters_follow() -> Outcome {
    let text = "format = 1\n[plant]\ntime = \"discrete\"\ndt = 0.5\nstates = [\"x\"]\n\
                outputs = [\"x\"]\nA = \"d\"\nC = 1\nR = 1\n[plant.parameters]\n\
                z = 4\nd = \"a0/z\"\na = 2\n\"\u{3b8}\" = \"a*d\"\na0 = 1\n";
    // in the order of the file, each from those above it
    let wrong = Scenario::parse("s", text).map(|_| ()).map_err(|e| e.to_string());
    assert!(wrong.is_err_and(|e| e.contains("no parameter is called 'a0'")));
    let text = text.replace("a0/z", "1/z").replace("A = \"d\"", "A = \"\u{3b8}\"");
    let scenario = Scenario::parse("s", &text)?;
    let family = scenario.family();
    let names: Vec<&str> = family.parameters().iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["z", "a", "a0"]);
    assert_eq!(family.time(), Time::Discrete { dt: 0.5 });
    assert_eq!(family.plant(&family.theta_with(&[])?)?.A, mat![[0.5]]);
    assert_eq!(family.plant(&family.theta_with(&[("z", 8.0)])?)?.A, mat![[0.25]]);
    let [unused] = scenario.warnings() else { return Err("one warning".into()) };
    assert_eq!((unused.key.as_str(), unused.line), ("plant.parameters.a0", 15));
    Ok(())
}

#[test]
fn a_plant_without_a_value_is_an_error_of_the_entry() -> Outcome {
    let scenario = spring(&CONTINUOUS.replace("G = [0, 1]", "G = [0, \"1/k\"]"), "")?;
    let Err(error) = scenario.family().plant(&[0.0, 1.0]) else { return Err("a value".into()) };
    assert_eq!(error, mmae::Error::NonFinite { what: "G".into(), row: 1, col: 0 });
    assert!(scenario.family().plant(&[1.0]).is_err());
    let located = scenario.explain(error).to_string();
    assert!(located.starts_with("spring.toml:10:9: plant.G[1][0]: "), "{located}");
    Ok(())
}

#[test]
fn surroundings_are_read() -> Outcome {
    let plant = "time = \"continuous\"\nR = 0.01\ndisturbances = [\"w\"]\nG = [0, 1]\n\
                 inputs = [\"u\"]\nB = [0, 1]";
    let rest = "[disturbance]\nstates = [\"a\", \"b\"]\nA = [[0, 1], [-1, \"-sqrt(2)\"]]\n\
                B = [0, 1]\nC = [1, 0]\nQ = 4\n\
                [input]\nstates = [\"r\"]\nA = -1\nB = [1, 2]\nC = 1\n\
                [controller]\nD = -0.5\n[actuator]\ndelay = 0.01\npade = 6\n\
                [bank]\nmodels = { k = [1] }\nshaping = false\nQ = 2\n[eip]\ngrid = { k = [1] }\n";
    let scenario = spring(plant, rest)?;
    let around = scenario.surroundings();
    assert_eq!(around.pade_order, 6);
    let filter = around.disturbance.as_ref().ok_or("no filter")?;
    assert_eq!(filter.A, mat![[0.0, 1.0], [-1.0, -libm::sqrt(2.0)]]);
    assert_eq!(filter.B, mat![[0.0], [1.0]]);
    assert_eq!(filter.Q, mat![[4.0]]);
    assert_eq!(filter.states, ["a", "b"]);
    let input = around.input.as_ref().ok_or("no input")?;
    assert_eq!(input.B, mat![[1.0, 2.0]]);
    assert_eq!(input.Q, mat![[1.0, 0.0], [0.0, 1.0]]);
    let k = around.controller.as_ref().ok_or("no controller")?;
    assert_eq!((k.A.nrows(), k.B.ncols(), k.C.nrows()), (0, 1, 1));
    assert_eq!(k.D, mat![[-0.5]]);
    let study = scenario.study()?;
    assert_eq!(study.delays, [0.01]);
    assert!(!study.bank.shaping);
    Ok(())
}

#[test]
fn built_in_families_can_be_named() -> Outcome {
    let text = "format = 1\n[plant]\nfamily = \"pendulum\"\n[plant.parameters]\nm = 0.5\n\
                [bank]\nmodels = { L = [1.025, 1.287] }\n\
                [eip]\ngrid = { L = { from = 0.9, to = 1.9, points = 5 } }\n";
    let scenario = Scenario::parse("s", text)?;
    let (family, study) = (scenario.family(), scenario.study()?);
    let plant = family.plant(&family.theta_with(&[("L", 1.0)])?)?;
    assert_eq!(plant.A[(3, 1)], 1.5 * 9.8);
    assert!(study.bank.shaping);
    assert!(study.surroundings.controller.is_some());
    // its own filter stands before the one that comes along
    let own = format!("{text}[disturbance]\nstates = [\"d\"]\nA = -2\nB = 1\nC = 1\n");
    let filter = Scenario::parse("s", &own)?.surroundings().disturbance.clone();
    assert_eq!(filter.ok_or("no filter")?.A, mat![[-2.0]]);
    for name in mmae::model::systems::NAMES {
        let text = format!("format = 1\n[plant]\nfamily = \"{name}\"\n");
        assert_eq!(Scenario::parse("s", &text)?.warnings(), []);
    }
    for (find, with, message) in [
        (
            "pendulum",
            "pendulm",
            "s:3:10: plant.family: no choice is called 'pendulm': did you mean",
        ),
        (
            "\"\n[plant.p",
            "\"\nA = 1\n[plant.p",
            "s:4:5: plant.A: a built-in family has its own: remove",
        ),
        (
            "m = 0.5",
            "l = 0.5",
            "s:5:1: plant.parameters.l: the family has no such parameter: did you",
        ),
        (
            "m = 0.5",
            "M = 2\nm = \"M\"",
            "s:6:1: plant.parameters.m: a parameter of a built-in family",
        ),
        ("m = 0.5", "m = -0.5\nM = 0", "s:2:1: plant.A"),
    ] {
        let error = Scenario::parse("s", &text.replace(find, with)).map_err(|e| e.to_string());
        assert!(error.as_ref().is_err_and(|e| e.starts_with(message)), "{error:?}");
    }
    Ok(())
}

#[test]
fn models_may_be_columns_or_rows() -> Outcome {
    let models = |text: &str| -> Result<_, Box<dyn Error>> {
        let scenario = study(&format!("models = {text}"), "")?;
        let bank = scenario.study()?.bank;
        Ok((bank.parameters, bank.models))
    };
    let want = (vec!["k".to_string(), "c".to_string()], vec![vec![1.0, 0.1], vec![2.0, 0.2]]);
    assert_eq!(models("{ k = [1, 2], c = [0.1, 0.2] }")?, want);
    assert_eq!(models("[{ k = 1, c = 0.1 }, { c = 0.2, k = 2 }]")?, want);
    let range = models("{ k = { from = 1, to = 2, points = 3 } }")?;
    assert_eq!(range.1, [[1.0], [1.5], [2.0]]);
    let tables = "[[bank.models]]\nk = 1\nc = 0.1\n[[bank.models]]\nk = 2\nc = 0.2\n";
    let text = format!("{tables}[eip]\ngrid = {{ k = [1] }}");
    let bank = spring(CONTINUOUS, &text)?.study()?.bank;
    assert_eq!((bank.parameters, bank.models), want);
    Ok(())
}

#[test]
fn bank_settings_are_read() -> Outcome {
    let scenario = study("observer = \"krener\"\nlabels = [\"a\", \"b\"]\nQ = 3\nR = [4]", "")?;
    let bank = scenario.study()?.bank;
    assert_eq!(bank.observer, ObserverKind::Krener);
    assert_eq!(bank.labels, ["a", "b"]);
    assert_eq!((bank.Q, bank.R), (Some(mat![[3.0]]), Some(mat![[4.0]])));
    assert!(!bank.shaping);
    Ok(())
}

#[test]
fn grids_may_be_ranges_steps_lists_and_products() -> Outcome {
    let axis = |text: &str| -> Result<Axis, Box<dyn Error>> {
        let scenario = study("", &format!("grid = {{ k = {text} }}"))?;
        Ok(scenario.study()?.grid.axes()[0].1.clone())
    };
    let linear = |from, to, points| Axis::Linear { from, to, points };
    assert_eq!(axis("{ from = 0.9, to = 1.9, points = 401 }")?, linear(0.9, 1.9, 401));
    // ten steps of 0.1, whose sum is not 1: both ends are exact all the same
    let steps = axis("{ from = 0.9, to = 1.9, step = 0.1 }")?;
    assert_eq!(steps, linear(0.9, 1.9, 11));
    assert_eq!((steps.value(0), steps.value(10)), (0.9, 1.9));
    assert_eq!(axis("{ from = 0, to = 3, step = 1e-3 }")?, linear(0.0, 3.0, 3001));
    assert_eq!(axis("{ from = 1, to = 1, points = 1 }")?, linear(1.0, 1.0, 1));
    assert_eq!(
        axis("{ from = 1, to = 100, points = 3, scale = \"log\" }")?,
        Axis::Logarithmic { from: 1.0, to: 100.0, points: 3 }
    );
    assert_eq!(axis("[1, 2.5, 4]")?, Axis::Explicit(vec![1.0, 2.5, 4.0]));
    let product = "grid = { k = [1, 2], c = { from = 0.1, to = 0.2, points = 3 } }";
    let grid = study("", product)?.study()?.grid.clone();
    assert_eq!(grid.len(), 6);
    assert_eq!(grid.point(5), [2.0, 0.2]);
    assert_eq!(grid.axes()[0].0, "k");
    Ok(())
}

#[test]
fn study_settings_are_read() -> Outcome {
    let settings = |text: &str| study("", text);
    let scenario = settings("")?;
    let default = scenario.study()?;
    assert_eq!(default.convention, Convention::Ito);
    assert_eq!((default.verify, default.method), (Verify::Auto, None));
    assert_eq!(default.memory_limit, 4 << 30);
    assert!(default.delays.is_empty());
    assert_eq!(
        settings("convention = \"baram\"\ndt = 0.01")?.study()?.convention,
        Convention::Baram { dt: 0.01 }
    );
    assert_eq!(settings("convention = \"identity\"")?.study()?.convention, Convention::Identity);
    assert_eq!(settings("verify = \"all\"")?.study()?.verify, Verify::All);
    assert_eq!(settings("verify = \"none\"")?.study()?.verify, Verify::None);
    assert_eq!(settings("method = \"modal\"")?.study()?.method, Some(Method::Modal));
    assert_eq!(settings("method = \"doubling\"")?.study()?.method, Some(Method::Doubling));
    assert_eq!(settings("method = \"auto\"")?.study()?.method, None);
    assert_eq!(settings("delays = [0, 2e-3]")?.study()?.delays, [0.0, 0.002]);
    for (text, bytes) in
        [("1000", 1000), ("\"2 MiB\"", 2 << 20), ("\"3GB\"", 3_000_000_000), ("\"7 B\"", 7)]
    {
        let scenario = settings(&format!("memory_limit = {text}"))?;
        assert_eq!(scenario.study()?.memory_limit, bytes);
    }
    Ok(())
}

#[test]
fn discrete_plants_have_discrete_defaults() -> Outcome {
    let plant =
        "time = \"discrete\"\ndt = 0.1\nR = 0.01\ndisturbances = [\"w\"]\nG = [0, 1]\nQ = 1";
    let scenario =
        spring(plant, "[bank]\nmodels = { k = [0.1] }\n[eip]\ngrid = { k = [0.1, 0.2] }")?;
    let study = scenario.study()?;
    assert_eq!(study.bank.observer, ObserverKind::Kalman);
    assert_eq!(study.convention, Convention::Baram { dt: 0.1 });
    Ok(())
}

#[test]
fn a_missing_format_is_a_warning() -> Outcome {
    let text = template(Template::Pendulum).replace("format = 1\n", "");
    let scenario = Scenario::parse("s.toml", &text)?;
    let [warning] = scenario.warnings() else { return Err("one warning".into()) };
    assert_eq!(
        warning.to_string(),
        "s.toml:1:1: format: missing, taken for 1: add format = 1 at the top"
    );
    Ok(())
}

#[test]
fn byte_order_mark_and_carriage_returns_are_accepted() -> Outcome {
    let text = template(Template::Pendulum).replace('\n', "\r\n");
    let scenario = Scenario::parse("s.toml", &format!("\u{feff}{text}"))?;
    assert_eq!(scenario.warnings(), []);
    Ok(())
}

/// What changes nothing is said, at its place.
#[test]
fn keys_without_effect_are_warned_of() -> Outcome {
    let text = r#"
        format = 1
        [plant]
        time = "continuous"
        states = ["x"]
        inputs = ["u"]
        disturbances = ["w"]
        outputs = ["x"]
        A = -1
        B = 1
        G = 1
        C = 1
        Q = 2
        R = 0.1
        [plant.parameters]
        [disturbance]
        states = ["f"]
        A = -1
        B = 1
        C = 1
        [actuator]
        delay = 0.1
    "#;
    let scenario = Scenario::parse("s.toml", text)?;
    let found: Vec<(usize, &str)> =
        scenario.warnings().iter().map(|w| (w.line, w.key.as_str())).collect();
    assert_eq!(found, [(13, "plant.Q"), (22, "actuator.delay")]);
    Ok(())
}
