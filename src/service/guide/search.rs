//! Search in the guide: the sections that have every word, those first whose heading has them.

use super::{Chapter, Section};

/// Results that are shown.
const MOST: usize = 40;
/// Characters of text around the first word that was found.
const AROUND: usize = 160;

/// A section that was found.
#[derive(Debug)]
pub struct Found<'a> {
    /// Its chapter.
    pub chapter: &'a Chapter,
    /// The section.
    pub section: &'a Section,
    /// The text around the first word.
    pub excerpt: String,
}

/// The sections in which every word of a query occurs.
pub fn search<'a>(chapters: &'a [Chapter], query: &str) -> Vec<Found<'a>> {
    let query = query.to_lowercase();
    let words: Vec<&str> = query.split_whitespace().collect();
    if words.is_empty() {
        return Vec::new();
    }
    let sections = chapters.iter().flat_map(|chapter| chapter.sections.iter().map(move |section| (chapter, section)));
    let mut found: Vec<(usize, Found<'_>)> = sections
        .filter_map(|(chapter, section)| {
            let (heading, text) = (section.heading.to_lowercase(), section.text.to_lowercase());
            words.iter().all(|word| heading.contains(word) || text.contains(word)).then(|| {
                let missed = words.iter().filter(|word| !heading.contains(**word)).count();
                let whole = usize::from(heading != query);
                (
                    2 * missed + whole,
                    Found {
                        chapter,
                        section,
                        excerpt: excerpt(&section.text, &text, words.first().copied().unwrap_or_default()),
                    },
                )
            })
        })
        .collect();
    found.sort_by_key(|&(rank, _)| rank);
    found.into_iter().take(MOST).map(|(_, found)| found).collect()
}

/// The text around a word. Lower case may have other lengths: the place is counted in characters.
fn excerpt(text: &str, lower: &str, word: &str) -> String {
    let place = lower.find(word).map_or(0, |at| lower.get(..at).map_or(0, |before| before.chars().count()));
    let start = place.saturating_sub(AROUND / 3);
    let shown: String = text.chars().skip(start).take(AROUND).collect();
    if start > 0 { format!("… {shown}") } else { shown }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guide::markdown;

    #[test]
    fn headings_come_before_texts_and_all_words_count() {
        let chapters = [markdown::chapter("a", "# One\n\nof steps\n\n## Steps\n\nlong ones\n")];
        let found = search(&chapters, "steps");
        assert_eq!(found.iter().map(|one| one.section.id.as_str()).collect::<Vec<_>>(), ["steps", "one"]);
        assert_eq!(search(&chapters, "steps long").len(), 1);
        assert!(search(&chapters, " ").is_empty());
    }
}
