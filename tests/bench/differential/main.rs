//! The differential fuzz: `cargo bench --bench differential` for 20,000 random problems. Environment variables:
//! `COUNT=500 SEED=7 KIND=circuit` select problems, `REFERENCE=1` compares all of them with an independent method,
//! `SECONDS=3` limits the time of each solve, `THREADS=2` solves problems in parallel, `TELL=1` reports each wrong
//! run immediately, and `FAILURES=folder` (or the folder as an argument) stores wrong runs as specifications for `dvi
//! solve`; without it they go to a temporary folder. `KIND=derivatives OF=circuit,sets` compares derivatives of
//! problems of these kinds with central differences of runs.

#[path = "mod.rs"]
mod differential;

use differential::derivatives::{self, Finding};
use differential::{Campaign, Kind};
use std::time::{Duration, Instant};

fn main() {
    let number = |name: &str, default| std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default);
    let chosen = std::env::var("KIND").ok();
    if chosen.as_deref() == Some("derivatives") {
        return compare_derivatives(&number);
    }
    let is_chosen = |kind: &Kind| chosen.as_ref().is_none_or(|names| names.split(',').any(|name| name == kind.name()));
    let kinds: Vec<Kind> = Kind::ALL.into_iter().filter(is_chosen).collect();
    if kinds.is_empty() {
        let names: Vec<&str> = Kind::ALL.iter().map(|kind| kind.name()).collect();
        eprintln!("no such kind; there are {}, derivatives", names.join(", "));
        std::process::exit(2);
    }
    let named = std::env::args().skip(1).find(|argument| !argument.starts_with("--"));
    let folder = named
        .or_else(|| std::env::var("FAILURES").ok())
        .map_or_else(|| std::env::temp_dir().join(format!("dvi-differential-{}", std::process::id())), Into::into);
    let campaign = Campaign {
        count: number("COUNT", 20_000),
        seed: number("SEED", 1),
        kinds,
        time: Duration::from_secs(number("SECONDS", 3)),
        reference_every: number("REFERENCE", 10),
        failures: Some(folder.clone()),
        threads: number("THREADS", 1) as usize,
        tells: number("TELL", 0) > 0,
    };
    println!("{} problems from seed {}; wrong runs go to {}", campaign.count, campaign.seed, folder.display());
    let began = Instant::now();
    let tally = campaign.run();
    println!("{tally}in {:.0} s", began.elapsed().as_secs_f64());
    if tally.panics() + tally.not_finite() > 0 || tally.silent() > 0 {
        std::process::exit(1);
    }
}

/// Compares derivatives with central differences of runs, and exits with an error if one is silently wrong or forward
/// and adjoint derivatives differ.
fn compare_derivatives(number: &dyn Fn(&str, u64) -> u64) {
    let of = std::env::var("OF").ok();
    let is_chosen = |kind: &Kind| of.as_ref().is_none_or(|names| names.split(',').any(|name| name == kind.name()));
    let kinds: Vec<Kind> = derivatives::KINDS.into_iter().filter(is_chosen).collect();
    let (began, time) = (Instant::now(), Duration::from_secs(number("SECONDS", 3)));
    let (count, seed, threads) = (number("COUNT", 2_000), number("SEED", 1), number("THREADS", 1) as usize);
    let tally = derivatives::run(count, seed, &kinds, time, threads, number("TELL", 0) > 0);
    println!("{tally}in {:.0} s", began.elapsed().as_secs_f64());
    if tally.of(Finding::Silent) > 0 || !tally.unlike.is_empty() {
        std::process::exit(1);
    }
}
