//! Tests of the plots, which are parsed by an independent XML parser.

use super::*;
use crate::{Failure, Reason, Series, Study, StudyRun, Trajectory};
use roxmltree::Node;

fn solution(t: Vec<f64>, columns: Vec<Vec<f64>>) -> Solution {
    let field = |(k, values)| Field { name: format!("x{k}"), values };
    let trajectory = Trajectory { t, fields: columns.into_iter().enumerate().map(field).collect(), events: vec![] };
    Solution { status: Status::Completed, trajectory, ..Solution::default() }
}

/// Draws a solution, parses the SVG and passes its root element to `look`.
#[track_caller]
fn drawn<T>(solution: &Solution, label: Option<&str>, look: impl FnOnce(Node<'_, '_>) -> T) -> T {
    let mut picture = Vec::new();
    write_svg(solution, label, &mut picture).unwrap();
    let picture = String::from_utf8(picture).unwrap();
    for wrong in ["NaN", "inf", "-0,", "-0\""] {
        assert!(!picture.contains(wrong), "{wrong} in {picture}");
    }
    let document = roxmltree::Document::parse(&picture).unwrap_or_else(|error| panic!("{error} in {picture}"));
    assert!(document.root_element().has_tag_name(("http://www.w3.org/2000/svg", "svg")));
    look(document.root_element())
}

/// Returns the points of every line in the plot, in order.
fn lines(picture: Node<'_, '_>) -> Vec<Vec<(f64, f64)>> {
    let lines = picture.descendants().filter(|node| node.has_tag_name("polyline"));
    let number = |text: &str| text.parse::<f64>().unwrap();
    let point = |text: &str| text.split_once(',').map(|(x, y)| (number(x), number(y))).unwrap();
    lines.map(|line| line.attribute("points").unwrap().split_whitespace().map(point).collect()).collect()
}

/// Returns the number of elements of the plot with a given class.
fn count(picture: Node<'_, '_>, class: &str) -> usize {
    picture.descendants().filter(|node| node.attribute("class") == Some(class)).count()
}

/// Returns all text in the plot.
fn words(picture: Node<'_, '_>) -> String {
    picture.descendants().filter(Node::is_text).filter_map(|node| node.text()).collect::<Vec<_>>().join("|")
}

#[test]
fn every_field_has_a_line_in_a_panel_of_its_own() {
    let volts = vec![10.0, -10.0, 0.0];
    let amperes = vec![1e-3, 0.0, 0.5e-3];
    drawn(&solution(vec![0.0, 1.0, 2.0], vec![volts, amperes]), Some("A bridge"), |picture| {
        let lines = lines(picture);
        assert_eq!(lines.len(), 2);
        for line in &lines {
            let x: Vec<f64> = line.iter().map(|point| point.0).collect();
            assert_eq!(x, [LEFT, (LEFT + RIGHT) / 2.0, RIGHT]);
        }
        let (volts, amperes) = (&lines[0], &lines[1]);
        assert!(volts[0].1 < volts[2].1 && volts[2].1 < volts[1].1, "up is more: {volts:?}");
        let span = |line: &[(f64, f64)]| (line[0].1 - line[1].1).abs();
        assert!((span(volts) - span(amperes)).abs() < 0.15, "each on a scale of its own");
        assert!(volts.iter().all(|v| amperes.iter().all(|i| v.1 < i.1)), "one below the other");
        let words = words(picture);
        assert!(words.contains("A bridge") && words.contains("×10⁻³"), "{words}");
    });
}

#[test]
fn many_fields_share_panels_with_their_likes_and_the_rest_is_counted() {
    let columns = |n: i32| (0..n).map(|k| vec![10f64.powi(k % 5 * 3), 0.0]).collect();
    drawn(&solution(vec![0.0, 1.0], columns(20)), None, |picture| {
        assert_eq!((lines(picture).len(), count(picture, "name")), (20, 7));
        let tops: Vec<f64> = lines(picture).iter().map(|line| line[0].1).collect();
        // The first panel has three of the four fields of magnitude `10^12`.
        assert!(tops[0] == tops[1] && tops[1] == tops[2] && tops[2] < tops[3], "{tops:?}");
    });
    drawn(&solution(vec![0.0, 1.0], columns(200)), None, |picture| {
        assert_eq!((lines(picture).len(), count(picture, "name")), (MOST_PANELS * MOST_LINES, MOST_PANELS));
        assert!(words(picture).contains("48 of 200 fields"), "{}", words(picture));
    });
}

#[test]
fn switches_are_marks_at_their_times() {
    let mut solution = solution(vec![0.0, 10.0], vec![vec![0.0, 1.0]]);
    let event = |t| Event { t, kind: EventKind::Activated, of: "x0".to_owned() };
    solution.trajectory.events = vec![event(2.5), event(2.5), event(5.0), event(11.0)];
    drawn(&solution, None, |picture| {
        let marks = picture.descendants().filter(|node| node.attribute("class") == Some("switch"));
        let places: Vec<f64> = marks.map(|mark| mark.attribute("x1").unwrap().parse().unwrap()).collect();
        assert_eq!(places, [LEFT + 0.25 * (RIGHT - LEFT), LEFT + 0.5 * (RIGHT - LEFT)]);
        assert!(words(picture).contains("4 switches of the active face"));
    });
    solution.trajectory.events[1].kind = EventKind::Impact;
    drawn(&solution, None, |picture| assert!(words(picture).contains("4 changes of contacts")));
}

#[test]
fn what_has_no_shape_is_drawn_all_the_same() {
    drawn(&solution(vec![], vec![]), None, |picture| assert!(words(picture).contains("nothing to show")));
    drawn(&solution(vec![], vec![vec![]]), None, |picture| assert!(lines(picture).is_empty()));
    drawn(&solution(vec![0.0, 1.0], vec![]), None, |picture| assert!(lines(picture).is_empty()));
    drawn(&solution(vec![3.0], vec![vec![4.0]]), None, |picture| assert_eq!(lines(picture)[0].len(), 2));
    drawn(&solution(vec![0.0, 1.0], vec![vec![7.0; 2]]), None, |picture| {
        assert_eq!(lines(picture)[0][0].1, lines(picture)[0][1].1);
    });
}

#[test]
fn the_largest_and_the_smallest_doubles_stay_within_their_panel() {
    let columns = vec![vec![f64::MIN, f64::MAX], vec![-1e-300, 1e-300], vec![0.0, 5e-324], vec![1e300, 1e300]];
    for t in [vec![0.0, 1e-300], vec![0.0, 1e300], vec![f64::MIN, f64::MAX], vec![1.0, 1.0 + f64::EPSILON]] {
        drawn(&solution(t, columns.clone()), None, |picture| {
            let height: f64 = picture.attribute("height").unwrap().parse().unwrap();
            for (x, y) in lines(picture).concat() {
                assert!((LEFT..=RIGHT).contains(&x) && (TITLE..=height - FOOT).contains(&y), "({x}, {y})");
            }
        });
    }
}

#[test]
fn a_million_points_are_thinned_and_their_spike_stays() {
    let t: Vec<f64> = (0..1_000_000).map(f64::from).collect();
    let mut values: Vec<f64> = t.iter().map(|t| (t * 1e-5).sin()).collect();
    values[123_456] = 9.0;
    drawn(&solution(t, vec![values]), None, |picture| {
        let line = &lines(picture)[0];
        assert!(line.len() < 4 * WIDTH as usize, "{} points", line.len());
        let spike = line.iter().copied().reduce(|a, b| if b.1 < a.1 { b } else { a }).unwrap();
        assert_eq!(spike.0, elements::tenths(LEFT + 0.123_456 * (RIGHT - LEFT)));
    });
}

#[test]
fn what_a_user_wrote_is_text_and_not_markup() {
    let mut solution = solution(vec![0.0, 1.0], vec![vec![0.0, 1.0]]);
    solution.trajectory.fields[0].name = "</svg>&\u{1b}".to_owned();
    drawn(&solution, Some("<script>alert('\u{0}')</script>]]>"), |picture| {
        assert!(picture.descendants().all(|node| !node.has_tag_name("script")));
        let words = words(picture);
        assert!(
            words.contains("<script>alert('\u{fffd}')</script>]]>") && words.contains("</svg>&\u{fffd}"),
            "{words}"
        );
    });
}

#[test]
fn a_solve_that_did_not_reach_its_end_says_so() {
    let mut solution = solution(vec![0.0, 1.0], vec![vec![0.0, 1.0]]);
    solution.status = Status::Failed;
    solution.error = Some(Failure { code: "step_too_small".into(), message: String::new(), time: 1.5, state: vec![] });
    drawn(&solution, None, |picture| assert!(words(picture).contains("failed at t = 1.5: step_too_small")));
}

#[test]
fn a_picture_of_an_answer_that_is_not_trusted_says_why() {
    let mut solution = solution(vec![0.0, 1.0], vec![vec![0.0, 1.0]]);
    drawn(&solution, None, |picture| assert!(!words(picture).contains("trusted")));
    let reason = |code| Reason { code, value: 1.0, allowed: 1e-3, message: String::new() };
    solution.verdict.because = vec![reason(CheckCode::JointDrift), reason(CheckCode::EnergyBalance)];
    drawn(&solution, None, |picture| assert!(words(picture).contains("not trusted: joint drift, energy balance")));
}

#[test]
fn the_picture_of_a_study_names_each_of_its_methods_beside_a_mark_of_its_own() {
    let run = |wall_seconds: f64, error: f64| StudyRun {
        rtol: Some(error),
        step: None,
        status: Status::Completed,
        trusted: Some(error > 1e-3),
        steps: 1,
        wall_seconds,
        error_at_end: Some(error),
        largest_error: None,
        order: None,
    };
    let series = |k: u32| Series {
        method: format!("the method of number {k} at fixed steps"),
        runs: vec![run(1e-3, 1e-2 / f64::from(k + 1)), run(1e-2, 1e-6 / f64::from(k + 1))],
    };
    let series: Vec<Series> = (0..8).map(series).collect();
    let picture = work_precision(&series, None, "the exact values");
    let mut solution = solution(vec![0.0, 1.0], vec![vec![0.0, 1.0]]);
    solution.study = Some(Study { reference: String::new(), series, picture });
    drawn(&solution, None, |picture| {
        assert_eq!(lines(picture).iter().map(Vec::len).collect::<Vec<_>>(), [2; 8]);
        let is_hollow = |node: &Node<'_, '_>| node.attribute("class").is_some_and(|class| class.starts_with("hollow "));
        assert_eq!(picture.descendants().filter(is_hollow).count(), 8, "one run of each method is not trusted");
        let words = words(picture);
        assert!(words.contains("hollow marks: answers that are not trusted"), "{words}");
        for k in 0..8 {
            assert!(words.contains(&format!("the method of number {k} at fixed steps")), "{words}");
        }
        let mut marks: Vec<(String, String)> = Vec::new();
        for named in picture.descendants().filter(|node| node.attribute("class") == Some("name")) {
            let spans: Vec<Node<'_, '_>> = named.children().filter(|node| node.has_tag_name("tspan")).collect();
            assert!(spans.len() <= 4, "two names of this length have room in a row");
            marks.extend(spans.chunks(2).map(|pair| {
                (pair[0].attribute("class").unwrap().to_owned(), pair[0].text().unwrap().trim().to_owned())
            }));
        }
        marks.sort();
        marks.dedup();
        assert_eq!(marks.len(), 8);
    });
}
