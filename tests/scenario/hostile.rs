//! Input that is no scenario at all.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mmae::scenario::{Error, Scenario, Template, template};
use proptest::prelude::*;

/// Time that this thread has worked, which a busy machine does not stretch;
/// wall-clock time where the system does not say.
fn worked(since: Instant) -> Duration {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = stat.split(' ').next().and_then(|n| n.parse().ok());
    nanoseconds.map_or_else(|| since.elapsed(), Duration::from_nanos)
}

/// The diagnostics as text; panics if the text passes or takes a second.
#[track_caller]
fn refused(text: &str) -> String {
    let since = Instant::now();
    let start = worked(since);
    let error = match Scenario::parse("f.toml", text) {
        Ok(_) => panic!("it passes"),
        Err(error) => error.to_string(),
    };
    let time = worked(since).saturating_sub(start);
    assert!(time < Duration::from_secs(1), "{time:?}");
    error
}

#[test]
fn nothing() {
    for text in ["", "\u{feff}", " \r\n\t\n"] {
        let error = refused(text);
        assert!(error.starts_with("f.toml:1:1: the file is empty: start from"), "{error}");
    }
    assert!(refused("# nothing").starts_with("f.toml:1:1: plant: missing"));
    assert!(refused("a = \"x\0y\"").starts_with("f.toml:1:7: a NUL character"));
}

#[test]
fn deep_nesting() {
    for text in [
        "[".repeat(20_000),
        format!("a = {}", "[".repeat(20_000)),
        format!("a = {}{}", "[".repeat(20_000), "]".repeat(20_000)),
        format!("a = {}1{}", "{ a = ".repeat(200), " }".repeat(200)),
        format!("a = {}1{}", "[{ a = ".repeat(10_000), " }]".repeat(10_000)),
        format!("a{} = 1", ".a".repeat(10_000)),
        format!("[a{}]", ".a".repeat(10_000)),
        format!("[[a{}]]", ".a".repeat(10_000)),
        format!("a = {{ {} = 1 }}", vec!["b"; 10_000].join(".")),
        format!("[plant]\nA = [[\"{}1{}\"]]", "(".repeat(20_000), ")".repeat(20_000)),
    ] {
        let error = refused(&text);
        assert!(error.starts_with("f.toml:1:") || error.starts_with("f.toml:"), "{error}");
        assert!(error.len() < 5000);
    }
}

#[test]
fn deep_expressions() {
    let scenario = template(Template::Blank);
    for entry in [
        format!("{}k{}", "(".repeat(20_000), ")".repeat(20_000)),
        "-".repeat(20_000),
        "sin(".repeat(20_000),
        "k+".repeat(20_000),
        "k^".repeat(900),
        "max(k,".repeat(300),
    ] {
        refused(&scenario.replace("-k/m", &entry));
    }
}

#[test]
fn wide_files() {
    // many wrong keys: a bounded number of diagnostics, in bounded time
    let keys: String = (0..100_000).map(|i| format!("k{i} = 1\n")).collect();
    assert_eq!(refused(&keys).lines().count(), 20);
    let blank = template(Template::Blank);
    let head = "[plant.parameters]\n";
    let parameters: String = (0..100_000).map(|i| format!("p{i} = \"m*{i}\"\n")).collect();
    let error = refused(&blank.replace(head, &format!("{head}{parameters}")));
    assert!(error.contains("over the limit of 1000"), "{error}");
    let names: Vec<String> = (0..200_000).map(|i| format!("\"s{i}\"")).collect();
    let states = format!("states = [{}]", names.join(", "));
    let error = refused(&blank.replace("states = [\"position\", \"velocity\"]", &states));
    assert!(error.contains("2 by 2, wanted 200000 (states)"), "{error}");
    let formulas: Vec<String> = (0..20_000).map(|i| format!("\"k+{i}\"")).collect();
    let error = refused(&blank.replace("Q = 1.0 ", &format!("Q = [[{}]] #", formulas.join(","))));
    assert!(error.contains("20000, wanted 1"), "{error}");
}

#[test]
fn long_runs_of_one_character() {
    // the search for the end of a string must not start over at every quote
    for unit in ["\"", "'", "\"\"\"a", "a.b=", "[plant.a]\n", "a=1#\n", "-", "[[a]]\n"] {
        refused(&unit.repeat(1_000_000 / unit.len()));
    }
}

#[test]
fn too_many_expressions() {
    let n = 80;
    let names =
        |letter: &str| (0..n).map(|i| format!("\"{letter}{i}\"")).collect::<Vec<_>>().join(",");
    let row = |i: usize| (0..n).map(|j| format!("\"k+{i}{j:02}\"")).collect::<Vec<_>>().join(",");
    let rows: Vec<String> = (0..n).map(|i| format!("[{}]", row(i))).collect();
    let text = format!(
        "format = 1\n[plant]\ntime = \"continuous\"\nstates = [{}]\noutputs = [\"y\"]\nA = [{}]\n\
         C = [{}]\nR = 1\n[plant.parameters]\nk = 1\n",
        names("x"),
        rows.join(",\n"),
        vec!["1"; n].join(",")
    );
    let error = refused(&text);
    assert!(error.contains("over 5000 different expressions"), "{error}");
}

/// A folder of its own under the target directory.
fn folder(name: &str) -> std::io::Result<PathBuf> {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&path)?;
    Ok(path)
}

#[test]
fn bytes_that_are_no_text() -> std::io::Result<()> {
    let folder = folder("scenario_bytes")?;
    let read = |name: &str, bytes: &[u8]| -> std::io::Result<String> {
        let path = folder.join(name);
        std::fs::write(&path, bytes)?;
        Ok(match Scenario::from_file(&path) {
            Ok(_) => "it passes".into(),
            Err(error) => error.to_string(),
        })
    };
    let text = template(Template::Pendulum);
    let wide = |bytes: fn(u16) -> [u8; 2]| -> Vec<u8> {
        std::iter::once(0xfeff).chain(text.encode_utf16()).flat_map(bytes).collect()
    };
    for bytes in [wide(u16::to_le_bytes), wide(u16::to_be_bytes)] {
        let error = read("utf16.toml", &bytes)?;
        assert!(error.ends_with(":1:1: the text is UTF-16: save the file as UTF-8"), "{error}");
    }
    let error = read("latin1.toml", b"format = 1\ntitle = \"\xe9t\xe9\"")?;
    assert!(error.ends_with(":2:10: a byte is not UTF-8: save the file as UTF-8"), "{error}");
    assert_eq!(read("marked.toml", format!("\u{feff}{text}").as_bytes())?, "it passes");
    Ok(())
}

#[test]
fn files_that_are_no_files() -> std::io::Result<()> {
    let folder = folder("scenario_files")?;
    let error = |path: &Path| match Scenario::from_file(path) {
        Ok(_) => panic!("it passes"),
        Err(error) => error,
    };
    let since = Instant::now();
    let start = worked(since);
    let missing = error(&folder.join("missing.toml"));
    assert!(matches!(&missing, Error::Read { source, .. }
        if source.kind() == std::io::ErrorKind::NotFound));
    assert!(error(&folder).to_string().contains("is a directory"));
    let large = folder.join("large.toml");
    std::fs::File::create(&large)?.set_len(200 << 20)?;
    assert!(matches!(error(&large), Error::TooLarge { bytes, .. } if bytes == 200 << 20));
    std::fs::remove_file(&large)?;
    #[cfg(unix)]
    for device in ["/dev/zero", "/dev/full", "/dev/null"] {
        let text = error(Path::new(device)).to_string();
        assert!(text.contains("is not a regular file"), "{text}");
    }
    #[cfg(unix)]
    {
        let pipe = folder.join("pipe");
        let _ = std::fs::remove_file(&pipe);
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|status| status.success()) {
            assert!(error(&pipe).to_string().contains("is not a regular file"));
        }
    }
    assert!(worked(since).saturating_sub(start) < Duration::from_secs(1));
    Ok(())
}

#[test]
fn a_name_cannot_forge_a_line() {
    let error = match Scenario::parse("evil\nname\u{1b}[2J", "\"a\\nb\" = 1") {
        Ok(_) => panic!("it passes"),
        Err(error) => error.to_string(),
    };
    assert!(error.lines().all(|line| line.starts_with("evil\\nname\\u{1b}[2J:1:1: ")), "{error}");
}

/// Does not panic, does not take long; what is refused has diagnostics.
fn survives(text: &str) -> Result<(), TestCaseError> {
    let since = Instant::now();
    let start = worked(since);
    match Scenario::parse("f", text) {
        Ok(scenario) => {
            let _ = scenario.study();
        }
        Err(error) => {
            prop_assert!(!error.diagnostics().is_empty());
            for d in error.diagnostics() {
                prop_assert!(d.line >= 1 && d.column >= 1);
                prop_assert!(!d.message.is_empty() && !d.remedy.is_empty(), "{d}");
                prop_assert_eq!(d.to_string().lines().count(), 1);
            }
        }
    }
    let time = worked(since).saturating_sub(start);
    prop_assert!(time < Duration::from_secs(1), "{time:?}");
    Ok(())
}

const WORDS: [&str; 24] = [
    "[",
    "]",
    "{",
    "}",
    "\"",
    "'",
    "\"\"\"",
    "=",
    ",",
    ".",
    "\n",
    "-",
    "1e999",
    "nan",
    "0",
    "[[",
    "#",
    "\\",
    "L",
    "9223372036854775808",
    "\u{e9}",
    "[plant]\n",
    "true",
    "1979-05-27",
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn any_text(text in any::<String>()) {
        survives(&text)?;
    }

    #[test]
    fn words(words in prop::collection::vec(prop::sample::select(&WORDS[..]), 0..200)) {
        survives(&words.concat())?;
    }

    #[test]
    fn mutated_scenarios(
        kind in prop::sample::select(vec![Template::Pendulum, Template::Oscillator, Template::Blank]),
        cuts in prop::collection::vec(
            (any::<prop::sample::Index>(), 0..40_usize, prop::sample::select(&WORDS[..])),
            1..6,
        ),
    ) {
        let mut text: Vec<char> = template(kind).chars().collect();
        for (at, length, word) in cuts {
            let at = at.index(text.len());
            let end = (at + length).min(text.len());
            text.splice(at..end, word.chars());
        }
        survives(&text.into_iter().collect::<String>())?;
    }

    #[test]
    fn values_of_the_wrong_kind(
        line in any::<prop::sample::Index>(),
        value in prop::sample::select(vec![
            "0", "-1", "1.5", "\"a\"", "\"\"", "[]", "[[]]", "[1, [2]]", "{}", "{ a = 1 }", "true",
            "nan", "inf", "1979-05-27", "[\"a\", \"b\"]", "[[1, 2], [3]]", "[{}]", "\"1/0\"",
            "9999999999", "[[\"x\"]]", "{ L = { from = 1, to = 2, points = 4000000000 } }",
        ]),
    ) {
        let text: Vec<&str> = template(Template::Blank).lines().collect();
        let keyed: Vec<usize> = (0..text.len()).filter(|&i| text[i].contains(" = ")).collect();
        let at = keyed[line.index(keyed.len())];
        let key = text[at].trim_start_matches("# ").split(" = ").next().unwrap_or("");
        let changed = format!("{key} = {value}");
        let lines: Vec<&str> =
            text.iter().enumerate().map(|(i, l)| if i == at { &changed[..] } else { l }).collect();
        survives(&lines.join("\n"))?;
    }
}
