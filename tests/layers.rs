//! The table of layers holds: a module imports only from rows above its own or from itself.

use std::path::{Path, PathBuf};

/// Modules of one row of the table, and who may import whom within it (`*` is everyone).
type Row = (&'static [&'static str], &'static [(&'static str, &'static str)]);

/// The table, from the bottom row up.
const ROWS: [Row; 8] = [
    (&["error", "real", "simd", "par"], &[("*", "*")]),
    (&["small"], &[]),
    (&["model", "solve"], &[("model", "solve")]),
    (&["observer"], &[]),
    (&["bank", "weight", "eip", "adaptive"], &[]),
    (&["engine"], &[]),
    (&["sim"], &[]),
    (&["scenario", "report", "sweep", "cli", "bin", "python"], &[("*", "*")]),
];

/// faer is a container everywhere; its algorithms stay behind `solve/backend`.
const FAER_TYPES: [&str; 5] = ["Mat", "MatRef", "MatMut", "Scale", "mat"];
const FAER_VERBS: [&str; 12] = [
    ".eigenvalues(",
    ".eigen(",
    ".self_adjoint_eigen(",
    ".self_adjoint_eigenvalues(",
    ".svd(",
    ".thin_svd(",
    ".singular_values(",
    ".partial_piv_lu(",
    ".full_piv_lu(",
    ".col_piv_qr(",
    ".llt(",
    ".ldlt(",
];

fn row(module: &str) -> Option<usize> {
    ROWS.iter().position(|(names, _)| names.contains(&module))
}

fn may_import(from: &str, to: &str) -> bool {
    let (Some(a), Some(b)) = (row(from), row(to)) else {
        return true;
    };
    let allowed = |&(x, y): &(&str, &str)| (x == "*" || x == from) && (y == "*" || y == to);
    a > b || from == to || (a == b && ROWS[a].1.iter().any(allowed))
}

fn sources(dir: &Path, out: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(dir)
        .expect("src is readable")
        .map(|e| e.expect("src is readable").path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// The code without line comments and without the test module at its end.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).expect("sources are UTF-8");
    let text = text.split("#[cfg(test)]").next().unwrap_or_default();
    let lines = text.lines().map(|l| l.split("//").next().unwrap_or(""));
    lines.collect::<Vec<_>>().join("\n")
}

/// First names after `prefix`: `crate::a::x` gives `a`, `crate::{a::x, b}` gives `a`, `b`.
fn names_after(code: &str, prefix: &str) -> Vec<String> {
    let word = |s: &str| -> String {
        let s = s.trim_start();
        s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
    };
    let mut found = Vec::new();
    for (at, _) in code.match_indices(prefix) {
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let rest = &code[at + prefix.len()..];
        let Some(list) = rest.strip_prefix('{') else {
            found.push(word(rest));
            continue;
        };
        let (mut depth, mut start) = (0, 0);
        for (i, c) in list.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                ',' if depth == 0 => {
                    found.push(word(&list[start..i]));
                    start = i + 1;
                }
                '}' => {
                    found.push(word(&list[start..i]));
                    break;
                }
                _ => {}
            }
        }
    }
    found
}

#[test]
fn layers_hold() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&src, &mut files);
    assert!(files.len() > 10, "src was not found");
    let mut wrong = Vec::new();
    for path in &files {
        let inside = path.strip_prefix(&src).expect("below src");
        let shown = inside.display().to_string().replace('\\', "/");
        let first = shown.split('/').next().unwrap_or_default();
        let module = match first.trim_end_matches(".rs") {
            "lib" => continue,
            "main" => "bin",
            other => other,
        };
        let code = code(path);
        let mut blame = |what: String| wrong.push(format!("src/{shown}: {what}"));
        for to in ["crate::", "mmae::"].iter().flat_map(|p| names_after(&code, p)) {
            if !may_import(module, &to) {
                blame(format!("imports {to}, which is not above it"));
            }
        }
        // a hyphen belongs to the word: `unsafe-inline` is a word of HTML
        let words = |c: char| !(c.is_alphanumeric() || c == '_' || c == '-');
        if module != "simd" && code.split(words).any(|w| w == "unsafe") {
            blame("unsafe belongs in src/simd".into());
        }
        if module != "par" && code.contains("rayon::") {
            blame("rayon belongs in src/par.rs".into());
        }
        if !shown.starts_with("solve/backend") {
            for name in names_after(&code, "faer::") {
                if !FAER_TYPES.contains(&name.as_str()) {
                    blame(format!("faer::{name} belongs in src/solve/backend"));
                }
            }
            for verb in FAER_VERBS.iter().filter(|v| code.contains(**v)) {
                blame(format!("{verb} belongs in src/solve/backend"));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn the_table_says_what_it_should() {
    assert!(may_import("eip", "observer") && may_import("model", "solve"));
    assert!(may_import("simd", "real") && may_import("report", "cli"));
    assert!(!may_import("solve", "model") && !may_import("eip", "bank"));
    assert!(!may_import("small", "solve") && !may_import("observer", "eip"));
    let names = names_after("use crate::{a::{x, y}, b, c::z}; crate::d::e(mycrate::f)", "crate::");
    assert_eq!(names, ["a", "b", "c", "d"]);
}
