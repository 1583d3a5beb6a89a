//! Reading an expression and writing it down again for the crate.

use super::super::operators::{Apply, CONSTANTS, FUNCTIONS, Function};
use super::super::reader::clip;
use super::super::suggest;
use super::{Fault, LENGTH, fault};

/// Deepest nesting of parentheses.
const DEPTH: usize = 50;

/// The text as the crate gets it, with the variables it uses.
pub(super) struct Spelled {
    pub(super) text: String,
    pub(super) variables: Vec<usize>,
}

/// What is known of one level of parentheses.
struct Level {
    /// Where it was opened.
    at: usize,
    /// The function it holds the arguments of.
    function: Option<&'static Function>,
    commas: usize,
    /// The operator before the operand that is being read.
    operator: Option<char>,
}

/// Reads an expression once from left to right and writes it down again.
pub(super) struct Speller<'a> {
    text: &'a str,
    names: &'a [&'a str],
    at: usize,
    out: String,
    variables: Vec<usize>,
    levels: Vec<Level>,
}

impl<'a> Speller<'a> {
    pub(super) fn new(text: &'a str, names: &'a [&'a str]) -> Self {
        let ground = Level { at: 0, function: None, commas: 0, operator: None };
        let out = String::with_capacity(2 * text.len());
        Self { text, names, at: 0, out, variables: Vec::new(), levels: vec![ground] }
    }

    pub(super) fn run(mut self) -> Result<Spelled, Fault> {
        if self.text.len() > LENGTH {
            let remedy = "name parts of it under [plant.parameters]";
            return fault(0, format!("an expression over {LENGTH} characters"), remedy);
        }
        if self.peek().is_none() {
            return fault(0, "an empty expression", "write a number or an expression");
        }
        loop {
            self.operand()?;
            if self.operators()? {
                break;
            }
        }
        self.variables.sort_unstable();
        self.variables.dedup();
        Ok(Spelled { text: self.out, variables: self.variables })
    }

    /// The next character that is not a blank.
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        let blank = rest.len() - rest.trim_start_matches([' ', '\t', '\n', '\r']).len();
        self.at += blank;
        self.text[self.at..].chars().next()
    }

    /// Reads up to the end of an operand: signs, opening parentheses, functions,
    /// and then a number or a name.
    fn operand(&mut self) -> Result<(), Fault> {
        let mut signed = false;
        loop {
            let start = self.at;
            match self.peek() {
                Some('+' | '-') if signed => {
                    let remedy = "keep one, or put the inner one in parentheses";
                    return fault(self.at, "two signs in a row", remedy);
                }
                Some(sign @ ('+' | '-')) => {
                    self.at += 1;
                    signed = true;
                    if sign == '-' {
                        // as a factor, the sign binds as it does on paper
                        self.out.push_str(match self.levels.last().and_then(|l| l.operator) {
                            Some('/') => "(-1)/",
                            Some('^') => "-",
                            _ => "(-1)*",
                        });
                    }
                }
                Some('(') => {
                    self.open(None)?;
                    signed = false;
                }
                Some(c) if c.is_ascii_digit() || c == '.' => return self.number(),
                Some(c) if c.is_alphabetic() || c == '_' => {
                    if self.name()? {
                        return Ok(());
                    }
                    signed = false;
                }
                Some(c) => {
                    let message = match c {
                        '*' | '/' | '^' | ')' | ',' => {
                            format!("'{c}' where a number or a name should be")
                        }
                        _ => format!("'{c}' does not belong in an expression"),
                    };
                    return fault(self.at, message, "use + - * / ^, parentheses and functions");
                }
                None => {
                    let at = start.min(self.text.trim_end().len());
                    return fault(at, "the expression breaks off", "complete it");
                }
            }
        }
    }

    /// Reads closing parentheses and the operator or comma after an operand;
    /// true at the end of the text.
    fn operators(&mut self) -> Result<bool, Fault> {
        loop {
            let next = self.peek();
            let last = self.levels.len() - 1;
            match next {
                None if last == 0 => return Ok(true),
                None => {
                    let at = self.levels[last].at;
                    return fault(at, "a parenthesis that is not closed", "close it with ')'");
                }
                Some(')') => self.close()?,
                Some(',') => {
                    self.comma()?;
                    return Ok(false);
                }
                Some('*') if self.text[self.at..].starts_with("**") => {
                    return fault(self.at, "'**' is not an operator", "write a power as a^b");
                }
                Some(c @ ('+' | '-' | '*' | '/' | '^')) => {
                    let level = &mut self.levels[last];
                    if c == '^' && level.operator == Some('^') {
                        let remedy = "write (a^b)^c or a^(b^c)";
                        return fault(self.at, "a power of a power is ambiguous", remedy);
                    }
                    level.operator = Some(c);
                    self.out.push(c);
                    self.at += 1;
                    return Ok(false);
                }
                Some(c) if c.is_alphanumeric() || matches!(c, '_' | '(' | '.') => {
                    let remedy = "write a product with *, as in 2*L";
                    return fault(self.at, format!("no operator before '{c}'"), remedy);
                }
                Some(c) => {
                    let message = format!("'{c}' does not belong in an expression");
                    return fault(self.at, message, "use + - * / ^, parentheses and functions");
                }
            }
        }
    }

    fn open(&mut self, function: Option<&'static Function>) -> Result<(), Fault> {
        if self.levels.len() > DEPTH {
            let remedy = "name parts of it under [plant.parameters]";
            return fault(self.at, format!("parentheses nest over {DEPTH} deep"), remedy);
        }
        self.levels.push(Level { at: self.at, function, commas: 0, operator: None });
        self.at += 1;
        match function {
            // f(a, b) is written ((a)f(b))
            Some(Function { apply: Apply::Two(_), .. }) => self.out.push_str("(("),
            Some(Function { apply: Apply::One(_), name }) => {
                self.out.push_str(name);
                self.out.push('(');
            }
            None => self.out.push('('),
        }
        Ok(())
    }

    fn comma(&mut self) -> Result<(), Fault> {
        let at = self.at;
        let Some(level) = self.levels.last_mut() else { return Ok(()) };
        match level.function {
            Some(Function { apply: Apply::Two(_), name }) if level.commas == 0 => {
                level.commas = 1;
                level.operator = None;
                self.out.push(')');
                self.out.push_str(name);
                self.out.push('(');
                self.at += 1;
                Ok(())
            }
            Some(function) => {
                let takes = if matches!(function.apply, Apply::One(_)) { "one" } else { "two" };
                let message = format!("'{}' takes {takes} argument(s)", function.name);
                fault(at, message, "remove the rest")
            }
            None => fault(at, "',' outside the arguments of a function", "write a decimal point"),
        }
    }

    fn close(&mut self) -> Result<(), Fault> {
        if self.levels.len() == 1 {
            return fault(self.at, "')' without '('", "remove it");
        }
        if let Some(level) = self.levels.pop() {
            let two = matches!(level.function, Some(Function { apply: Apply::Two(_), .. }));
            if two && level.commas == 0 {
                let name = level.function.map_or("", |f| f.name);
                let message = format!("'{name}' takes two arguments");
                return fault(self.at, message, format!("write {name}(a, b)"));
            }
            self.out.push_str(if two { "))" } else { ")" });
        }
        self.at += 1;
        Ok(())
    }

    fn number(&mut self) -> Result<(), Fault> {
        let rest = &self.text[self.at..];
        let bytes = rest.as_bytes();
        let mantissa = bytes.iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
        let mut end = mantissa;
        if matches!(bytes.get(end), Some(b'e' | b'E')) {
            let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
            let digits = bytes[end + 1 + sign..].iter().take_while(|b| b.is_ascii_digit()).count();
            if digits > 0 {
                end += 1 + sign + digits;
            }
        }
        let text = &rest[..end];
        let value = match text.parse::<f64>() {
            Ok(value) if value.is_finite() => value,
            Ok(_) => return fault(self.at, format!("{text} is too large"), "stay below 1.8e308"),
            Err(_) => return fault(self.at, format!("'{text}' is not a number"), "write 1.5"),
        };
        // in plain decimals, which keep every bit: the crate reads no exponent
        self.out.push_str(&value.to_string());
        self.at += end;
        Ok(())
    }

    /// Reads a name; true if it is a value, false if it opened a function.
    fn name(&mut self) -> Result<bool, Fault> {
        let (start, text) = (self.at, self.text);
        let end = text[start..]
            .find(|c: char| !(c.is_alphanumeric() || c == '_'))
            .map_or(text.len(), |n| start + n);
        let name = &text[start..end];
        self.at = end;
        if self.peek() == Some('(') {
            let Some(function) = FUNCTIONS.iter().find(|f| f.name == name) else {
                return self.unknown_function(start, name);
            };
            self.open(Some(function))?;
            return Ok(false);
        }
        if let Some(index) = self.names.iter().position(|n| *n == name) {
            self.variables.push(index);
            // the crate sorts by name: digits keep the order of the indices
            self.out.push_str(&format!("v{index:06}"));
        } else if let Some((_, value)) = CONSTANTS.iter().find(|(n, _)| *n == name) {
            self.out.push_str(&value.to_string());
        } else if FUNCTIONS.iter().any(|f| f.name == name) {
            let message = format!("the function '{name}' has no arguments");
            return fault(start, message, format!("write {name}(...)"));
        } else {
            return self.unknown_name(start, name);
        }
        Ok(true)
    }

    fn unknown_function(&self, at: usize, name: &str) -> Result<bool, Fault> {
        if self.names.contains(&name) {
            let remedy = format!("write a product with *, as in {name}*(...)");
            return fault(at, format!("no operator after '{name}'"), remedy);
        }
        let message = format!("no function is called '{}'", clip(name));
        if name == "log" {
            return fault(at, message, "write ln(...) or log10(...)");
        }
        let known = FUNCTIONS.map(|f| f.name);
        fault(at, message, suggest::remedy(name, &known, "the functions are"))
    }

    fn unknown_name(&self, at: usize, name: &str) -> Result<bool, Fault> {
        let message = format!("no parameter is called '{}'", clip(name));
        let known: Vec<&str> =
            self.names.iter().copied().chain(CONSTANTS.map(|(n, _)| n)).collect();
        let unknown = suggest::nearest(name, &known).is_none();
        let remedy = suggest::remedy(name, &known, "there are");
        Err(Fault { at, message, remedy, unknown })
    }
}
