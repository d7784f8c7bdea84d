//! A report as one HTML page that needs nothing else: a table of all systems, then a picture and a table for each, then
//! what was found at the limits.

mod stability;

use super::report::{Chapter, picture};
use super::stability::Stability;
use solution::pictures::work_precision;
use solution::{Status, StudyRun};
use std::fmt::Write as _;

/// The page; `peers` says which other programs ran beside.
pub fn html(chapters: &[Chapter], limits: Option<&Stability>, peers: &str) -> String {
    let mut page = format!("{}<style>{}</style>", include_str!("head.html"), include_str!("page.css"));
    if chapters.is_empty() {
        page += "<main>";
    } else {
        page += include_str!("top.html");
        let _ = write!(page, "<p>Other programs, in the same run: {}.</p>", escaped(peers));
        page += &picture(chapters);
        page += &overview(chapters);
        chapters.iter().for_each(|chapter| section(&mut page, chapter));
    }
    if let Some(limits) = limits {
        page += &stability::html(limits);
    }
    page + "</main></html>\n"
}

/// A table with a row for each system.
fn overview(chapters: &[Chapter]) -> String {
    let rows = chapters.iter().map(|chapter| {
        let errors = chapter.series.iter().flat_map(|series| &series.runs).filter_map(|run| run.error_at_end);
        let name = escaped(&chapter.name);
        [
            format!("<a href=\"#{name}\">{name}</a>"),
            escaped(&chapter.title),
            if chapter.outside {
                escaped(&chapter.reference)
            } else {
                format!("<em>{}</em>", escaped(&chapter.reference))
            },
            number(&errors.reduce(f64::min).map_or_else(|| "none".to_owned(), |least| format!("{least:.1e}"))),
            number(&format!("{} of {}", chapter.trusted().0, chapter.trusted().1)),
        ]
    });
    table(&["system", "", "errors are measured against", "least error", "trusted answers"], rows)
}

/// A system: its picture, and the numbers in it.
fn section(page: &mut String, chapter: &Chapter) {
    // Writing to a string does not fail.
    let _ = write!(page, "<section id=\"{}\"><h2>{}</h2>", escaped(&chapter.name), escaped(&chapter.title));
    *page += &work_precision(chapter.all(), Some(&chapter.title), &chapter.reference);
    let runs = chapter.all().flat_map(|series| series.runs.iter().map(|run| row(&series.method, run)));
    let head = ["method", "tolerance or step", "steps", "time / s", "error", "order", "trusted"];
    let _ = write!(page, "<details><summary>Numbers</summary>{}</details></section>", table(&head, runs));
}

fn row(method: &str, run: &StudyRun) -> [String; 7] {
    let shown =
        |value: Option<f64>, digits: usize| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$e}"));
    let error = match run.status {
        Status::Completed => shown(run.error_at_end, 1),
        Status::Stopped => "stopped".to_owned(),
        Status::Failed => "failed".to_owned(),
    };
    let order = run.order.map_or_else(|| "–".to_owned(), |order| format!("{order:.2}"));
    [
        escaped(method),
        number(&shown(run.rtol.or(run.step), 2)),
        number(&run.steps.to_string()),
        number(&format!("{:.1e}", run.wall_seconds)),
        number(&error),
        number(&order),
        trusted(run.trusted),
    ]
}

/// A cell with a verdict; a dash where there is none.
fn trusted(verdict: Option<bool>) -> String {
    match verdict {
        Some(true) => "yes".to_owned(),
        Some(false) => "<span class=\"failed\">no</span>".to_owned(),
        None => "–".to_owned(),
    }
}

/// A table of cells that are HTML already.
fn table<const N: usize>(head: &[&str; N], rows: impl Iterator<Item = [String; N]>) -> String {
    let row = |cells: &[String], tag: &str| {
        let cells: Vec<String> = cells.iter().map(|cell| format!("<{tag}>{cell}</{tag}>")).collect();
        format!("<tr>{}</tr>\n", cells.concat())
    };
    let body: String = rows.map(|cells| row(&cells, "td")).collect();
    let head = row(&head.map(str::to_owned), "th");
    format!("<div class=\"wide\"><table><thead>{head}</thead><tbody>{body}</tbody></table></div>")
}

/// A cell with a number.
fn number(text: &str) -> String {
    format!("<span class=\"number\">{text}</span>")
}

/// Text as HTML can hold it.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::{Finding, Outcome};
    use solution::Series;

    #[test]
    fn a_page_holds_every_run_and_no_markup_of_a_title() {
        let run = StudyRun {
            rtol: Some(1e-3),
            step: None,
            status: Status::Failed,
            trusted: Some(false),
            steps: 7,
            wall_seconds: 1e-3,
            error_at_end: None,
            largest_error: None,
            order: None,
        };
        let series = vec![Series { method: "3 stages".to_owned(), runs: vec![run] }];
        let title = "<script>alert(1)</script>".to_owned();
        let chapter = Chapter {
            name: "relay".to_owned(),
            title,
            reference: "closed form".to_owned(),
            outside: true,
            series,
            peers: Vec::new(),
        };
        let page = html(&[chapter], None, "none");
        assert!(!page.contains("<script"), "{page}");
        assert!(page.contains("<span class=\"number\">failed</span>") && page.contains("3 stages"), "{page}");
        assert!(page.contains("<span class=\"failed\">no</span>"), "{page}");
    }

    #[test]
    fn what_fails_is_shown_as_failed_and_counted() {
        let outcome = |name: &str, passed: bool| Outcome {
            part: "stiff".to_owned(),
            name: name.to_owned(),
            title: String::new(),
            findings: vec![Finding { expected: "9 digits".to_owned(), found: "3 digits".to_owned(), passed }],
            trusted: (name != "refused").then_some(name == "good"),
            seconds: 0.1,
        };
        let outcomes = ["good", "doubted", "refused"].map(|name| outcome(name, true));
        let outcomes = outcomes.into_iter().chain([outcome("bad", false)]).collect();
        let limits = Stability { outcomes, ..Stability::default() };
        let page = html(&[], Some(&limits), "none");
        assert!(page.contains("3 of 4") && page.contains("class=\"failed\""), "{page}");
        assert!(page.contains("<strong>1 of 2</strong> are trusted, of the wrong ones 0 of 1"), "{page}");
        let csv = limits.csv();
        assert!(csv.contains("\"good\",\"9 digits\",\"3 digits\",true,true,0.1\n"), "{csv}");
        assert!(csv.contains("\"refused\",\"9 digits\",\"3 digits\",true,,0.1\n"), "{csv}");
    }
}
