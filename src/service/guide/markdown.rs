//! Conversion of a chapter of the guide from Markdown to HTML: headings get ids, links between Markdown files become
//! links between chapters, and each example specification gets a link that opens it on the page of the service.

use super::{Chapter, Section, id_of};
use pulldown_cmark::{CodeBlockKind, CowStr, Event, Options, Parser, Tag, TagEnd, html};

/// Converts a Markdown file of the guide to a chapter; `name` is the name of the file.
pub fn chapter(name: &str, text: &str) -> Chapter {
    let options = Options::ENABLE_TABLES | Options::ENABLE_HEADING_ATTRIBUTES;
    let mut events: Vec<Event<'_>> = Parser::new_ext(text, options).collect();
    let sections = sections(&events);
    let mut ids = sections.iter().map(|section| CowStr::from(section.id.clone()));
    let title = sections.first().map(|section| section.heading.clone()).unwrap_or_default();
    for event in &mut events {
        match event {
            Event::Start(Tag::Heading { id, .. }) => *id = ids.next(),
            Event::Start(Tag::Link { dest_url, .. }) => *dest_url = address(dest_url).into(),
            _ => {}
        }
    }
    let mut body = String::with_capacity(2 * text.len());
    html::push_html(&mut body, with_links_to_the_page(events).into_iter());
    // Tables and code blocks wider than the screen scroll by themselves; `tabindex` makes them scroll by keys too.
    let body = body.replace("<table>", "<div class=\"wide\" tabindex=\"0\"><table>");
    let body = body.replace("</table>", "</table></div>").replace("<pre>", "<pre tabindex=\"0\">");
    Chapter { name: name.to_owned(), title, html: body, sections }
}

/// Returns the sections of a chapter: each heading, and the plain text below it.
fn sections(events: &[Event<'_>]) -> Vec<Section> {
    let mut sections: Vec<Section> = Vec::new();
    let mut in_heading = false;
    for event in events {
        match event {
            Event::Start(Tag::Heading { .. }) => {
                in_heading = true;
                sections.push(Section { id: String::new(), heading: String::new(), text: String::new() });
            }
            Event::End(TagEnd::Heading(_)) => {
                in_heading = false;
                if let Some(section) = sections.last_mut() {
                    section.id = id_of(&section.heading);
                }
            }
            Event::Text(text) | Event::Code(text) => {
                if let Some(section) = sections.last_mut() {
                    let into = if in_heading { &mut section.heading } else { &mut section.text };
                    into.push_str(text);
                    if !in_heading {
                        into.push(' ');
                    }
                }
            }
            _ => {}
        }
    }
    sections
}

/// Returns the URL of a chapter for a link between files: `methods.md#radau-iia` becomes `/docs/methods#radau-iia`.
fn address(link: &str) -> String {
    match link.split_once(".md") {
        Some((name, rest)) if !name.contains('/') => format!("/docs/{name}{rest}"),
        _ => link.to_owned(),
    }
}

/// Inserts a link before each example specification, which opens it on the page of the service.
fn with_links_to_the_page(events: Vec<Event<'_>>) -> Vec<Event<'_>> {
    let mut made = Vec::with_capacity(events.len());
    let mut open: Option<(usize, String)> = None;
    for event in events {
        match &event {
            Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(language))) if &**language == "json" => {
                open = Some((made.len(), String::new()));
            }
            Event::Text(text) => {
                if let Some((_, block)) = &mut open {
                    block.push_str(text);
                }
            }
            Event::End(TagEnd::CodeBlock) => {
                if let Some((place, block)) = open.take().filter(|(_, block)| block.contains("\"problem\"")) {
                    let link =
                        format!("<p class=\"open\"><a href=\"/#s={}\">Open this on the page</a></p>\n", packed(&block));
                    made.insert(place, Event::Html(link.into()));
                }
            }
            _ => {}
        }
        made.push(event);
    }
    made
}

/// Encodes a specification for the URL fragment `#s=`: deflated (RFC 1951) without compression, in base64url (RFC
/// 4648, section 5).
fn packed(text: &str) -> String {
    const LONGEST: usize = 0xffff;
    let chunks: Vec<&[u8]> = text.as_bytes().chunks(LONGEST).collect();
    let mut bytes = Vec::with_capacity(text.len() + 5 * chunks.len());
    for (i, chunk) in chunks.iter().enumerate() {
        let length = chunk.len() as u16;
        bytes.push(u8::from(i + 1 == chunks.len()));
        bytes.extend(length.to_le_bytes());
        bytes.extend((!length).to_le_bytes());
        bytes.extend_from_slice(chunk);
    }
    base64url(&bytes)
}

fn base64url(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
    let mut text = String::with_capacity(bytes.len() * 4 / 3 + 4);
    for chunk in bytes.chunks(3) {
        let bits = chunk.iter().fold(0_u32, |bits, &byte| bits << 8 | u32::from(byte)) << (8 * (3 - chunk.len()));
        for k in 0..=chunk.len() {
            let digit = DIGITS.get((bits >> (18 - 6 * k) & 63) as usize).copied().unwrap_or_default();
            text.push(char::from(digit));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_has_the_vectors_of_the_standard() {
        // Test vectors of RFC 4648, section 10, without padding.
        for (text, wanted) in
            [("", ""), ("f", "Zg"), ("fo", "Zm8"), ("foo", "Zm9v"), ("foob", "Zm9vYg"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64url(text.as_bytes()), wanted);
        }
    }

    #[test]
    fn headings_have_ids_and_files_become_addresses() {
        let chapter = chapter("x", "# Title\n\nSee [there](methods.md#radau-iia).\n\n## `rtol` and `atol`\n\nTwo.\n");
        assert_eq!(chapter.title, "Title");
        assert!(chapter.html.contains("href=\"/docs/methods#radau-iia\""), "{}", chapter.html);
        assert!(chapter.html.contains("<h2 id=\"rtol-and-atol\">"), "{}", chapter.html);
        assert_eq!(chapter.sections[1].text.trim(), "Two.");
    }
}
