//! A short form of the differential fuzz test: random problems, each solved in several ways whose results must agree.
//! The long form is `cargo bench --bench differential`.

#[path = "bench/differential/closed_forms.rs"]
mod closed_forms;
#[path = "bench/differential/mod.rs"]
mod differential;

use differential::derivatives::{self, Finding};
use differential::{Campaign, Kind};
use std::time::Duration;

/// Permitted fraction of correct results that the verdict of a solve reports as not to be trusted. Circuits, for which
/// the fraction is larger, are left out.
const FALSE_ALARMS: f64 = 0.02;

#[test]
fn what_is_solved_in_many_ways_has_one_answer() {
    let campaign = Campaign {
        count: 500,
        seed: 1,
        kinds: Kind::ALL.to_vec(),
        time: Duration::from_secs(1),
        reference_every: 10,
        failures: None,
        tells: false,
        threads: std::thread::available_parallelism().map_or(1, usize::from),
    };
    let tally = campaign.run();
    println!("{tally}");
    assert_eq!(tally.panics(), 0, "a solve panicked");
    assert_eq!(tally.not_finite(), 0, "an answer is not finite");
    assert_eq!(tally.silent(), 0, "problems are wrong in silence:\n{tally}");
    let kinds: Vec<Kind> = Kind::ALL.into_iter().filter(|kind| *kind != Kind::Circuit).collect();
    let alarms = tally.false_alarms_of(&kinds);
    assert!(alarms <= FALSE_ALARMS, "{:.1} % of the right answers are doubted:\n{tally}", 100.0 * alarms);
    assert!(tally.apart() <= 0.2, "{} of the problems decide nothing", tally.apart());
}

#[test]
fn derivatives_are_those_of_differences_in_both_modes() {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let tally = derivatives::run(25, 1, &derivatives::KINDS, Duration::from_secs(1), threads, false);
    println!("{tally}");
    assert_eq!(tally.of(Finding::Silent), 0, "derivatives are wrong in silence:\n{tally}");
    assert!(tally.unlike.is_empty(), "the modes differ:\n{tally}");
    assert!(tally.of(Finding::Right) >= 25, "few derivatives were compared:\n{tally}");
    assert!(tally.dropped() <= 0.1, "many derivatives have nothing to be compared with:\n{tally}");
}

/// Problems with switches that a solver easily misses:
/// - within a step whose stages are solved simultaneously;
/// - within a step that begins at a time found by the search for the end of the previous step;
/// - where hidden constraints determine variables in a block of the set `K`, and at the vertices of such a block;
/// - where a ripple is too small for the stages of a step to resolve;
/// - where all nodes of an obstacle problem meet the obstacle at once;
/// - where a variable that hidden constraints determine is zero in the middle of a step;
/// - where output times lie within a transient after a switch;
/// - where the error estimate is zero by chance;
/// - where a step that ends at a switch has a curved block of `K`, such as a ball, beside polyhedral blocks.
#[test]
fn switches_that_were_passed_over_are_not() {
    let circuits = [479, 5375, 11423, 12629, 14204].map(|seed| (Kind::Circuit, seed));
    let filippov = [1965, 8643, 16059].map(|seed| (Kind::Filippov, seed));
    let sets = [3739, 3793, 4270, 8491, 13054, 81678].map(|seed| (Kind::Sets, seed));
    let others = circuits.into_iter().chain(filippov).chain([(Kind::Obstacle, 11852), (Kind::Complementarity, 52080)]);
    for (kind, seed) in others.chain(sets) {
        let campaign = Campaign {
            count: 1,
            seed,
            kinds: vec![kind],
            time: Duration::from_secs(10),
            reference_every: 1,
            failures: None,
            tells: false,
            threads: 1,
        };
        let tally = campaign.run();
        assert_eq!(tally.silent(), 0, "{} {seed} is wrong in silence:\n{tally}", kind.name());
    }
}
