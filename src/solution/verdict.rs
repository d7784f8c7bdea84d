//! The verdict on an answer: whether it may be relied upon, and if not, the measurements against it.
//!
//! While a stepper runs, it records [`Checks`]: measured values beside the values that the tolerances permit.
//! [`Verdict::of`] compares them at the end of the run. A check that was not made has no influence; a failed check
//! makes the answer untrusted, whatever its `status`.

use super::{Failure, Status};
use serde::{Deserialize, Serialize, Serializer};
use std::collections::BTreeMap;
use std::fmt;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Schema, Type};
use utoipa::openapi::{Ref, RefOr};
use utoipa::{PartialSchema, ToSchema};

/// The quantities that are measured for the verdict on an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CheckCode {
    /// Residual of the natural map of the variational inequality or contact law, in the units of its set.
    LawResidual,
    /// Residual of active and hidden constraints, at outputs and within steps.
    ConstraintResidual,
    /// Violation of the joints' constraints.
    JointDrift,
    /// Defect of the energy balance of a mechanical system.
    EnergyBalance,
    /// Number of steps in which an event may have been missed.
    EventsUnproven,
    /// Local error of accepted steps if it exceeds the tolerance or is not controlled.
    LocalError,
    /// Global error of the states at the end, if requested.
    GlobalError,
    /// Difference of sensitivities from a finite difference of runs.
    Derivatives,
    /// Distance between the start and the end of a run from a steady state, or over one period of an orbit.
    ReturnResidual,
    /// Distance of fitted parameters from the minimum.
    FitDistance,
    /// Change of the states or of the energy when an accumulation of events (Zeno) was stepped over.
    AccumulationPassed,
    /// Absolute value of a negative determinant of an active face, which proves other solutions.
    OtherSolutions,
    /// Number of members of a sweep that are not trusted.
    UntrustedMembers,
    /// Time between the end of the run and the requested end.
    NotAtEnd,
}

impl CheckCode {
    /// All check codes, in the order in which they are reported.
    pub const ALL: [Self; 14] = [
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
        Self::OtherSolutions,
        Self::UntrustedMembers,
        Self::NotAtEnd,
    ];

    /// Returns the name of the code, for programs.
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
            Self::OtherSolutions => "other_solutions",
            Self::UntrustedMembers => "untrusted_members",
            Self::NotAtEnd => "not_at_end",
        }
    }

    /// Returns in words the meaning of the value measured for a check code, and of the permitted value with which it is
    /// compared.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::LawResidual => {
                "Residual of the natural map of the law (complementarity, friction, impact), in the units of its \
                 set; for rigid bodies relative to their velocities. Allowed: `vi_tolerance`, if there is one."
            }
            Self::ConstraintResidual => {
                "Residual of the constraints of the active face, hidden ones included, at the outputs and between the \
                 steps; for contacts a gap, for rigid bodies their overlap relative to the smaller one. Allowed: the \
                 tolerance of the outputs, or 1e-3 of the largest length for fixed steps."
            }
            Self::JointDrift => {
                "Violation of a joint: a length, or a length relative to the size of its bodies. Allowed: the \
                 tolerance summed over the steps, or 1e-3 of the largest length for fixed steps."
            }
            Self::EnergyBalance => {
                "Defect of the balance of energy, work, friction, viscosity and impacts. Allowed: the tolerance summed \
                 over the steps, or 1e-3 of the largest energy for fixed steps."
            }
            Self::EventsUnproven => {
                "Number of steps that are not proven free of an undetected event (a switch, an impact, a kink); none is allowed."
            }
            Self::LocalError => {
                "Largest local error of an accepted step in units of `atol + rtol |x|`, if the error test was skipped \
                 or could not see the state; for steps of a given size the sum of their estimated errors, or the error \
                 between their ends, and for steps over impacts the difference from a run with steps twice as long, each \
                 relative to the largest values of the states. Allowed: one, or 1e-3 for steps of a given size, 1e-2 for \
                 rigid bodies."
            }
            Self::GlobalError => {
                "Estimate of the error at the end in units of `atol + rtol |x|`; measured if `output.global_error` is \
                 set, or if a state changes by its own size within less than the tolerance of time at the end."
            }
            Self::Derivatives => {
                "Difference of the derivatives from the difference quotient of two runs, in units of the uncertainty of \
                 the latter; measured if `sensitivities` are requested, and for the multipliers of an orbit."
            }
            Self::ReturnResidual => {
                "Distance between the end and the beginning of a run over one period of an orbit, or from a steady \
                 state, in units of `atol + rtol |x|`; measured for `periodic` and `steady_state`. Allowed: one per \
                 step."
            }
            Self::FitDistance => {
                "Distance of the estimates of `fit` from the minimum that the derivatives there predict, in standard \
                 errors. Allowed: a hundredth, or the uncertainty from the tolerance of the runs."
            }
            Self::AccumulationPassed => {
                "Distance of an accumulation of events (Zeno) from its limit when the run stepped over it: a distance \
                 of the states, or a fraction of the largest energy. Allowed: the tolerance."
            }
            Self::OtherSolutions => {
                "Absolute value of the determinant of `CB` (or of `G_z`) on an active face, relative to its terms, where it is \
                 negative within the tolerances of the states: the law then holds with other values of the variables too, as \
                 on a surface that repels. Allowed: zero."
            }
            Self::UntrustedMembers => {
                "Number of members of a sweep that reached their end and are not trusted; none is allowed."
            }
            Self::NotAtEnd => {
                "Time from the end of the run to the requested end, or 1 for a search without an answer; none is allowed."
            }
        }
    }
}

impl fmt::Display for CheckCode {
    /// Writes the name of the check in words, such as `joint drift`.
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
        codes.description(Some("The measured quantities of an answer.")).into()
    }
}

impl ToSchema for CheckCode {}

/// The worst measurement of a check code so far.
#[derive(Clone, Debug, PartialEq)]
struct Check {
    value: f64,
    allowed: f64,
    /// The meaning of the measured value and what to change, in words.
    message: String,
}

impl Check {
    /// Returns the ratio of the measured to the permitted value of a check; the check fails above one, and for NaN.
    fn excess(&self) -> f64 {
        let ratio = if self.value == 0.0 { 0.0 } else { self.value / self.allowed };
        if ratio.is_nan() { f64::INFINITY } else { ratio }
    }
}

/// The measurements of a run: for each check code, the worst one relative to its permitted value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checks {
    worst: BTreeMap<CheckCode, Check>,
    caveats: Vec<Caveat>,
}

impl Checks {
    /// Records a measurement if it is worse than all previous ones of its check code; only then the message is
    /// created.
    pub fn record(&mut self, code: CheckCode, value: f64, allowed: f64, message: impl FnOnce() -> String) {
        let mut check = Check { value, allowed, message: String::new() };
        if self.worst.get(&code).is_none_or(|worst| check.excess() > worst.excess()) {
            check.message = message();
            self.worst.insert(code, check);
        }
    }

    /// Adds a caveat, which does not make the answer untrusted; only the first caveat of each code is kept.
    pub fn caveat(&mut self, code: &'static str, message: String) {
        if self.caveats.iter().all(|caveat| caveat.code != code) {
            self.caveats.push(Caveat { code: code.into(), message });
        }
    }

    /// Merges the measurements and caveats of another part of the run into these.
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

    /// Returns the worst measured and the permitted value of a check code.
    pub fn get(&self, code: CheckCode) -> Option<(f64, f64)> {
        self.worst.get(&code).map(|check| (check.value, check.allowed))
    }
}

impl Serialize for Checks {
    /// Serialises the checks as an object that maps check codes to measured and permitted values.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let measured = |check: &Check| Measured { value: finite(check.value), allowed: finite(check.allowed) };
        serializer.collect_map(self.worst.iter().map(|(code, check)| (code, measured(check))))
    }
}

impl PartialSchema for Checks {
    fn schema() -> RefOr<Schema> {
        let checks = ObjectBuilder::new().additional_properties(Some(Ref::from_schema_name(Measured::name())));
        checks.description(Some("The measurement of each check that was made, by its code (`CheckCode`).")).into()
    }
}

impl ToSchema for Checks {
    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((Measured::name().into(), Measured::schema()));
    }
}

/// A measured value and the largest permitted one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct Measured {
    /// The worst measured value of the run; the largest finite number if it is not finite.
    pub value: f64,
    /// The largest measured value at which the answer is trusted.
    pub allowed: f64,
}

/// Returns the nearest finite number, since JSON has no others; the largest one for NaN.
fn finite(value: f64) -> f64 {
    if value.is_nan() { f64::MAX } else { value.clamp(f64::MIN, f64::MAX) }
}

/// A measurement that makes the answer untrusted.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Reason {
    /// The code of the check that failed.
    pub code: CheckCode,
    /// The measured value; the largest finite number if it is not finite.
    pub value: f64,
    /// The largest measured value at which the answer would be trusted.
    pub allowed: f64,
    /// The meaning of the measurement, and what to change.
    pub message: String,
}

impl fmt::Display for Reason {
    /// Writes the reason as text, such as `joint drift 3e-2, allowed 1e-3: the message`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { code, value, allowed, message } = self;
        write!(f, "{code} {}, allowed {}: {message}", Figure(*value), Figure(*allowed))
    }
}

/// A number formatted for people, with three digits.
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

/// Information for the user that does not make the answer untrusted.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
pub struct Caveat {
    /// A stable code of the caveat for programs.
    pub code: String,
    /// The information for the user, in words.
    pub message: String,
}

/// Whether an answer may be relied upon.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, ToSchema)]
pub struct Verdict {
    /// Whether the end was reached and every check is within its permitted value.
    pub trusted: bool,
    /// The reasons against the answer; empty if it is trusted.
    pub because: Vec<Reason>,
    /// Caveats: further information for the user that does not make the answer untrusted.
    pub caveats: Vec<Caveat>,
}

impl Verdict {
    /// Compares the measurements of a run with the permitted values. `end` is the requested end time of a run, and
    /// `None` for a search.
    pub fn of(status: Status, error: Option<&Failure>, end: Option<f64>, checks: &Checks) -> Self {
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
            let (missing, message) = end.map_or((1.0, "the search found no answer".to_owned()), |end| {
                let reached = error.map_or(end, |error| error.time);
                let message = format!("the run ended at t = {reached:?}, before the requested end, {end:?}");
                ((end - reached).abs(), message)
            });
            because.push(Reason { code: CheckCode::NotAtEnd, value: finite(missing), allowed: 0.0, message });
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
        assert!(Verdict::of(Status::Completed, None, Some(1.0), &checks).trusted);
        checks.record(CheckCode::LawResidual, 3e-8, 1e-8, || "large".to_owned());
        checks.record(CheckCode::LawResidual, 2e-8, 1e-8, || "less large".to_owned());
        let verdict = Verdict::of(Status::Completed, None, Some(1.0), &checks);
        assert!(!verdict.trusted);
        assert_eq!(verdict.because.len(), 1);
        assert_eq!((verdict.because[0].value, verdict.because[0].message.as_str()), (3e-8, "large"));
    }

    #[test]
    fn what_is_not_a_number_fails_even_where_nothing_is_allowed() {
        let mut checks = Checks::default();
        checks.record(CheckCode::EventsUnproven, 0.0, 0.0, String::new);
        assert!(Verdict::of(Status::Completed, None, Some(1.0), &checks).trusted);
        checks.record(CheckCode::EnergyBalance, f64::NAN, 1e-3, String::new);
        let verdict = Verdict::of(Status::Completed, None, Some(1.0), &checks);
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
        let verdict = Verdict::of(Status::Stopped, Some(&error), Some(1.0), &Checks::default());
        assert_eq!((verdict.because[0].code, verdict.because[0].value), (CheckCode::NotAtEnd, 0.75));
    }
}
