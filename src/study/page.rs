//! A report as one HTML page that needs nothing else: a table of all systems, then a picture and a table for each.

use super::report::Chapter;
use crate::solution::pictures::work_precision;
use crate::solution::{Status, StudyRun};
use std::fmt::Write as _;

/// The page.
pub fn html(chapters: &[Chapter]) -> String {
    let mut page =
        format!("{}<style>{}</style>{}", include_str!("head.html"), include_str!("page.css"), include_str!("top.html"));
    for chapter in chapters {
        let best = chapter
            .series
            .iter()
            .flat_map(|series| &series.runs)
            .filter_map(|run| run.error_at_end)
            .fold(f64::NAN, f64::min);
        // Writing to a string does not fail.
        let _ = writeln!(
            page,
            "<tr><td><a href=\"#{0}\">{0}</a></td><td>{1}</td><td>{2}</td><td class=\"number\">{best:.1e}</td></tr>",
            escaped(&chapter.name),
            escaped(&chapter.title),
            escaped(&chapter.reference)
        );
    }
    page += "</tbody></table></div>";
    for chapter in chapters {
        let _ = write!(page, "<section id=\"{}\"><h2>{}</h2>", escaped(&chapter.name), escaped(&chapter.title));
        page += &work_precision(&chapter.series, Some(&chapter.title), &chapter.reference);
        page += "<details><summary>Numbers</summary><div class=\"wide\"><table><thead><tr><th>method</th><th>tolerance or step</th>\
                 <th>steps</th><th>time / s</th><th>error</th><th>order</th></tr></thead><tbody>";
        for series in &chapter.series {
            for run in &series.runs {
                row(&mut page, &series.method, run);
            }
        }
        page += "</tbody></table></div></details></section>";
    }
    page + "</main></html>\n"
}

fn row(page: &mut String, method: &str, run: &StudyRun) {
    let number =
        |value: Option<f64>, digits: usize| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$e}"));
    let error = match run.status {
        Status::Completed => number(run.error_at_end, 1),
        Status::Stopped => "stopped".to_owned(),
        Status::Failed => "failed".to_owned(),
    };
    let order = run.order.map_or_else(|| "–".to_owned(), |order| format!("{order:.2}"));
    let _ = writeln!(
        page,
        "<tr><td>{}</td><td class=\"number\">{}</td><td class=\"number\">{}</td><td class=\"number\">{:.1e}</td>\
         <td class=\"number\">{error}</td><td class=\"number\">{order}</td></tr>",
        escaped(method),
        number(run.rtol.or(run.step), 2),
        run.steps,
        run.wall_seconds
    );
}

/// Text as HTML can hold it.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solution::Series;

    #[test]
    fn a_page_holds_every_run_and_no_markup_of_a_title() {
        let run = StudyRun {
            rtol: Some(1e-3),
            step: None,
            status: Status::Failed,
            steps: 7,
            wall_seconds: 1e-3,
            error_at_end: None,
            largest_error: None,
            order: None,
        };
        let series = vec![Series { method: "3 stages".to_owned(), runs: vec![run] }];
        let title = "<script>alert(1)</script>".to_owned();
        let chapter = Chapter { name: "relay".to_owned(), title, reference: "closed form".to_owned(), series };
        let page = html(&[chapter]);
        assert!(!page.contains("<script"), "{page}");
        assert!(page.contains("<td class=\"number\">failed</td>") && page.contains("3 stages"), "{page}");
    }
}
