//! The Filippov system: rates that jump between regions. Two regions are separated by the sign of a surface function;
//! of many regions, the one with the least indicator applies. The equations are those of
//! [`models::filippov`](models::filippov).

use super::dvi::refused;
use super::error::SpecificationError;
use super::expression::Expression;
use super::kinks;
use super::lowering::{Lowering, Named, Start};
use super::ordered::Ordered;
use super::pointer::Pointer;
use super::start;
use super::tables::TableOfPoints;
use super::wording::{abridged, listed};
use super::written::{Lowered, Written};
use expression::{Node, nearest};
use models::filippov::{Departures, Region, many_regions, two_regions};
use models::{DviModel, Equations, Outputs, ParametricTerms};
use serde::Deserialize;
use solution::Warning;
use std::sync::Arc;
use utoipa::ToSchema;

/// Rates that jump between regions. Give either `surface`, with `plus` and `minus` for every state, or `regions`.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FilippovProblem {
    /// Constants by name; each may be an expression in the others, without circular references.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub parameters: Ordered<Expression>,
    /// Tables by name: functions of one argument, called as `load(t)`.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, TableOfPoints>)]
    pub tables: Ordered<TableOfPoints>,
    /// Expressions by name, in states, variables, parameters, `t` and each other, without circular references. Each can be
    /// reported as a column, and used by its name in other expressions.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub definitions: Ordered<Expression>,
    /// Integrals over time of expressions by name, from zero at the start: further columns.
    #[serde(default)]
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub integrals: Ordered<Expression>,
    /// The states `x` by name, at least one. The outputs are in the order of the states.
    #[schema(value_type = std::collections::BTreeMap<String, FilippovState>)]
    pub states: Ordered<FilippovState>,
    /// The surface function `h(t,x)`: the rates are `plus` where it is positive and `minus` where it is negative. The
    /// output `z` is the weight of `minus` in the convex combination.
    pub surface: Option<Expression>,
    /// Two or more regions. The outputs `z1`, `z2`, ... are their weights in the convex combination.
    pub regions: Option<Vec<FilippovRegion>>,
}

/// A state `x_i` of a Filippov system.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FilippovState {
    /// Initial value of the state, an expression in the parameters.
    pub initial: Expression,
    /// Rate of the state where `surface` is positive.
    pub plus: Option<Expression>,
    /// Rate of the state where `surface` is negative.
    pub minus: Option<Expression>,
}

/// A region of a Filippov system, with its indicator and its rates.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FilippovRegion {
    /// The indicator `g(t,x)`: the region is the set where `g` is the least of all indicators.
    pub indicator: Expression,
    /// The rate of every state in the region, by name.
    #[schema(value_type = std::collections::BTreeMap<String, Expression>)]
    pub rates: Ordered<Expression>,
}

impl FilippovProblem {
    /// Number of variables: the weights of the regions in the convex combination.
    pub(super) fn variables(&self) -> usize {
        self.regions.as_ref().map_or(1, Vec::len)
    }
}

impl Written for FilippovProblem {
    fn key(&self) -> &'static str {
        "filippov"
    }

    fn named(&self) -> Named<'_> {
        let Self { parameters, tables, definitions, integrals, .. } = self;
        Named { parameters, tables, definitions, integrals }
    }

    fn unknowns(&self) -> usize {
        self.states.len() + self.variables()
    }

    fn lower<'c>(&self, place: &Pointer<'_>, start: Start<'c>) -> Lowered<'c> {
        let mut lowering = Lowering::with_inputs(start, self.named(), place);
        let n = self.states.len();
        let states = place.key("states");
        if n == 0 {
            let error = SpecificationError::new(states.to_string(), "empty_states", "there are no states");
            lowering.errors.push(error.expected("at least one state"));
        }
        lowering.bind_unknowns(self.states.names(), |i| states.key(self.states.name(i)).to_string());
        lowering.use_definitions(&self.definitions);
        let values = self.states.iter();
        let (initial, start_terms): (Vec<f64>, Vec<Node>) =
            values.map(|(name, state)| lowering.initial(&state.initial, &states.key(name).key("initial"))).unzip();
        let regions = match (&self.surface, &self.regions) {
            (Some(surface), None) => self.sides(surface, place, &mut lowering),
            (None, Some(regions)) => self.many(regions, place, &mut lowering),
            _ => {
                let detail = "a Filippov system has either a `surface`, with the rates `plus` and \
                              `minus` of every state on its two sides, or `regions`";
                let error = SpecificationError::new(place.to_string(), "surface_or_regions", detail);
                lowering.errors.push(error.expected("one of `surface`, `regions`"));
                return (lowering, None);
            }
        };
        if !lowering.errors.is_empty() {
            return (lowering, None);
        }
        let rows = match &self.surface {
            Some(_) => two_regions(&mut lowering.graph, regions[1].indicator, &regions[0].rates, &regions[1].rates),
            None => many_regions(&mut lowering.graph, n, &regions),
        };
        let state_names: Vec<String> = self.states.names().map(String::from).collect();
        let variable_names = self.shares();
        let row_pointer = |row: usize| match (row.checked_sub(n), &self.surface) {
            (None, _) => states.key(self.states.name(row)).to_string(),
            (Some(_), Some(_)) => place.key("surface").to_string(),
            (Some(i), None) => place.key("regions").index(i).key("indicator").to_string(),
        };
        let mut warnings = self.warnings(&regions, &state_names, &lowering);
        // A derivative that does not exist is reported with the JSON pointer of its expression when the equations are
        // built.
        let mut departures = lowering.start.and_then(|t| Departures::new(&mut lowering.graph, &regions, t).ok());
        let ways = departures.as_mut().map_or(0, |departures| departures.from(&initial).len());
        if ways > 1 {
            warnings.push(repulsive(ways));
        }
        let terms = ParametricTerms { initial: start_terms, ..rows.terms() };
        let equations = match Equations::new(&mut lowering.graph, rows) {
            Ok(equations) => equations,
            Err(refusals) => {
                for refusal in refusals {
                    lowering.errors.push(refused(refusal, &state_names, &variable_names, row_pointer));
                }
                return (lowering, None);
            }
        };
        let kinks = kinks::advice(&equations, &state_names, &variable_names, || None);
        let outputs = Outputs::default();
        let parameters = lowering.parameters(terms, &equations.structure().mass);
        let parameters = parameters.map(|parameters| parameters.with_departures(departures));
        let model = DviModel { state_names, variable_names, outputs, initial, equations, warnings, kinks, parameters };
        if let Some(t) = lowering.start {
            start::check(&model, t, row_pointer, &mut lowering.errors);
        }
        (lowering, Some(Arc::new(model)))
    }
}

impl FilippovProblem {
    /// Returns the two regions on either side of a switching surface, the region of `plus` first.
    fn sides(&self, surface: &Expression, place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Region> {
        let zero = lowering.graph.constant(0.0);
        let below = lowering.node(surface, &place.key("surface")).unwrap_or(zero);
        let above = lowering.graph.negate(below);
        let (mut plus, mut minus) = (Vec::new(), Vec::new());
        for (name, state) in self.states.iter() {
            let states = place.key("states");
            let place = states.key(name);
            for (key, rate, rates) in [("plus", &state.plus, &mut plus), ("minus", &state.minus, &mut minus)] {
                let node = match rate {
                    Some(rate) => lowering.node(rate, &place.key(key)),
                    None => {
                        let detail = format!("`{}` has no rate `{key}`", abridged(name));
                        lowering.errors.report(&place, "missing_key", detail);
                        None
                    }
                };
                rates.push(node.unwrap_or(zero));
            }
        }
        vec![Region { indicator: above, rates: plus }, Region { indicator: below, rates: minus }]
    }

    fn many(&self, regions: &[FilippovRegion], place: &Pointer<'_>, lowering: &mut Lowering) -> Vec<Region> {
        for (name, state) in self.states.iter() {
            for (key, rate) in [("plus", &state.plus), ("minus", &state.minus)] {
                if rate.is_some() {
                    let detail = "this is a rate on one side of a `surface`, but the problem has `regions`";
                    let (states, error) = (place.key("states"), "surface_or_regions");
                    lowering.errors.report(&states.key(name).key(key), error, detail);
                }
            }
        }
        let place = place.key("regions");
        if regions.len() < 2 {
            let error =
                SpecificationError::new(place.to_string(), "too_few_regions", "there are fewer than two regions");
            lowering
                .errors
                .push(error.expected("two or more regions; write a system without jumps as a `dvi` without variables"));
        }
        regions.iter().enumerate().map(|(i, region)| self.region(region, &place.index(i), lowering)).collect()
    }

    fn region(&self, region: &FilippovRegion, place: &Pointer<'_>, lowering: &mut Lowering) -> Region {
        let zero = lowering.graph.constant(0.0);
        let indicator = lowering.node(&region.indicator, &place.key("indicator")).unwrap_or(zero);
        let place = place.key("rates");
        let mut rates: Vec<Option<Node>> = vec![None; self.states.len()];
        for (name, rate) in region.rates.iter() {
            let place = place.key(name);
            let Some(i) = self.states.names().position(|state| state == name) else {
                lowering.errors.push_with(|| {
                    let detail = format!("`{}` is not a state", abridged(name));
                    SpecificationError::new(place.to_string(), "unknown_name", detail)
                        .expected(listed(self.states.names()))
                        .did_you_mean(nearest(name, self.states.names()))
                });
                continue;
            };
            rates[i] = Some(lowering.node(rate, &place).unwrap_or(zero));
        }
        for (name, _) in self.states.names().zip(&rates).filter(|(_, rate)| rate.is_none()) {
            let detail = format!("the rate of `{}` is missing in this region", abridged(name));
            lowering.errors.report(&place, "missing_key", detail);
        }
        Region { indicator, rates: rates.into_iter().map(|rate| rate.unwrap_or(zero)).collect() }
    }

    /// Names of the variables that weight the regions, with underscores appended until no state has the same name.
    fn shares(&self) -> Vec<String> {
        let mut names: Vec<String> = match &self.regions {
            Some(regions) => (1..=regions.len()).map(|i| format!("z{i}")).collect(),
            None => vec!["z".to_owned()],
        };
        while names.iter().any(|name| self.states.names().any(|state| state == name)) {
            names.iter_mut().for_each(|name| name.push('_'));
        }
        names
    }

    fn warnings(&self, regions: &[Region], states: &[String], lowering: &Lowering) -> Vec<Warning> {
        let rates = regions.iter().flat_map(|region| states.iter().zip(&region.rates));
        let mut warnings: Vec<Warning> =
            rates.flat_map(|(name, &rate)| kinks::warnings(name, rate, states, &lowering.graph)).collect();
        warnings.dedup();
        warnings
    }
}

fn repulsive(ways: usize) -> Warning {
    Warning {
        code: "repulsive_sliding",
        message: format!(
            "at the start {ways} regions meet and the rate of each points into it: the border repels, so that \
             solutions may leave it at any time into any region, and only one of them is computed; choose initial \
             values off the border to select one"
        ),
    }
}
