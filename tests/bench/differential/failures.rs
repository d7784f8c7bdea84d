//! Files of wrong runs: the specification of the run, with the correct values at the time of its largest error.

use super::experiment::Experiment;
use super::judgement::{Finding, Judgement};
use super::problem::Kind;
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;

/// The folder in which wrong runs are stored.
pub struct Failures {
    folder: Option<PathBuf>,
}

impl Failures {
    pub fn new(folder: Option<PathBuf>) -> Self {
        if let Some(folder) = &folder {
            fs::create_dir_all(folder).expect("a folder for failures");
        }
        Self { folder }
    }

    /// Writes the worst wrong run of a problem to a file, if there is one, with a preference for trusted (silent) ones.
    pub fn keep(&self, kind: Kind, seed: u64, experiment: &Experiment, judgement: &Judgement) {
        let Some(folder) = &self.folder else { return };
        let of = |wanted: Finding| {
            let found = judgement.findings.iter().enumerate().filter(|(_, (finding, _))| *finding == wanted);
            // Prefer a run in the generator's units, which is the easiest to read.
            let is_plain = |k: usize| experiment.runs[k].label != "units";
            found.max_by(|a, b| is_plain(a.0).cmp(&is_plain(b.0)).then(a.1.1.total_cmp(&b.1.1))).map(|(k, _)| k)
        };
        let orders = [
            (Finding::Panicked, "panic"),
            (Finding::NotFinite, "not_finite"),
            (Finding::Silent, "silent"),
            (Finding::Caught, "caught"),
            (Finding::TimedOut, "late"),
            (Finding::Failed, "failed"),
            (Finding::Refused, "refused"),
            (Finding::FalseAlarm, "alarm"),
        ];
        let Some((k, what)) = orders.into_iter().find_map(|(finding, what)| of(finding).map(|k| (k, what))) else {
            return;
        };
        if judgement.apart.is_some() && !matches!(what, "panic" | "not_finite" | "late") {
            return;
        }
        let run = &experiment.runs[k];
        let mut specification = run.specification.clone();
        specification["label"] = json!(format!("{what}: {} {seed}, {}", kind.name(), run.label));
        let name = format!("{what}_{}_{seed}", kind.name());
        let write = |name: String, value: &Value| fs::write(folder.join(name), format!("{value:#}")).expect("a file");
        write(format!("{name}.json"), &specification);
        let comparison = json!({
            "run": run.label, "accuracy": run.accuracy, "kappa": experiment.kappa, "times": experiment.times,
            "sizes": experiment.sizes, "fields": experiment.fields.iter().map(|field| &field.name).collect::<Vec<_>>(),
            "right": judgement.truth, "by_reference": judgement.by_reference,
            "reference_alone": judgement.reference_alone,
            "this": run.answer().map(|answer| json!({"t": answer.t, "columns": answer.columns})),
            "runs": experiment.runs.iter().zip(&judgement.findings).map(|(run, (finding, far))| {
                format!("{} ({:e}): {finding:?} {far:.3e}", run.label, run.accuracy)
            }).collect::<Vec<_>>(),
        });
        write(format!("{name}.truth"), &comparison);
    }
}
