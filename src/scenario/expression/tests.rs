//! Expressions against a textbook evaluator, and every fault with its place.

use proptest::prelude::*;

use super::super::operators::{Apply, FUNCTIONS, Function, power};
use super::*;

const NAMES: [&str; 3] = ["L", "M", "theta_1"];
const VALUES: [f64; 3] = [1.3, -0.7, 2.25];

#[derive(Debug, Clone)]
enum Tree {
    Number(f64),
    Name(usize),
    Minus(Box<Tree>),
    Binary(char, Box<Tree>, Box<Tree>),
    Call(usize, Box<Tree>, Box<Tree>),
}

fn tree() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        prop_oneof![Just(2.0), Just(1e-7), Just(3.5e12), 0.0..10.0].prop_map(Tree::Number),
        (0..NAMES.len()).prop_map(Tree::Name),
    ];
    leaf.prop_recursive(6, 40, 2, |inner| {
        let operator = prop::sample::select(vec!['+', '-', '*', '/', '^']);
        let two = (inner.clone(), inner.clone());
        prop_oneof![
            1 => inner.prop_map(|a| Tree::Minus(a.into())),
            4 => (operator, two.clone())
                .prop_map(|(c, (a, b))| Tree::Binary(c, a.into(), b.into())),
            1 => (0..FUNCTIONS.len(), two).prop_map(|(f, (a, b))| Tree::Call(f, a.into(), b.into())),
        ]
    })
}

/// The value by recursion.
fn value(tree: &Tree) -> f64 {
    match tree {
        Tree::Number(n) => *n,
        Tree::Name(i) => VALUES[*i],
        Tree::Minus(a) => -value(a),
        Tree::Binary(c, a, b) => {
            let (a, b) = (value(a), value(b));
            match c {
                '+' => a + b,
                '-' => a - b,
                '*' => a * b,
                '/' => a / b,
                _ => power(a, b),
            }
        }
        Tree::Call(f, a, b) => match FUNCTIONS[*f].apply {
            Apply::One(f) => f(value(a)),
            Apply::Two(f) => f(value(a), value(b)),
        },
    }
}

/// How tightly the outermost operator binds, as on paper.
fn rank(tree: &Tree) -> u8 {
    match tree {
        Tree::Binary('+' | '-', ..) => 0,
        Tree::Binary('*' | '/', ..) => 1,
        Tree::Minus(_) => 2,
        Tree::Binary(..) => 3,
        _ => 4,
    }
}

/// The text with no parentheses but those needed.
fn print(tree: &Tree) -> String {
    let at_least = |least: u8, tree: &Tree| {
        let text = print(tree);
        if rank(tree) < least { format!("({text})") } else { text }
    };
    match tree {
        Tree::Number(n) => format!("{n:e}"),
        Tree::Name(i) => NAMES[*i].into(),
        Tree::Minus(a) => format!("-{}", at_least(3, a)),
        Tree::Binary('^', a, b) => {
            // a sign may stand in the exponent, another power may not
            let exponent = match &**b {
                Tree::Minus(c) => format!("-{}", at_least(4, c)),
                b => at_least(4, b),
            };
            format!("{}^{exponent}", at_least(4, a))
        }
        Tree::Binary(c @ ('+' | '-'), a, b) => {
            format!("{} {c} {}", at_least(0, a), at_least(1, b))
        }
        Tree::Binary(c, a, b) => format!("{}{c}{}", at_least(1, a), at_least(2, b)),
        Tree::Call(f, a, b) => {
            let Function { name, apply } = &FUNCTIONS[*f];
            match apply {
                Apply::One(_) => format!("{name}( {} )", print(a)),
                Apply::Two(_) => format!("{name}({}, {})", print(a), print(b)),
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn equals_the_textbook_evaluator(tree in tree()) {
        let text = print(&tree);
        prop_assume!(text.len() < LENGTH);
        let got = match Entry::compile(&text, &NAMES) {
            Ok(entry) => entry.value(&VALUES),
            Err(fault) => return Err(TestCaseError::fail(format!("{text}: {fault:?}"))),
        };
        let want = value(&tree);
        let same = got.to_bits() == want.to_bits() || (got.is_nan() && want.is_nan());
        prop_assert!(same || got == want, "{text}: {got:e}, wanted {want:e}");
    }

    #[test]
    fn any_text_is_an_entry_or_a_fault(
        text in prop_oneof![
            any::<String>(),
            prop::collection::vec(
                prop::sample::select(vec![
                    "L", "M", "x", "2", "1e-3", ".", "e", "pi", "sqrt", "max", "(", ")", ",", "+",
                    "-", "*", "/", "^", "**", " ", "{", "}", "\u{3b8}", "1.5.2", "2e",
                ]),
                0..30,
            )
            .prop_map(|words| words.concat()),
        ]
    ) {
        match Entry::compile(&text, &NAMES) {
            Ok(entry) => { entry.value(&VALUES); }
            Err(fault) => prop_assert!(fault.at <= text.len() && text.is_char_boundary(fault.at)),
        }
    }
}

#[test]
fn precedence_is_that_of_paper() {
    for (text, want) in [
        ("-2^2", -4.0),
        ("2^-2", 0.25),
        ("1 - 2^2", -3.0),
        ("8/-2^2", -2.0),
        ("3*-2^2", -12.0),
        ("1 - -2", 3.0),
        ("2 - 3 + 4", 3.0),
        ("8/4/2", 1.0),
        ("8/4*2", 4.0),
        ("7e-1*3", 0.7 * 3.0),
        ("max(1, max(3, 2)) + min(4, 5)*2", 11.0),
        ("atan2(1, -1)", 2.356194490192345),
        ("cos(pi)", -1.0),
        ("ln(e)", 1.0),
        ("sqrt (16)", 4.0),
        ("\n 1 +\t2 ", 3.0),
        ("(2^3)^2", 64.0),
        (".5 + 5.", 5.5),
    ] {
        match Entry::compile(text, &[]) {
            Ok(Entry::Constant(value)) => assert_eq!(value, want, "{text}"),
            other => panic!("{text}: {other:?}"),
        }
    }
}

#[test]
fn entries_are_folded() {
    assert!(matches!(Entry::compile(" L ", &NAMES), Ok(Entry::Parameter(0))));
    assert!(matches!(Entry::compile("2*pi", &NAMES), Ok(Entry::Constant(_))));
    let entry = Entry::compile("theta_1 - L + L", &NAMES);
    assert_eq!(entry.map(|e| e.variables().to_vec()), Ok(vec![0, 2]));
}

#[test]
fn many_parameters_are_gathered_from_the_heap() -> Result<(), Fault> {
    let names: Vec<String> = (0..40).map(|i| format!("p{i}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let entry = Entry::compile(&names.join(" + "), &names)?;
    let values: Vec<f64> = (0..40).map(f64::from).collect();
    assert_eq!(entry.value(&values), 780.0);
    Ok(())
}

#[test]
fn faults_name_the_character_and_the_remedy() {
    let deep = "(".repeat(60);
    let long = "1+".repeat(1500);
    for (text, at, message, remedy) in [
        ("", 0, "empty", "write a number"),
        ("L*", 2, "breaks off", "complete"),
        ("L*)", 2, "')' where", "parentheses"),
        ("(L", 0, "not closed", "')'"),
        ("L)", 1, "without '('", "remove"),
        ("2L", 1, "no operator before 'L'", "2*L"),
        ("L(2)", 0, "no operator after 'L'", "L*(...)"),
        ("(L)(M)", 3, "no operator before '('", "*"),
        ("L**2", 1, "'**'", "a^b"),
        ("L^M^2", 3, "ambiguous", "(a^b)^c"),
        ("--L", 1, "two signs", "keep one"),
        ("L + l", 4, "called 'l'", "did you mean 'L'?"),
        ("L + length", 4, "called 'length'", "there are L, M, theta_1, pi, e"),
        ("theta1*2", 0, "called 'theta1'", "did you mean 'theta_1'?"),
        ("sqt(L)", 0, "called 'sqt'", "did you mean 'sqrt'?"),
        ("log(L)", 0, "called 'log'", "ln(...) or log10(...)"),
        ("sqrt", 0, "has no arguments", "sqrt(...)"),
        ("sqrt(L, M)", 6, "one argument", "remove"),
        ("max(L)", 5, "two arguments", "max(a, b)"),
        ("max(L, M, 1)", 8, "two argument", "remove"),
        ("1,5", 1, "','", "decimal point"),
        ("1.5.2", 0, "'1.5.2' is not a number", "1.5"),
        ("1e999", 0, "too large", "1.8e308"),
        ("L = 2", 2, "'='", "use + -"),
        ("{L}", 0, "'{'", "use + -"),
        (&deep, 50, "nest over 50 deep", "plant.parameters"),
        (&long, 0, "over 2000 characters", "plant.parameters"),
    ] {
        match Entry::compile(text, &NAMES) {
            Ok(entry) => panic!("{text}: {entry:?}"),
            Err(fault) => {
                assert_eq!(fault.at, at, "{text}: {fault:?}");
                assert!(fault.message.contains(message), "{text}: {fault:?}");
                assert!(fault.remedy.contains(remedy), "{text}: {fault:?}");
            }
        }
    }
}
