//! The nearest valid word to one that is not.

/// `did you mean 'x'?` when something is near, else the list of what there is,
/// after `lead`.
pub(super) fn remedy(word: &str, known: &[&str], lead: &str) -> String {
    match nearest(word, known) {
        Some(near) => format!("did you mean '{near}'?"),
        None if known.is_empty() => format!("{lead} none"),
        None => format!("{lead} {}", known.join(", ")),
    }
}

/// The known word at the smallest edit distance, if that is at most a third of
/// its length (at least one edit, two from four letters on).
pub(super) fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    // a key of a megabyte is nobody's typing error, and the distance is quadratic
    if word.len() > 64 {
        return None;
    }
    let lower = word.to_lowercase();
    let distance = |k: &str| strsim::damerau_levenshtein(&lower, &k.to_lowercase());
    let (d, near) = known.iter().map(|k| (distance(k), *k)).min_by_key(|(d, _)| *d)?;
    let letters = near.chars().count();
    let allowed = (letters / 3).max(if letters >= 4 { 2 } else { 1 });
    // one letter for another is no likeness
    (d <= allowed && d < letters.max(1) || d == 0).then_some(near)
}
