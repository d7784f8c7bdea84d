//! The user's names and texts in messages, joined and shortened.

/// Joins names for a message, at most `SHOWN` of them.
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

/// Shortens a user's text for a message.
pub(super) fn abridged(text: &str) -> String {
    const SHOWN: usize = 60;
    if text.chars().count() <= SHOWN {
        return text.into();
    }
    format!("{}... ({} bytes)", text.chars().take(SHOWN).collect::<String>(), text.len())
}

/// Returns a text as a JSON string, shortened for a message.
pub(super) fn quoted(text: &str) -> String {
    serde_json::Value::from(abridged(text)).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_listed_until_there_are_too_many() {
        assert_eq!(listed([]), "nothing");
        assert_eq!(listed(["a"]), "`a`");
        assert_eq!(listed(["a", "b"]), "one of `a`, `b`");
        assert!(listed(["a"; 1000]).ends_with("`a`, ..."));
    }

    #[test]
    fn a_long_text_is_cut_between_letters() {
        assert_eq!(abridged(&"\u{e9}".repeat(60)), "\u{e9}".repeat(60));
        assert_eq!(abridged(&"\u{e9}".repeat(61)), format!("{}... (122 bytes)", "\u{e9}".repeat(60)));
    }
}
