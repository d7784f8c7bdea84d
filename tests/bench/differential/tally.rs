//! The table of a campaign of random problems: for each kind, the numbers of problems, of those not judged, and of
//! runs by judgement.

use super::experiment::Experiment;
use super::judgement::{Apart, Finding, Judgement};
use super::problem::Kind;
use super::solving::Outcome;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, Formatter, Result, Write};

/// Counts by kind of problem, and the seeds of problems with wrong runs.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    problems: BTreeMap<Kind, u64>,
    apart: BTreeMap<(Kind, Apart), u64>,
    runs: BTreeMap<(Kind, Finding), u64>,
    /// Seeds of the problems that have a run with the judgement that is the key.
    seeds: BTreeMap<(Kind, Finding), BTreeSet<u64>>,
    references: BTreeMap<Kind, u64>,
    /// Problems on which the independent method disagrees with all runs.
    alone: BTreeSet<(Kind, u64)>,
    /// For each judgement, counts of the error or warning codes for which correct runs were not trusted, runs failed
    /// or specifications were rejected.
    reasons: BTreeMap<(Finding, String), u64>,
}

impl Tally {
    /// Adds a problem to the counts; returns a description of its wrong runs, empty if there are none.
    pub fn add(&mut self, kind: Kind, seed: u64, experiment: &Experiment, judgement: &Judgement) -> String {
        *self.problems.entry(kind).or_default() += 1;
        *self.references.entry(kind).or_default() += u64::from(judgement.by_reference);
        let mut line = String::new();
        for (run, (finding, far)) in experiment.runs.iter().zip(&judgement.findings) {
            // A panic, a value that is not finite, a rejection or a timeout is a fault of any problem, judged or not.
            let always =
                matches!(finding, Finding::Panicked | Finding::NotFinite | Finding::Refused | Finding::TimedOut);
            if judgement.apart.is_some() && !always {
                continue;
            }
            *self.runs.entry((kind, *finding)).or_default() += 1;
            if matches!(finding, Finding::Right | Finding::Behind | Finding::Skipped) {
                continue;
            }
            self.seeds.entry((kind, *finding)).or_default().insert(seed);
            let reason = match &run.outcome {
                Outcome::Answered(answer) => {
                    answer.because.iter().map(|code| code.name()).collect::<Vec<_>>().join(" ")
                }
                Outcome::Refused(code) | Outcome::Stopped(code) | Outcome::Failed(code) => code.clone(),
                Outcome::Skipped | Outcome::Panicked | Outcome::Hung => format!("{:?}", run.outcome),
            };
            let name = Finding::ALL.iter().find(|(other, _)| other == finding).map_or("", |(_, name)| name);
            let _ = write!(line, "\n    {name} {}: {reason} {far:.3e} (accuracy {:.1e})", run.label, run.accuracy);
            *self.reasons.entry((*finding, reason)).or_default() += 1;
        }
        if let Some(apart) = judgement.apart {
            *self.apart.entry((kind, apart)).or_default() += 1;
        }
        if judgement.reference_alone && judgement.apart.is_none() {
            self.alone.insert((kind, seed));
        }
        if line.is_empty() {
            return line;
        }
        let by = if judgement.by_reference { ", by reference" } else { "" };
        format!("{} {seed}: kappa {:.1e}{by}{line}", kind.name(), experiment.kappa)
    }

    /// Adds the counts of another table.
    pub fn merge(&mut self, other: Self) {
        fn add<K: Ord>(to: &mut BTreeMap<K, u64>, from: BTreeMap<K, u64>) {
            from.into_iter().for_each(|(key, count)| *to.entry(key).or_default() += count);
        }
        add(&mut self.problems, other.problems);
        add(&mut self.apart, other.apart);
        add(&mut self.runs, other.runs);
        add(&mut self.references, other.references);
        add(&mut self.reasons, other.reasons);
        other.seeds.into_iter().for_each(|(key, seeds)| self.seeds.entry(key).or_default().extend(seeds));
        self.alone.extend(other.alone);
    }

    /// Returns the number of runs of all kinds of problems with the given judgement.
    pub fn runs(&self, finding: Finding) -> u64 {
        self.runs.iter().filter(|((_, other), _)| *other == finding).map(|(_, count)| count).sum()
    }

    /// Returns the number of problems with silently wrong runs.
    pub fn silent(&self) -> usize {
        self.silent_of(&Kind::ALL)
    }

    /// Returns the number of problems of the given kinds with silently wrong runs.
    pub fn silent_of(&self, kinds: &[Kind]) -> usize {
        kinds.iter().filter_map(|kind| self.seeds.get(&(*kind, Finding::Silent))).map(BTreeSet::len).sum()
    }

    pub fn panics(&self) -> u64 {
        self.runs(Finding::Panicked)
    }

    pub fn not_finite(&self) -> u64 {
        self.runs(Finding::NotFinite)
    }

    /// Returns the fraction of correct runs that are not trusted.
    pub fn false_alarms(&self) -> f64 {
        self.false_alarms_of(&Kind::ALL)
    }

    /// Returns the fraction of correct runs of the given kinds of problems that are not trusted.
    pub fn false_alarms_of(&self, kinds: &[Kind]) -> f64 {
        let runs = |finding| kinds.iter().filter_map(|kind| self.runs.get(&(*kind, finding))).sum::<u64>() as f64;
        let (alarms, right) = (runs(Finding::FalseAlarm), runs(Finding::Right));
        if alarms == 0.0 { 0.0 } else { alarms / (alarms + right) }
    }

    /// Returns the fraction of problems that are not judged.
    pub fn apart(&self) -> f64 {
        let apart: u64 = self.apart.values().sum();
        apart as f64 / self.problems.values().sum::<u64>().max(1) as f64
    }
}

impl Display for Tally {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(
            f,
            "{:16}{:>9}{:>10}{:>10}{:>11}{:>7}",
            "kind", "problems", "reference", "sensitive", "not unique", "alone"
        )?;
        for (_, name) in Finding::ALL {
            write!(f, "{name:>11}")?;
        }
        writeln!(f)?;
        for (kind, problems) in &self.problems {
            let apart = |apart| self.apart.get(&(*kind, apart)).copied().unwrap_or(0);
            let references = self.references.get(kind).copied().unwrap_or(0);
            let (sensitive, alone) = (apart(Apart::Sensitive), apart(Apart::Alone));
            write!(
                f,
                "{:16}{problems:>9}{references:>10}{sensitive:>10}{:>11}{alone:>7}",
                kind.name(),
                apart(Apart::NotUnique)
            )?;
            for (finding, _) in Finding::ALL {
                write!(f, "{:>11}", self.runs.get(&(*kind, finding)).copied().unwrap_or(0))?;
            }
            writeln!(f)?;
        }
        writeln!(
            f,
            "right but not trusted: {:.2} %; counted apart: {:.1} % of the problems",
            100.0 * self.false_alarms(),
            100.0 * self.apart()
        )?;
        for ((finding, reason), count) in &self.reasons {
            let name = Finding::ALL.iter().find(|(other, _)| other == finding).map_or("", |(_, name)| name);
            writeln!(f, "  {name} ({reason}): {count} runs")?;
        }
        for (finding, name) in Finding::ALL {
            for kind in Kind::ALL {
                let Some(seeds) = self.seeds.get(&(kind, finding)) else { continue };
                let some: Vec<String> = seeds.iter().take(12).map(u64::to_string).collect();
                let more = if seeds.len() > some.len() { " .." } else { "" };
                writeln!(f, "  {name}, {} problems of {}: seeds {}{more}", seeds.len(), kind.name(), some.join(" "))?;
            }
        }
        for (kind, seed) in &self.alone {
            writeln!(f, "  the independent method stands alone: {} {seed}", kind.name())?;
        }
        Ok(())
    }
}
