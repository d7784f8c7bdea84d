//! Search in the guide: returns the sections that contain every word of a query, those first whose headings contain
//! them.

use super::{Chapter, Section};

/// The largest number of search results that are shown.
const MOST: usize = 40;
/// The length of the excerpt around the first word of a query, in characters.
const AROUND: usize = 160;

/// A section of the guide that matches a search.
#[derive(Debug)]
pub struct Found<'a> {
    /// The chapter that contains the section.
    pub chapter: &'a Chapter,
    /// The section that matches the search.
    pub section: &'a Section,
    /// An excerpt of the section's text around the first word of the query.
    pub excerpt: String,
}

/// Returns the sections in which every word of `query` occurs, best match first.
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

/// Returns the part of a section's text around a word of the query. A text in lower case may differ in length from
/// the original, so that the position of the word is counted in characters.
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
