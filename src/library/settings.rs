//! Settings of a solve: method, tolerances and output.

use serde_json::{Map, Value, json};

/// The absolute tolerances of the states, each in the unit of its state. They should be below the smallest value of interest.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum AbsoluteTolerance {
    /// A thousandth of the relative tolerance, as the absolute tolerance of every state.
    #[default]
    ThousandthOfRelative,
    /// One absolute tolerance for all states.
    Uniform(f64),
    /// One absolute tolerance per state, by name; states that are not named have the default.
    PerState(Vec<(String, f64)>),
}

/// Settings of a solve: method, tolerances and output. The defaults and the meanings of the fields are those of a
/// specification. Times and step sizes are in the unit of time, an absolute tolerance is in the unit of its state.
///
/// ```
/// let settings = dvi::Settings { rtol: 1e-9, ..dvi::Settings::default() };
/// assert_eq!(settings.start, 0.0);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The start time, at which the initial values are given.
    pub start: f64,
    /// The relative tolerance of the local error, from 1e-14 to 0.1.
    pub rtol: f64,
    /// The absolute tolerances of the states.
    pub atol: AbsoluteTolerance,
    /// The number of stages of Radau IIA, of order `2s - 1`: odd, or any from 1 to 9 with a fixed `step`; `None` to
    /// choose between 3, 5 and 7 during the run.
    pub stages: Option<usize>,
    /// A fixed step size; `None` for steps that follow from the error estimate.
    pub step: Option<f64>,
    /// The first step size to try in the run.
    pub first_step: Option<f64>,
    /// The largest step size of the run.
    pub max_step: Option<f64>,
    /// The smallest step size; a run that needs a smaller step fails.
    pub min_step: Option<f64>,
    /// The output times of the trajectory, increasing; `None` for output at the end of every step.
    pub times: Option<Vec<f64>>,
    /// The names of the columns of the trajectory to keep; `None` for the default columns.
    pub fields: Option<Vec<String>>,
    /// Whether to estimate the global error at the end time, by a second and more accurate run.
    pub global_error: bool,
    /// The longest wall-clock time that the solve may take, in seconds.
    pub seconds: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            start: 0.0,
            rtol: 1e-6,
            atol: AbsoluteTolerance::default(),
            stages: None,
            step: None,
            first_step: None,
            max_step: None,
            min_step: None,
            times: None,
            fields: None,
            global_error: false,
            seconds: None,
        }
    }
}

impl Settings {
    /// Returns the keys of a specification other than `problem`, for a run up to the time `end`, as JSON members.
    pub(crate) fn written(&self, end: f64) -> Map<String, Value> {
        let atol = match &self.atol {
            AbsoluteTolerance::ThousandthOfRelative => None,
            AbsoluteTolerance::Uniform(atol) => Some(json!(atol)),
            AbsoluteTolerance::PerState(of) => {
                Some(of.iter().map(|(name, atol)| (name.clone(), json!(atol))).collect())
            }
        };
        let method = object([
            ("rtol", Some(json!(self.rtol))),
            ("atol", atol),
            ("stages", self.stages.map(Value::from)),
            ("step", self.step.map(Value::from)),
            ("first_step", self.first_step.map(Value::from)),
            ("max_step", self.max_step.map(Value::from)),
            ("min_step", self.min_step.map(Value::from)),
        ]);
        let output = object([
            ("times", self.times.clone().map(Value::from)),
            ("fields", self.fields.clone().map(Value::from)),
            ("global_error", Some(json!(self.global_error))),
        ]);
        let limits = object([("wall_seconds", self.seconds.map(Value::from))]);
        let time = json!({"start": self.start, "end": end});
        [("time", time), ("method", method.into()), ("output", output.into()), ("limits", limits.into())]
            .map(|(key, value)| (key.to_owned(), value))
            .into_iter()
            .collect()
    }
}

/// Returns a JSON object with those of the entries that have a value.
fn object<const N: usize>(entries: [(&str, Option<Value>); N]) -> Map<String, Value> {
    entries.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?))).collect()
}
