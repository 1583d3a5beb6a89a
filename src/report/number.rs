//! Numbers as text: shortest, to some digits, and as ticks of an axis.

/// The shortest decimal that reads back as `v`; no trailing `.0`.
///
/// ```
/// use mmae::report::plain;
/// assert_eq!(plain(0.1 + 0.2), "0.30000000000000004");
/// assert_eq!((plain(401.0), plain(1e-7)), ("401".into(), "1e-7".into()));
/// ```
pub fn plain(v: f64) -> String {
    if !v.is_finite() {
        return if v.is_nan() { "-".into() } else { if v > 0.0 { "inf" } else { "-inf" }.into() };
    }
    // `+ 0.0` turns -0 into 0
    let text = format!("{:?}", v + 0.0);
    match text.strip_suffix(".0") {
        Some(whole) => whole.into(),
        None => text,
    }
}

/// `v` rounded to `digits` significant digits, printed as [`plain`] does.
///
/// ```
/// use mmae::report::significant;
/// assert_eq!(significant(821.309882, 4), "821.3");
/// assert_eq!(significant(4.1e-13, 2), "4.1e-13");
/// ```
pub fn significant(v: f64, digits: usize) -> String {
    if !v.is_finite() {
        return plain(v);
    }
    plain(format!("{:.*e}", digits.saturating_sub(1), v).parse().unwrap_or(v))
}

/// `v` to as many decimals as `uncertainty` leaves meaningful (at most 12 and
/// at least 3 significant digits).
pub(crate) fn to_uncertainty(v: f64, uncertainty: f64) -> String {
    if !v.is_finite() || !uncertainty.is_finite() || v == 0.0 {
        return plain(v);
    }
    let magnitude = decade(v.abs());
    let last = if uncertainty > 0.0 { decade(uncertainty) } else { magnitude - 11 };
    let digits = (magnitude - last + 1).clamp(3, 12) as usize;
    if !(-4..9).contains(&magnitude) {
        return format!("{:.*e}", digits - 1, v);
    }
    let decimals = (digits as i32 - 1 - magnitude).max(0) as usize;
    format!("{v:.decimals$}")
}

/// Exponent of the first significant digit of a positive finite `v`.
pub(crate) fn decade(v: f64) -> i32 {
    // printing is exact where floor(log10) is off by one near powers of ten
    let text = format!("{v:e}");
    text.rsplit('e').next().and_then(|e| e.parse().ok()).unwrap_or(0)
}

/// A tick of an axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    pub(crate) value: f64,
    /// Empty for a minor tick.
    pub(crate) label: String,
}

/// Round numbers on `[from, to]`, about `wanted` of them, steps 1, 2 or 5.
pub(crate) fn linear_ticks(from: f64, to: f64, wanted: usize) -> Vec<Tick> {
    let span = to - from;
    if !(span > 0.0 && span.is_finite()) {
        return vec![Tick { value: from, label: significant(from, 6) }];
    }
    let rough = span / wanted.max(1) as f64;
    let exponent = decade(rough);
    let unit = power_of_ten(exponent);
    let mantissa = rough / unit;
    let (factor, exponent) = if mantissa <= 1.0 {
        (1.0, exponent)
    } else if mantissa <= 2.0 {
        (2.0, exponent)
    } else if mantissa <= 5.0 {
        (5.0, exponent)
    } else {
        (1.0, exponent + 1)
    };
    let step = factor * power_of_ten(exponent);
    let slack = 1e-9 * span;
    let first = ((from - slack) / step).ceil();
    let last = ((to + slack) / step).floor();
    let count = (last - first).clamp(0.0, 1000.0) as usize;
    let largest = from.abs().max(to.abs());
    (0..=count)
        .map(|k| {
            // exact multiples: decimal text, not repeated addition
            let whole = first + k as f64;
            let value = format!("{}e{exponent}", whole * factor).parse().unwrap_or(whole * step);
            Tick { value, label: tick_label(value, exponent, largest) }
        })
        .collect()
}

/// Label with the decimals of the step, or as a power of ten where that is shorter.
fn tick_label(value: f64, step_decade: i32, largest: f64) -> String {
    if largest >= 1e6 || (largest > 0.0 && largest < 1e-3) {
        return pretty(value);
    }
    let decimals = (-step_decade).max(0) as usize;
    format!("{:.decimals$}", value + 0.0)
}

/// As [`plain`], but `2·10⁷` for numbers with many zeros.
pub(crate) fn pretty(v: f64) -> String {
    let magnitude = if v == 0.0 { 0 } else { decade(v.abs()) };
    if (-3..6).contains(&magnitude) || !v.is_finite() { plain(v) } else { powers(v) }
}

/// `v` as a multiple of a power of ten.
fn powers(v: f64) -> String {
    let text = format!("{v:e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let raised: String = exponent
        .chars()
        .map(|c| match c {
            '-' => '\u{207b}',
            '1' => '\u{b9}',
            '2' => '\u{b2}',
            '3' => '\u{b3}',
            digit => char::from_u32(0x2070 + (digit as u32 - '0' as u32)).unwrap_or(digit),
        })
        .collect();
    match mantissa {
        "1" => format!("10{raised}"),
        "-1" => format!("-10{raised}"),
        _ => format!("{mantissa}\u{b7}10{raised}"),
    }
}

/// Ticks of a logarithmic axis over positive `[from, to]`: labelled decades
/// (with 2 and 5 where there are few), the rest minor.
pub(crate) fn log_ticks(from: f64, to: f64, wanted: usize) -> Vec<Tick> {
    let decades = (to / from).log10();
    if decades < 0.8 {
        return linear_ticks(from, to, wanted);
    }
    let (low, high) = (decade(from), decade(to));
    let every = ((high - low) as u32).div_ceil(wanted.max(1) as u32).max(1) as i32;
    let labelled: &[u32] = if decades < 1.7 {
        &[1, 2, 3, 5, 7]
    } else if decades * 3.0 <= wanted as f64 {
        &[1, 2, 5]
    } else {
        &[1]
    };
    // one notation for all labels
    let raised = low < -3 || high > 5;
    let print = |value: f64, exponent: i32| {
        if raised && !(0..2).contains(&exponent) { powers(value) } else { plain(value) }
    };
    let mut ticks = Vec::new();
    for exponent in low..=high {
        for digit in 1..10_u32 {
            if digit > 1 && every > 1 {
                break;
            }
            let value: f64 = format!("{digit}e{exponent}").parse().unwrap_or(f64::NAN);
            if !(value >= from * (1.0 - 1e-12) && value <= to * (1.0 + 1e-12)) {
                continue;
            }
            let named = labelled.contains(&digit) && exponent.rem_euclid(every) == 0;
            let label = if named { print(value, exponent) } else { String::new() };
            ticks.push(Tick { value, label });
        }
    }
    ticks
}

fn power_of_ten(exponent: i32) -> f64 {
    format!("1e{exponent}").parse().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: &[Tick]) -> Vec<&str> {
        ticks.iter().map(|t| t.label.as_str()).filter(|l| !l.is_empty()).collect()
    }

    #[test]
    fn numbers_do_not_carry_noise() {
        assert_eq!(plain(-0.0), "0");
        assert_eq!(plain(f64::NAN), "-");
        assert_eq!(significant(0.1 + 0.2, 6), "0.3");
        assert_eq!(to_uncertainty(1.153616065, 4e-10), "1.1536160650");
        assert_eq!(to_uncertainty(1.153616065, 3e-4), "1.1536");
        assert_eq!(to_uncertainty(1.153616065, 0.0), "1.15361606500");
        assert_eq!(to_uncertainty(3.2e-7, 1e-12), "3.20000e-7");
        assert_eq!(decade(999.9999999999999), 2);
        assert_eq!(decade(1000.0), 3);
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(labels(&linear_ticks(0.9, 1.9, 6)), ["1.0", "1.2", "1.4", "1.6", "1.8"]);
        assert_eq!(labels(&linear_ticks(-1.0, 1.0, 5)), ["-1.0", "-0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels(&linear_ticks(0.0, 2e7, 2)), ["0", "10\u{2077}", "2\u{b7}10\u{2077}"]);
        assert_eq!(labels(&log_ticks(19.0, 1300.0, 5)), ["100", "1000"]);
        assert_eq!(labels(&log_ticks(19.0, 1300.0, 6)), ["20", "50", "100", "200", "500", "1000"]);
        assert!(labels(&log_ticks(1e-9, 1e12, 6)).len() <= 7);
        assert_eq!(linear_ticks(2.0, 2.0, 5).len(), 1);
    }
}
