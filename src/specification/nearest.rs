//! "Did you mean": the valid name nearest to what was written, by edits (Damerau 1964).

/// Names longer than this are never typing errors of ours, and the comparison is quadratic in the length.
const LONGEST: usize = 64;

/// The candidate nearest to `name`, if a typing error could explain the difference: at most one edit for each three
/// letters, counting a swap of neighbours as one.
pub(super) fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let letters = name.chars().count();
    if letters > LONGEST {
        return None;
    }
    candidates
        .into_iter()
        .filter(|candidate| candidate.len() <= LONGEST)
        .map(|candidate| (strsim::damerau_levenshtein(&name.to_lowercase(), &candidate.to_lowercase()), candidate))
        .filter(|&(edits, candidate)| edits <= letters.max(candidate.len()).div_ceil(3) && edits < letters)
        .min_by_key(|&(edits, _)| edits)
        .map(|(_, candidate)| candidate)
}

/// Names as a person would list them.
pub(super) fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 20;
    let mut names = names.into_iter();
    let mut list: Vec<String> = names.by_ref().take(SHOWN).map(|name| format!("`{name}`")).collect();
    if names.next().is_some() {
        list.push("...".into());
    }
    match list.len() {
        0 => "nothing".into(),
        1 => list.remove(0),
        _ => format!("one of {}", list.join(", ")),
    }
}

/// A user's text, cut to what a message can carry.
pub(super) fn abridged(text: &str) -> String {
    const SHOWN: usize = 60;
    if text.chars().count() <= SHOWN {
        return text.into();
    }
    format!("{}... ({} bytes)", text.chars().take(SHOWN).collect::<String>(), text.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swapped_and_missing_letters_find_their_name() {
        assert_eq!(nearest("lsc", ["dvi", "lcs"]), Some("lcs"));
        assert_eq!(nearest("inital", ["rate", "initial"]), Some("initial"));
        assert_eq!(nearest("RATE", ["rate", "initial"]), Some("rate"));
    }

    #[test]
    fn a_different_word_finds_nothing() {
        assert_eq!(nearest("colour", ["rate", "initial"]), None);
        assert_eq!(nearest("q", ["x", "v"]), None);
        assert_eq!(nearest(&"x".repeat(1_000_000), ["x"]), None);
    }
}
