//! A report as one self-contained HTML page: how it was measured, a table of all systems, a chapter for each system,
//! then the stability at the limits.

mod chapters;
mod comparison;
mod stability;

use super::report::{Chapter, picture};
use super::stability::Stability;

/// Another program that solves the example systems, as the report names it.
#[derive(Clone, Debug, PartialEq)]
pub struct Peer {
    /// Name of the program, with its version if the program runs.
    pub name: String,
    /// How to install the other program, if it is not installed.
    pub install: Option<String>,
}

/// Returns the page of the report; `peers` are the other programs that were asked. A `fixed` page has no run times,
/// machine or date.
pub fn html(chapters: &[Chapter], limits: Option<&Stability>, peers: &[Peer], fixed: bool) -> String {
    let mut page = format!("{}<style>{}</style>", include_str!("head.html"), include_str!("page.css"));
    if chapters.is_empty() {
        page += "<main>";
    } else {
        page += include_str!("top.html");
        page += &chapters::conditions(chapters, fixed);
        page += &programs(chapters, peers);
        let (exact, telling): (Vec<&Chapter>, Vec<&Chapter>) =
            chapters.iter().partition(|chapter| chapter.is_exact_for_all());
        page += &picture(chapters, fixed);
        page += &chapters::summary(telling.iter().copied());
        if !fixed {
            page += &comparison::html(telling.iter().copied());
        }
        page += &comparison::verdicts(chapters.iter());
        if !exact.is_empty() {
            page += include_str!("exact.html");
            page += &chapters::summary(exact.iter().copied());
        }
        page += &chapters::reported(chapters);
        page += include_str!("limits.html");
        telling.iter().chain(&exact).for_each(|chapter| chapters::section(&mut page, chapter, fixed));
    }
    if let Some(limits) = limits {
        page += &stability::html(limits);
    }
    page + "</main></html>\n"
}

/// Returns a table of the other programs, with the example systems that each program solved.
fn programs(chapters: &[Chapter], peers: &[Peer]) -> String {
    if peers.is_empty() {
        return "<p>No other programs were asked.</p>".to_owned();
    }
    let rows = peers.iter().map(|peer| {
        let first = peer.name.split(' ').next().unwrap_or(&peer.name);
        let solved =
            chapters.iter().filter(|chapter| chapter.peers.iter().any(|ladder| ladder.method.starts_with(first)));
        let names: Vec<String> = solved.map(|chapter| escaped(&chapter.name)).collect();
        let state = match &peer.install {
            Some(install) => format!("<span class=\"failed\">not installed</span>: {}", escaped(install)),
            None if names.is_empty() => "none of these systems".to_owned(),
            None => names.join(", "),
        };
        [escaped(&peer.name), state]
    });
    include_str!("peers.html").to_owned() + &table(&["other program", "systems"], rows)
}

/// Returns a table cell that shows whether a verdict trusts the answer; a dash if there is no verdict.
fn trusted(verdict: Option<bool>) -> String {
    match verdict {
        Some(true) => "yes".to_owned(),
        Some(false) => "<span class=\"failed\">no</span>".to_owned(),
        None => "–".to_owned(),
    }
}

/// Returns an HTML table; its cells are HTML that needs no escaping.
fn table<const N: usize>(head: &[&str; N], rows: impl Iterator<Item = [String; N]>) -> String {
    let row = |cells: &[String], tag: &str| {
        let cells: Vec<String> = cells.iter().map(|cell| format!("<{tag}>{cell}</{tag}>")).collect();
        format!("<tr>{}</tr>\n", cells.concat())
    };
    let body: String = rows.map(|cells| row(&cells, "td")).collect();
    let head = row(&head.map(str::to_owned), "th");
    format!("<div class=\"wide\"><table><thead>{head}</thead><tbody>{body}</tbody></table></div>")
}

/// Returns a table cell with a number, as HTML.
fn number(text: &str) -> String {
    format!("<span class=\"number\">{text}</span>")
}

/// Escapes text for use in HTML.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests;
