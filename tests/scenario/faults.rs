//! What is wrong with a file, where, and what to do about it.

use mmae::scenario::{Error, Scenario};

/// A valid scenario with a line of everything.
const BASE: &str = r#"format = 1
title = "Spring"
[plant]
time = "continuous"
states = ["x", "v"]
inputs = ["u"]
disturbances = ["w"]
outputs = ["x"]
A = [[0, 1], ["-k/mass", "-c/mass"]]
B = [0, "1/mass"]
G = [[0], ["1/mass"]]
C = [1, 0]
Q = 2.0
R = 0.01
[plant.parameters]
mass = 1.5
k = 2
c = 0.5
kc = "k*c"
[disturbance]
states = ["d"]
A = -1
B = 1
C = 1
Q = 1
[controller]
A = [[-1]]
B = [1]
C = [-0.5]
D = 0
[actuator]
pade = 4
[bank]
observer = "kalman-bucy"
models = { k = [1, 2, 3] }
labels = ["a", "b", "c"]
shaping = true
[eip]
grid = { k = { from = 0.5, to = 4, points = 36 } }
convention = "ito"
delays = [0, 0.01]
"#;

/// Replaces `find` in the base by `with`, whose `@` marks where the diagnostic
/// must point, and checks its key and parts of its message and remedy.
#[track_caller]
fn check(find: &str, with: &str, key: &str, message: &str, remedy: &str) {
    assert_eq!(BASE.matches(find).count(), 1, "'{find}' must be in the base once");
    let marked = BASE.replace(find, with).replace("# kc\n", "").replace("kc = \"k*c\"\n", "");
    let at = marked.find('@').expect("a mark");
    let text = marked.replace('@', "");
    let line = marked[..at].matches('\n').count() + 1;
    let column = at - marked[..at].rfind('\n').map_or(0, |n| n + 1) + 1;
    let error = match Scenario::parse("f.toml", &text) {
        Ok(_) => panic!("'{with}' passes"),
        Err(error) => error,
    };
    let shown = error.to_string();
    let [first, ..] = error.diagnostics() else { panic!("no diagnostics: {shown}") };
    assert_eq!((first.line, first.column), (line, column), "{with}: {shown}");
    assert_eq!(first.key, key, "{shown}");
    assert!(first.message.contains(message), "message of {shown}");
    assert!(first.remedy.contains(remedy), "remedy of {shown}");
    assert!(shown.starts_with(&format!("f.toml:{line}:{column}: ")), "{shown}");
    assert_eq!(shown.lines().count(), error.diagnostics().len(), "{shown}");
}

#[test]
fn the_base_is_valid() -> Result<(), Error> {
    let scenario = Scenario::parse("f.toml", BASE)?;
    let keys: Vec<&str> = scenario.warnings().iter().map(|w| w.key.as_str()).collect();
    assert_eq!(keys, ["plant.Q", "plant.parameters.kc"]);
    scenario.study().map(|_| ())
}

#[test]
fn keys() {
    check("labels", "@lables", "bank.lables", "unknown key", "did you mean 'labels'?");
    check("title", "@tilte", "tilte", "unknown key in the top", "did you mean 'title'?");
    check("labels", "@prioir", "bank.prioir", "unknown key in bank", "did you mean 'prior'?");
    check("labels", "@delays", "bank.delays", "unknown key", "belongs in [eip]");
    check("from = 0.5", "@form = 0.5", "eip.grid.k.form", "unknown key", "mean 'from'?");
    check("[actuator]", "[@actuatr]", "actuatr", "unknown key", "mean 'actuator'?");
}

#[test]
fn syntax() {
    check("k = 2\n", "k = 2\n@k = 3\n", "k", "duplicate key", "keep one");
    check("[bank]\n", "[bank]\n[@bank]\n", "bank", "duplicate key", "keep one");
    check("R = 0.01", "R = @", "", "TOML", "toml.io");
    check("title = \"Spring\"", "title = \"Spring@", "", "TOML", "toml.io");
    check("D = 0", "D @0", "", "key with no value", "toml.io");
}

#[test]
fn the_top() {
    check("format = 1", "format = @2", "format", "needs a newer mmae", "update mmae");
    check("format = 1", "format = @0", "format", "0 is too small", "at least 1");
    check("format = 1", "format = @\"1\"", "format", "string", "write 1 without quotes");
    check("\"Spring\"", "@7", "title", "an integer where a string", "write a string");
}

#[test]
fn plant_names() {
    check("[\"x\", \"v\"]", "[\"x\", @\"x\"]", "plant.states[1]", "given twice", "its own name");
    check("[\"x\", \"v\"]", "@\"x\"", "plant.states", "list of names", "list of names");
    check("[\"x\", \"v\"]", "@[]", "plant.states", "empty", "name them");
    check("[\"x\", \"v\"]", "[\"x\", @\" \"]", "plant.states[1]", "not a name", "printable");
    check("[\"x\", \"v\"]", "[\"x\", @2]", "plant.states[1]", "an integer", "a string");
    check("\"continuous\"", "@\"continous\"", "plant.time", "no choice", "'continuous'?");
    check("\"continuous\"", "\"continuous\"\ndt = @1", "plant.dt", "not sampled", "remove it");
    check("\"continuous\"", "\"discrete\"\ndt = @-0.5", "plant.dt", "-0.5", "positive seconds");
    check("\"continuous\"", "\"discrete\"\ndt = @0", "plant.dt", "not a sampling", "positive");
    check("\"continuous\"", "\"discrete\"\ndt = @nan", "plant.dt", "nan", "finite number");
    check(
        "[plant]\ntime = \"continuous\"",
        "@[plant]\ntime = \"discrete\"",
        "plant.dt",
        "missing",
        "seconds",
    );
    check("[plant]\ntime = \"continuous\"", "@[plant]", "plant.time", "missing", "continuous");
}

#[test]
fn parameters() {
    check(
        "mass = 1.5",
        "@sin = 1.5\nmass = 1",
        "plant.parameters.sin",
        "is a function",
        "another name",
    );
    check(
        "mass = 1.5",
        "@pi = 1.5\nmass = 1",
        "plant.parameters.pi",
        "is a constant",
        "another name",
    );
    check(
        "mass = 1.5",
        "@\"a b\" = 1.5\nmass = 1",
        "plant.parameters.a b",
        "not a name",
        "letters",
    );
    check(
        "mass = 1.5",
        "mass = @[1.5]",
        "plant.parameters.mass",
        "a list",
        "number or an expression",
    );
    check(
        "mass = 1.5",
        "mass = \"2*@k\"",
        "plant.parameters.mass",
        "no parameter is called 'k'",
        "above it",
    );
    check(
        "mass = 1.5",
        "@mass = \"1/0\"",
        "plant.parameters.mass",
        "not a finite",
        "division by zero",
    );
    check(
        "mass = 1.5",
        "mass = @inf",
        "plant.parameters.mass",
        "inf is not a finite",
        "finite number",
    );
    check(
        "mass = 1.5",
        "mass = @-nan",
        "plant.parameters.mass",
        "-nan is not a finite",
        "finite number",
    );
    check(
        "mass = 1.5",
        "mass = @1e999",
        "plant.parameters.mass",
        "1e999 is not a finite",
        "finite number",
    );
    check(
        "mass = 1.5",
        "mass = @9223372036854775808",
        "plant.parameters.mass",
        "64 bits",
        "decimal point",
    );
    check(
        "mass = 1.5",
        "mass = @true",
        "plant.parameters.mass",
        "true where",
        "number or an expression",
    );
    check("mass = 1.5", "mass = @1979-05-27", "plant.parameters.mass", "a date", "number");
}

#[test]
fn expressions() {
    check(
        "\"-k/mass\"",
        "\"-@q/mass\"",
        "plant.A[1][0]",
        "in \"-q/mass\": no parameter is called 'q'",
        "add it under [plant.parameters]",
    );
    check("\"-k/mass\"", "\"-k/@mas\"", "plant.A[1][0]", "'mas'", "did you mean 'mass'?");
    check("\"-k/mass\"", "'-k/@mas'", "plant.A[1][0]", "'mas'", "did you mean 'mass'?");
    check(
        "\"-k/mass\"",
        "\"\"\"\n-k/\n  @mas\"\"\"",
        "plant.A[1][0]",
        "'mas'",
        "did you mean 'mass'?",
    );
    // with an escape the place inside is not known: the string itself
    check("\"-k/mass\"", "@\"-k/\\u006das\"", "plant.A[1][0]", "'mas'", "did you mean 'mass'?");
    check(
        "\"-k/mass\"",
        "@\"-k/(mass-1.5)\"",
        "plant.A[1][0]",
        "nominal values (mass = 1.5, k = 2)",
        "division by zero",
    );
    check("\"-k/mass\"", "@\"1/0\"", "plant.A[1][0]", "not a finite number", "division by zero");
    check("\"-k/mass\"", "@true", "plant.A[1][0]", "true", "number or an expression");
    check("\"-k/mass\"", "@[1]", "plant.A[1][0]", "a list", "number or an expression");
}

#[test]
fn matrices() {
    check(
        "[[0, 1], [\"-k/mass\", \"-c/mass\"]]",
        "[[0, 1], @[\"-k/mass\"]]",
        "plant.A[1]",
        "1 entries, row 0 has 2",
        "every row",
    );
    check(
        "[[0, 1], [\"-k/mass\", \"-c/mass\"]]",
        "[[0, 1], @2]",
        "plant.A[1]",
        "where a row",
        "brackets",
    );
    check(
        "[[0, 1], [\"-k/mass\", \"-c/mass\"]]",
        "@[[0, 1]]",
        "plant.A",
        "1 by 2, wanted 2 (states) by 2 (states)",
        "row",
    );
    check("[[0, 1], [\"-k/mass\", \"-c/mass\"]]", "@[0, 1]", "plant.A", "a list of 2", "rows");
    check("[[0, 1], [\"-k/mass\", \"-c/mass\"]]", "@[]", "plant.A", "empty", "rows");
    check("[[0, 1], [\"-k/mass\", \"-c/mass\"]]", "@0", "plant.A", "a single entry", "rows");
    check(
        "[[0], [\"1/mass\"]]",
        "@[[0, \"1/mass\"]]",
        "plant.G",
        "1 by 2, wanted 2 (states) by 1 (disturbances)",
        "transpose",
    );
    check(
        "B = [0, \"1/mass\"]",
        "B = @[0, 0, \"1/mass\"]",
        "plant.B",
        "3 by 1, wanted 2 (states) by 1",
        "",
    );
    check("C = [1, 0]", "C = @[[], []]", "plant.C", "2 by 0", "");
    check(
        "Q = 2.0",
        "Q = @[1, 2]",
        "plant.Q",
        "a diagonal of 2 entries, wanted 1 (disturbances)",
        "",
    );
    check("R = 0.01", "R = @[[1, 0], [0, 1]]", "plant.R", "2 by 2, wanted 1 (outputs)", "");
}

#[test]
fn covariances_are_checked_by_the_engine() {
    check("R = 0.01", "R = @0", "plant.R", "not positive definite", "raise its diagonal");
    check("Q = 2.0", "Q = @-1", "plant.Q", "not positive semidefinite", "negative");
    check(
        "states = [\"d\"]\nA = -1\nB = 1\nC = 1\nQ = 1",
        "states = [\"d\"]\nA = -1\nB = 1\nC = 1\nQ = @-1",
        "disturbance.Q",
        "not positive semidefinite",
        "",
    );
}

#[test]
fn channels_and_matrices_belong_together() {
    let head = |line: &str| -> String {
        let start = BASE.find("[plant]").unwrap_or(0);
        let end = BASE.find(line).map_or(0, |n| n + line.len());
        BASE[start..end].to_string()
    };
    let block = head("B = ");
    let without = block.replace("inputs = [\"u\"]\n", "");
    check(&block, &format!("{without}@"), "plant.B", "the plant has no inputs", "or remove B");
    let block = head("R = 0.01\n");
    for (line, key, remedy) in [
        ("R = 0.01\n", "plant.R", "over outputs"),
        ("B = [0, \"1/mass\"]\n", "plant.B", "states by inputs"),
        ("outputs = [\"x\"]\n", "plant.outputs", "name them"),
    ] {
        check(&block, &format!("@{}", block.replace(line, "")), key, "missing", remedy);
    }
}

#[test]
fn filters_and_controllers() {
    check("[\"d\"]", "@[]", "disturbance.states", "empty", "at least one");
    check(
        "C = 1\n",
        "C = @[1, 2]\n",
        "disturbance.C",
        "2 by 1, wanted 1 (disturbances) by 1 (filter",
        "",
    );
    check(
        "C = 1\n",
        "C = \"@mass\"\n",
        "disturbance.C",
        "\'mass\'",
        "do not follow the plant's parameters",
    );
    check("A = -1\n", "A = @\"1/0\"\n", "disturbance.A[0][0]", "not a finite", "division by zero");
    check("A = -1\n", "A = @[[-1, 0], [0, 1]]\n", "disturbance.A", "2 by 2, wanted 1", "names");
    check("[[-1]]", "@[[-1, 0]]", "controller.A", "1 by 2, not square", "as many rows");
    check(
        "[[-1]]",
        "[[\"@k\"]]",
        "controller.A[0][0]",
        "'k'",
        "do not follow the plant's parameters",
    );
    check("B = [1]", "B = @[[1, 2]]", "controller.B", "1 by 2", "names");
    let block = "[controller]\nA = [[-1]]\nB = [1]\nC = [-0.5]\n";
    let without = "@[controller]\nA = [[-1]]\nB = [1]\n";
    check(block, without, "controller.C", "missing", "inputs by controller states");
    check("pade = 4", "pade = @0", "actuator.pade", "too small", "at least 1");
    check("pade = 4", "pade = @11", "actuator.pade", "too high", "at most 10");
    check("pade = 4", "pade = @2.0", "actuator.pade", "decimal point", "whole number");
    check("pade = 4", "delay = @-1", "actuator.delay", "prediction", "0 s or more");
    check("pade = 4", "delay = @1", "actuator.delay", "both", "keep");
}

#[test]
fn banks() {
    check("\"kalman-bucy\"", "@\"kalmanbucy\"", "bank.observer", "no choice", "'kalman-bucy'?");
    check(
        "models = { k = [1, 2, 3] }",
        "models = { @q = [1, 2, 3] }",
        "bank.models.q",
        "'q'",
        "mass, k, c",
    );
    check("models = { k = [1, 2, 3] }", "models = @{ }", "bank.models", "empty", "at least one");
    check("models = { k = [1, 2, 3] }", "models = @[]", "bank.models", "empty", "at least one");
    check(
        "models = { k = [1, 2, 3] }",
        "models = { k = @[] }",
        "bank.models.k",
        "empty",
        "at least one",
    );
    check(
        "models = { k = [1, 2, 3] }",
        "models = { k = [1, @\"2\", 3] }",
        "bank.models.k[1]",
        "the string",
        "2 without quotes",
    );
    check(
        "models = { k = [1, 2, 3] }",
        "models = { k = [1, 2, 3], c = @[1] }",
        "bank.models.c",
        "1 values, but k has 3",
        "one value a model",
    );
    check(
        "models = { k = [1, 2, 3] }",
        "models = [{ k = 1 }, @{ c = 2 }]",
        "bank.models[1]",
        "the model has c",
        "give k",
    );
    check(
        "models = { k = [1, 2, 3] }",
        "models = [{ k = 1 }, { @kk = 2 }]",
        "bank.models[1].kk",
        "'kk'",
        "",
    );
    check("models = { k = [1, 2, 3] }", "models = [@{ }]", "bank.models[0]", "no parameters", "");
    check("models = { k = [1, 2, 3] }", "models = @3", "bank.models", "an integer", "lists");
    check("[\"a\", \"b\", \"c\"]", "@[\"a\", \"b\"]", "bank.labels", "2 labels for 3 models", "");
    check("[\"a\", \"b\", \"c\"]", "[\"a\", \"b\", @\"a\"]", "bank.labels[2]", "given twice", "");
    check("shaping = true", "shaping = @1", "bank.shaping", "an integer", "true or false");
    check("shaping = true", "R = @0", "bank.R", "not positive definite", "raise its diagonal");
    check("shaping = true", "Q = @-1", "bank.Q", "not positive semidefinite", "");
    check("shaping = true", "Q = @[1, 1]", "bank.Q", "2 entries, wanted 1", "");
    check("shaping = true", "R = \"@k\"", "bank.R", "'k'", "do not follow");
}

#[test]
fn grids() {
    let range = "{ from = 0.5, to = 4, points = 36 }";
    let grid = |with: &str, key: &str, message: &str, remedy: &str| {
        check(range, with, &format!("eip.grid.k{key}"), message, remedy);
    };
    grid("{ from = @4, to = 0.5, points = 36 }", ".from", "runs down", "from = 0.5, to = 4");
    grid("{ from = 1, to = 4, step = @0 }", ".step", "leads nowhere", "positive");
    grid("{ from = 1, to = 4, step = @-0.1 }", ".step", "leads nowhere", "positive");
    grid("{ from = 1, to = 4, step = @5 }", ".step", "does not divide", "step = 3");
    grid(
        "{ from = 1, to = 4, step = @0.7 }",
        ".step",
        "does not divide",
        "0.75 (5 points) and step = 0.6 (6",
    );
    grid("{ from = 1, to = 4, step = @1e-300 }", ".step", "too many", "larger");
    grid("{ from = 1, to = 4, points = 3, step = @1 }", ".step", "both", "keep one");
    grid("@{ from = 1, to = 4 }", "", "neither points nor step", "points = 101");
    grid("{ from = 1, to = 4, points = @1 }", ".points", "both ends", "at least 2");
    grid("{ from = 1, to = 4, points = @0 }", ".points", "too small", "at least 1");
    grid("{ from = 1, to = 4, points = @36.0 }", ".points", "decimal point", "whole number");
    grid("{ from = 1, to = @1, points = 2 }", ".to", "between 1 and itself", "the list [1]");
    grid(
        "{ from = @0, to = 4, points = 2, scale = \"log\" }",
        ".from",
        "cannot start at 0",
        "above 0",
    );
    grid("{ from = 1, to = 4, step = @1, scale = \"log\" }", ".step", "no step", "points");
    grid("{ from = 1, to = 4, points = 2, scale = @\"logg\" }", ".scale", "no choice", "'log'?");
    grid("{ from = @nan, to = 4, points = 2 }", ".from", "nan", "finite");
    grid("{ from = 1, to = @+inf, points = 2 }", ".to", "+inf", "finite");
    grid("{ from = @\"1\", to = 4, points = 2 }", ".from", "the string \"1\"", "1 without quotes");
    grid("[1, 2, @2]", "[2]", "2 after 2", "increasing");
    grid("@[]", "", "empty", "at least one");
    grid("@7", "", "an integer", "a range { from");
    check("grid = { k", "grid = { @kk", "eip.grid.kk", "'kk'", "mass, k, c");
    let all = "{ k = { from = 0.5, to = 4, points = 36 } }";
    check(all, "@{ }", "eip.grid", "no parameters", "points = 401");
    check(all, "@5", "eip.grid", "an integer", "a table");
}

#[test]
fn settings() {
    let block = "[eip]\ngrid = { k = { from = 0.5, to = 4, points = 36 } }\nconvention = \"ito\"";
    let with = format!("@{}", block.replace("ito", "baram"));
    check(block, &with, "eip.dt", "missing", "sampling interval");
    check("\"ito\"", "\"baram\"\ndt = @0", "eip.dt", "not a sampling", "positive");
    check("\"ito\"", "\"ito\"\ndt = @0.1", "eip.dt", "nothing is sampled", "remove");
    check("\"ito\"", "@\"itto\"", "eip.convention", "no choice", "'ito'?");
    check("[0, 0.01]", "[0, @-0.01]", "eip.delays[1]", "prediction", "0 s");
    check("[0, 0.01]", "[0, 0.01, @0.0]", "eip.delays[2]", "given twice", "keep one");
    check("[0, 0.01]", "@0.01", "eip.delays", "decimal point", "list of delays");
    check("[0, 0.01]", "[0]\nverify = @\"al\"", "eip.verify", "no choice", "'all'?");
    check(
        "[0, 0.01]",
        "[0]\nmethod = @\"schur\"",
        "eip.method",
        "no choice",
        "auto, doubling, modal",
    );
    check(
        "[0, 0.01]",
        "[0]\nmemory_limit = @\"4 gibbon\"",
        "eip.memory_limit",
        "not an amount",
        "4 GiB",
    );
    check("[0, 0.01]", "[0]\nmemory_limit = @-1", "eip.memory_limit", "too small", "at least 1");
}

#[test]
fn derived_parameters_cannot_be_varied() {
    let text = BASE.replace("grid = { k =", "grid = { kc =");
    let error = Scenario::parse("f.toml", &text).map(|_| ()).map_err(|e| e.to_string());
    let want = "f.toml:39:10: eip.grid.kc: 'kc' follows from k, c: vary one of those, or make it a \
                number of its own";
    assert_eq!(error, Err(want.to_string()));
}

#[test]
fn missing_tables_are_named() -> Result<(), Error> {
    let error = Scenario::parse("f", "format = 1").map(|_| ()).map_err(|e| e.to_string());
    assert!(error.is_err_and(|e| e.starts_with("f:1:1: plant: missing: add [plant]")));
    let without = |table: &str| {
        let start = BASE.find(table).unwrap_or(0);
        let end = BASE[start + 1..].find("\n[").map_or(BASE.len(), |n| start + 1 + n);
        Scenario::parse("f", &format!("{}{}", &BASE[..start], &BASE[end..]))
    };
    for table in ["bank", "eip"] {
        let scenario = without(&format!("[{table}]"))?;
        let Err(error) = scenario.study() else { panic!("a study without {table}") };
        assert!(error.to_string().starts_with(&format!("f:1:1: {table}: missing: add [{table}]")));
    }
    for table in ["[disturbance]", "[controller]", "[actuator]"] {
        without(table).map(|_| ()).or_else(|e| match table {
            // the bank says that it carries the filter
            "[disturbance]" if e.diagnostics()[0].key == "bank.shaping" => Ok(()),
            _ => Err(e),
        })?;
    }
    Ok(())
}

#[test]
fn independent_errors_come_together_in_file_order() {
    let text = BASE
        .replace("\"-k/mass\"", "\"-kk/maas\"")
        .replace("R = 0.01", "R = true")
        .replace("points = 36", "points = 0")
        .replace("title", "tite");
    let Err(error) = Scenario::parse("f", &text) else { panic!("it passes") };
    let keys: Vec<&str> = error.diagnostics().iter().map(|d| d.key.as_str()).collect();
    assert_eq!(keys, ["tite", "plant.A[1][0]", "plant.R", "eip.grid.k.points"]);
}

#[test]
fn limits_are_refused_before_anything_is_allocated() {
    let range = "{ from = 0.5, to = 4, points = 36 }";
    for text in [
        BASE.replace(range, "{ from = 0.5, to = 4, points = 1000000000000 }"),
        BASE.replace(range, "{ from = 0.5, to = 4, step = 5e-15 }"),
        BASE.replace("k = [1, 2, 3]", "k = { from = 1, to = 2, points = 9223372036854775807 }"),
    ] {
        // a grid that were allocated would take the machine down
        match Scenario::parse("f", &text).map(|_| ()) {
            Err(Error::Engine { at, source: mmae::Error::Limit { .. } }) => {
                assert!(at.message.contains("bytes"), "{at}");
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn signals() {
    let at_the_end = |text: &str, key: &str, message: &str, remedy: &str| {
        let tail = "convention = \"ito\"\ndelays = [0, 0.01]\n";
        check(tail, &format!("{tail}{text}\n"), key, message, remedy);
    };
    let inputs = |text: &str, key: &str, message: &str, remedy: &str| {
        at_the_end(&format!("[signals.inputs]\n{text}"), key, message, remedy);
    };
    inputs("@y = 1", "signals.inputs.y", "no such channel", "names here are u");
    inputs("u = @\"1\"", "signals.inputs.u", "the string", "without quotes");
    inputs("u = { wave = @\"sqare\" }", "signals.inputs.u.wave", "no choice", "'square'");
    inputs("u = @{ wave = \"sine\" }", "signals.inputs.u.omega", "missing", "needs it");
    let foreign = "u = { wave = \"sine\", omega = 1, @period = 2 }";
    inputs(foreign, "signals.inputs.u.period", "not of this wave", "wave, amplitude, omega");
    let still = "u = @{ wave = \"square\", period = 0 }";
    inputs(still, "signals.inputs.u", "period of", "positive seconds");
    let short = "u = @[1, { wave = \"table\", t = [0, 1], value = [1] }]";
    inputs(short, "signals.inputs.u", "values of", "");
    let twice = "[signals]\ndisturbances = @{ w = 1 }";
    at_the_end(twice, "signals.disturbances", "filter", "one of the two");
}
