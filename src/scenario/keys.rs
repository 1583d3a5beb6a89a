//! Every key of the language, by table.

/// The top of the file.
pub(super) const TOP: &[&str] = &[
    "format",
    "title",
    "plant",
    "disturbance",
    "input",
    "controller",
    "actuator",
    "bank",
    "weighting",
    "truth",
    "signals",
    "run",
    "eip",
    "adaptive",
];
/// `[plant]`.
pub(super) const PLANT: &[&str] = &[
    "family",
    "time",
    "dt",
    "states",
    "inputs",
    "disturbances",
    "outputs",
    "A",
    "B",
    "G",
    "C",
    "Q",
    "R",
    "parameters",
];
/// `[disturbance]` and `[input]`.
pub(super) const FILTER: &[&str] = &["states", "A", "B", "C", "Q"];
/// `[controller]`.
pub(super) const CONTROLLER: &[&str] = &["A", "B", "C", "D"];
/// `[actuator]`.
pub(super) const ACTUATOR: &[&str] = &["delay", "pade", "W"];
/// `W` of `[actuator]`.
pub(super) const BOUND: &[&str] = &["numerator", "denominator", "A", "B", "C", "D"];
/// `[bank]`.
pub(super) const BANK: &[&str] = &[
    "observer", "models", "labels", "shaping", "Q", "R", "gains", "dt", "prior", "x0", "P0",
    "start",
];
/// A model of `[bank]` given by its matrices.
pub(super) const MODEL: &[&str] = &["A", "B", "G", "C", "Q", "R", "x0", "P0"];
/// The same in the letters of Durbin and Koopman.
pub(super) const MODEL_KOOPMAN: &[&str] = &["T", "B", "Z", "Q", "H", "a1", "P1"];
/// `[weighting]`.
pub(super) const WEIGHTING: &[&str] = &[
    "law",
    "n_max",
    "reading",
    "substeps",
    "lambda",
    "tempering",
    "scheme",
    "innovation",
    "floor",
    "forgetting",
    "clip",
    "window",
    "mixing",
    "stay",
    "Pi",
    "threshold",
];
/// `[truth]`.
pub(super) const TRUTH: &[&str] = &["parameters", "model", "x0", "P0"];
/// A parameter of `[truth]` that varies.
pub(super) const COURSE: &[&str] = &["ramp"];
/// `[signals]`.
pub(super) const SIGNALS: &[&str] = &["inputs", "disturbances", "noise"];
/// A term of a signal.
pub(super) const WAVE: &[&str] =
    &["wave", "amplitude", "period", "omega", "phase", "t", "value", "intensity", "decay"];
/// `[run]`.
pub(super) const RUN: &[&str] = &["steps", "duration", "trials", "seed", "every", "measurement"];
/// `[eip]`.
pub(super) const EIP: &[&str] =
    &["grid", "convention", "dt", "delays", "delay_interval", "verify", "method", "memory_limit"];
/// `[adaptive]`.
pub(super) const ADAPTIVE: &[&str] =
    &["dt", "inputs", "outputs", "parameters", "truth", "cases", "observers", "recentre"];
/// `[adaptive.truth]`.
pub(super) const ADAPTIVE_TRUTH: &[&str] =
    &["states", "derivative", "output", "x0", "parameters", "noise", "input_noise"];
/// A case of `[adaptive.cases]`.
pub(super) const ADAPTIVE_CASE: &[&str] = &["parameters", "x0", "noise", "input_noise"];
/// An observer of `[adaptive.observers]`.
pub(super) const ADAPTIVE_OBSERVER: &[&str] = &[
    "states",
    "A",
    "C",
    "K",
    "known",
    "theta",
    "reading",
    "lambda",
    "P0",
    "sigma",
    "R",
    "x0",
    "x0_P0",
    "trace_cap",
    "resets",
    "reset_growth",
    "window",
    "physical",
];
/// A parameter of an observer.
pub(super) const ADAPTIVE_THETA: &[&str] =
    &["column", "entry", "start", "min", "max", "sigma", "truth"];
/// Parameters behind those of an observer.
pub(super) const ADAPTIVE_PHYSICAL: &[&str] = &["start", "map", "truth"];
/// `[adaptive.recentre]`.
pub(super) const ADAPTIVE_RECENTRE: &[&str] =
    &["observer", "parameters", "window", "tolerance", "floor", "most"];
/// A range of one parameter.
pub(super) const RANGE: &[&str] = &["from", "to", "points", "step", "scale"];

/// The table that a key at the wrong place belongs in, when there is one only.
pub(super) fn home(key: &str) -> Option<&'static str> {
    let tables = [
        ("plant", PLANT),
        ("disturbance", FILTER),
        ("controller", CONTROLLER),
        ("actuator", ACTUATOR),
        ("bank", BANK),
        ("weighting", WEIGHTING),
        ("truth", TRUTH),
        ("signals", SIGNALS),
        ("run", RUN),
        ("eip", EIP),
    ];
    let mut homes = tables.iter().filter(|(_, keys)| keys.contains(&key));
    match (homes.next(), homes.next()) {
        (Some((home, _)), None) => Some(home),
        _ => None,
    }
}
