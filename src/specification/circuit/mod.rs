//! The electrical circuit: a list of components, or a netlist that is read into one. The equations are those of
//! [`models::circuit`](models::circuit).

mod components;
mod dependent;
mod elements;
mod faults;
mod lowering;
mod model;
pub(super) mod netlist;

pub use components::{
    Capacitor, Comparator, Component, CurrentSource, Diode, Inductor, OpAmp, Resistor, Switch, Transformer,
    VoltageSource, Zener,
};

use super::expression::Expression;
use super::ordered::Ordered;
use super::tables::TableOfPoints;
use serde::Deserialize;
use utoipa::ToSchema;

/// Largest number of components of a circuit.
const MOST_COMPONENTS: usize = 10_000;

/// Components between nodes, as `components` or as a `netlist`; the node `0` is ground.
///
/// The outputs are the node voltages `v(node)`, the currents `i(name)` from the first node of a component through it to
/// the second, and the voltages `v(name)` of diodes, zeners and switches. The states are `v(C1)` of capacitors and
/// `i(L1)` of inductors; in a circuit without either, `flux(V1)` and `charge(I1)`, the integrals of the sources. The
/// variable of a diode is either its current `i(D1)` or its blocking voltage `forward_volts - v`, called
/// `v_blocked(D1)`; those of a switch controlled by voltages and currents are its voltage `v(S1)` and `closed(S1)`, 1
/// or 0.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CircuitProblem {
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
    /// The components of the circuit, at most 10000.
    pub components: Option<Vec<Component>>,
    /// A netlist in SPICE syntax, at most 64 KiB: lines of `R`, `C`, `L`, `V`, `I`, `D` (ideal), switches `S` and `W`
    /// with a `.model`, the controlled sources `E`, `F`, `G` and `H` with a gain, `K` for coupled inductors, `X`
    /// for a `.subckt`; sources `DC`, `SIN`, `PULSE`, `PWL` and `EXP`, values with suffixes as in `4.7k` or `100n` and
    /// expressions in braces with names of `.param`, `IC=` of capacitors and inductors, `.ic`, comments after `*` and
    /// `;`, continuations after `+`. If it has a `.tran`, its first line is the title; the horizon is taken from `time`
    /// in any case.
    #[schema(max_length = 65536)]
    pub netlist: Option<String>,
}
