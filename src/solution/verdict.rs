//! The verdict on an answer: whether it may be relied upon, and if not, which measurement speaks against it.
//!
//! While a stepper runs it records [`Checks`]: each is a number that was measured, beside the number that the tolerances
//! allow. [`Verdict::of`] compares them once the run has ended. A check that was not made says nothing; a check that
//! failed makes the answer untrusted, whatever `status` is.

use super::{Failure, Status};
use serde::{Deserialize, Serialize, Serializer};
use std::collections::BTreeMap;
use std::fmt;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{PartialSchema, ToSchema};

/// What is measured of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CheckCode {
    /// The natural map of the law that was posed, in the units of its set.
    LawResidual,
    /// Constraints that a mode holds, and hidden ones, at the outputs and between the steps.
    ConstraintResidual,
    /// How far joints are apart.
    JointDrift,
    /// What the balance of energy lacks.
    EnergyBalance,
    /// Steps in which an event may have been missed.
    EventsUnproven,
    /// The local error of accepted steps, where it is beyond the tolerance or not controlled.
    LocalError,
    /// The error at the end, where it was asked for.
    GlobalError,
    /// How far derivatives are from a difference of runs.
    Derivatives,
    /// How far a run from a state of rest, or once along an orbit, ends from where it began.
    ReturnResidual,
    /// How far fitted parameters are from the minimum.
    FitDistance,
    /// The distance by which an accumulation of events was stepped over.
    AccumulationPassed,
    /// Members of a sweep that are not to be relied upon.
    UntrustedMembers,
    /// The time that is missing to the end asked for.
    NotAtEnd,
}

impl CheckCode {
    /// All codes, in the order in which they are reported.
    pub const ALL: [Self; 13] = [
        Self::LawResidual,
        Self::ConstraintResidual,
        Self::JointDrift,
        Self::EnergyBalance,
        Self::EventsUnproven,
        Self::LocalError,
        Self::GlobalError,
        Self::Derivatives,
        Self::ReturnResidual,
        Self::FitDistance,
        Self::AccumulationPassed,
        Self::UntrustedMembers,
        Self::NotAtEnd,
    ];

    /// The word that programs read.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LawResidual => "law_residual",
            Self::ConstraintResidual => "constraint_residual",
            Self::JointDrift => "joint_drift",
            Self::EnergyBalance => "energy_balance",
            Self::EventsUnproven => "events_unproven",
            Self::LocalError => "local_error",
            Self::GlobalError => "global_error",
            Self::Derivatives => "derivatives",
            Self::ReturnResidual => "return_residual",
            Self::FitDistance => "fit_distance",
            Self::AccumulationPassed => "accumulation_passed",
            Self::UntrustedMembers => "untrusted_members",
            Self::NotAtEnd => "not_at_end",
        }
    }

    /// What the value is, and what it is compared with.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::LawResidual => {
                "Residual of the natural map of the law that was posed (complementarity, friction, impact), in the units of its \
                 set; of bodies relative to their velocities. Allowed is `vi_tolerance`, where there is one."
            }
            Self::ConstraintResidual => {
                "Residual of the constraints that hold on the active face, hidden ones included, at the outputs and between the \
                 steps; of contacts a gap, of bodies their overlap as a part of the smaller. Allowed is the tolerance of the \
                 outputs, or 1e-3 of the largest length met where steps have one size."
            }
            Self::JointDrift => {
                "How far a joint has come apart: a length, or a part of the size of its bodies. Allowed is what the tolerance \
                 gives over the steps made, or 1e-3 of the largest length met where steps have one size."
            }
            Self::EnergyBalance => {
                "Defect of the balance of energy, work, friction, viscosity and impacts. Allowed is what the tolerance gives over \
                 the steps made, or 1e-3 of the largest energy met where steps have one size."
            }
            Self::EventsUnproven => {
                "Number of steps that are not proven free of an undetected event (a switch, an impact, a kink); none is allowed."
            }
            Self::LocalError => {
                "Largest local error of an accepted step in units of `atol + rtol |x|`, where the error test was passed over or \
                 could not see the state."
            }
            Self::GlobalError => {
                "Estimate of the error at the end in units of `atol + rtol |x|`; measured where `output.global_error` asks for it."
            }
            Self::Derivatives => {
                "How far the derivatives at the end are from the difference of two runs, in units of the uncertainty of this; \
                 measured where `sensitivities` asks for them."
            }
            Self::ReturnResidual => {
                "How far a run once along an orbit, or from a state of rest, ends from where it began, in units of \
                 `atol + rtol |x|`; measured where `periodic` or `steady_state` asks for one. Allowed is one for each step."
            }
            Self::FitDistance => {
                "How far the estimates of `fit` are from the minimum that the derivatives there predict, in standard errors. \
                 Allowed is a hundredth, or what the tolerance of the runs leaves."
            }
            Self::AccumulationPassed => {
                "How far an accumulation of events (Zeno) was from its limit when the run passed over it: a distance of the \
                 states, or a part of the largest energy. Allowed is the tolerance."
            }
            Self::UntrustedMembers => {
                "Number of members of a sweep that reached their end and are not trusted; none is allowed."
            }
            Self::NotAtEnd => "Time from where the run ended to the end that was asked for; none is allowed.",
        }
    }
}

impl fmt::Display for CheckCode {
    /// The name in words, such as `joint drift`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name().replace('_', " "))
    }
}

impl PartialSchema for CheckCode {
    fn schema() -> RefOr<Schema> {
        let of = |code: Self| {
            let name = ObjectBuilder::new().schema_type(Type::String).enum_values(Some([code.name()]));
            name.description(Some(code.meaning()))
        };
        let codes = Self::ALL.into_iter().fold(OneOfBuilder::new(), |codes, code| codes.item(of(code)));
        codes.description(Some("What is measured of an answer.")).into()
    }
}

impl ToSchema for CheckCode {}

/// One measurement, the worst of its code so far.
#[derive(Clone, Debug, PartialEq)]
struct Check {
    value: f64,
    allowed: f64,
    /// What was measured and where, for people.
    message: String,
}

impl Check {
    /// How far the value is beyond what is allowed; above one the check fails, and so does a value that is not a number.
    fn excess(&self) -> f64 {
        let ratio = if self.value == 0.0 { 0.0 } else { self.value / self.allowed };
        if ratio.is_nan() { f64::INFINITY } else { ratio }
    }
}

/// The measurements of a run: of each code the one that is worst against what is allowed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checks {
    worst: BTreeMap<CheckCode, Check>,
    caveats: Vec<Caveat>,
}

impl Checks {
    /// Records a measurement. Keeps it if it exceeds what it is allowed by more than those of its code before; only then
    /// is the message made.
    pub fn record(&mut self, code: CheckCode, value: f64, allowed: f64, message: impl FnOnce() -> String) {
        let mut check = Check { value, allowed, message: String::new() };
        if self.worst.get(&code).is_none_or(|worst| check.excess() > worst.excess()) {
            check.message = message();
            self.worst.insert(code, check);
        }
    }

    /// Adds something that the user should know though it does not speak against the answer; once for each code.
    pub fn caveat(&mut self, code: &'static str, message: String) {
        if self.caveats.iter().all(|caveat| caveat.code != code) {
            self.caveats.push(Caveat { code: code.into(), message });
        }
    }

    /// Takes over the measurements and caveats of another part of the run.
    pub fn absorb(&mut self, other: Self) {
        for (code, check) in other.worst {
            self.record(code, check.value, check.allowed, || check.message);
        }
        for caveat in other.caveats {
            if self.caveats.iter().all(|known| known.code != caveat.code) {
                self.caveats.push(caveat);
            }
        }
    }

    /// The measurement of a code: its value and what is allowed.
    pub fn get(&self, code: CheckCode) -> Option<(f64, f64)> {
        self.worst.get(&code).map(|check| (check.value, check.allowed))
    }
}

impl Serialize for Checks {
    /// An object: code to value and what is allowed.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let measured = |check: &Check| Measured { value: finite(check.value), allowed: finite(check.allowed) };
        serializer.collect_map(self.worst.iter().map(|(code, check)| (code, measured(check))))
    }
}

impl PartialSchema for Checks {
    fn schema() -> RefOr<Schema> {
        let checks = ObjectBuilder::new().additional_properties(Some(Ref::from_schema_name(Measured::name())));
        checks.description(Some("Code (`CheckCode`) to measurement, of the checks that were made.")).into()
    }
}

impl ToSchema for Checks {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((Measured::name().into(), Measured::schema()));
    }
}

/// A measurement beside what is allowed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct Measured {
    /// The worst value of the run; the largest finite number where it is not finite.
    pub value: f64,
    /// The value up to which it does not speak against the answer.
    pub allowed: f64,
}

/// The nearest finite number; JSON has no other.
fn finite(value: f64) -> f64 {
    if value.is_nan() { f64::MAX } else { value.clamp(f64::MIN, f64::MAX) }
}

/// A measurement that speaks against the answer.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Reason {
    /// What was measured.
    pub code: CheckCode,
    /// The value that was found; the largest finite number where it is not finite.
    pub value: f64,
    /// The value up to which the answer would be trusted.
    pub allowed: f64,
    /// What that means, with the remedy.
    pub message: String,
}

impl fmt::Display for Reason {
    /// `joint drift 3e-2, allowed 1e-3: the message`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { code, value, allowed, message } = self;
        write!(f, "{code} {}, allowed {}: {message}", Figure(*value), Figure(*allowed))
    }
}

/// A number for people: three digits are enough to see by how much it is beyond another.
struct Figure(f64);

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(x) = *self;
        if x.abs() == f64::MAX {
            f.write_str("not finite")
        } else if x.fract() == 0.0 && x.abs() < 1e6 {
            write!(f, "{x}")
        } else {
            let rounded = format!("{x:.2e}");
            let (mantissa, exponent) = rounded.split_once('e').unwrap_or((&rounded, "0"));
            let mantissa = mantissa.trim_end_matches('0').trim_end_matches('.');
            write!(f, "{mantissa}e{exponent}")
        }
    }
}

/// Something that the user should know and that does not speak against the answer.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
pub struct Caveat {
    /// A stable word for programs.
    pub code: String,
    /// For people.
    pub message: String,
}

/// Whether an answer may be relied upon.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Verdict {
    /// Whether every check that was made is within what is allowed, and the end was reached.
    pub trusted: bool,
    /// What speaks against the answer; empty where it is trusted.
    pub because: Vec<Reason>,
    /// What does not, but should be known.
    pub caveats: Vec<Caveat>,
}

impl Verdict {
    /// Compares what was measured with what is allowed. `end` is the end asked for.
    pub fn of(status: Status, error: Option<&Failure>, end: f64, checks: &Checks) -> Self {
        let mut because: Vec<Reason> = checks
            .worst
            .iter()
            .filter(|(_, check)| check.excess() > 1.0)
            .map(|(code, check)| Reason {
                code: *code,
                value: finite(check.value),
                allowed: finite(check.allowed),
                message: check.message.clone(),
            })
            .collect();
        if status != Status::Completed {
            let reached = error.map_or(end, |error| error.time);
            because.push(Reason {
                code: CheckCode::NotAtEnd,
                value: finite((end - reached).abs()),
                allowed: 0.0,
                message: format!("the run ended at t = {reached:?}, before the end asked for, {end:?}"),
            });
        }
        Self { trusted: because.is_empty(), because, caveats: checks.caveats.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_of_each_code_is_kept_and_decides() {
        let mut checks = Checks::default();
        checks.record(CheckCode::LawResidual, 1e-9, 1e-8, || "small".to_owned());
        assert!(Verdict::of(Status::Completed, None, 1.0, &checks).trusted);
        checks.record(CheckCode::LawResidual, 3e-8, 1e-8, || "large".to_owned());
        checks.record(CheckCode::LawResidual, 2e-8, 1e-8, || "less large".to_owned());
        let verdict = Verdict::of(Status::Completed, None, 1.0, &checks);
        assert!(!verdict.trusted);
        assert_eq!(verdict.because.len(), 1);
        assert_eq!((verdict.because[0].value, verdict.because[0].message.as_str()), (3e-8, "large"));
    }

    #[test]
    fn what_is_not_a_number_fails_even_where_nothing_is_allowed() {
        let mut checks = Checks::default();
        checks.record(CheckCode::EventsUnproven, 0.0, 0.0, String::new);
        assert!(Verdict::of(Status::Completed, None, 1.0, &checks).trusted);
        checks.record(CheckCode::EnergyBalance, f64::NAN, 1e-3, String::new);
        let verdict = Verdict::of(Status::Completed, None, 1.0, &checks);
        assert_eq!((verdict.trusted, verdict.because[0].value), (false, f64::MAX));
    }

    #[test]
    fn a_reason_is_told_as_its_value_beside_what_is_allowed() {
        let told = |value: f64, allowed: f64| {
            let message = "the hinge of `arm` comes apart".to_owned();
            Reason { code: CheckCode::JointDrift, value, allowed, message }.to_string()
        };
        assert_eq!(told(0.03, 1e-3), "joint drift 3e-2, allowed 1e-3: the hinge of `arm` comes apart");
        assert_eq!(told(17.0, 0.0), "joint drift 17, allowed 0: the hinge of `arm` comes apart");
        assert_eq!(
            told(f64::MAX, 1.234_567e-10),
            "joint drift not finite, allowed 1.23e-10: the hinge of `arm` comes apart"
        );
    }

    #[test]
    fn an_answer_that_ends_early_is_not_trusted() {
        let error = Failure { code: "steps".into(), message: String::new(), time: 0.25, state: Vec::new() };
        let verdict = Verdict::of(Status::Stopped, Some(&error), 1.0, &Checks::default());
        assert_eq!((verdict.because[0].code, verdict.because[0].value), (CheckCode::NotAtEnd, 0.75));
    }
}
