//! Coupled inductors of a netlist. Two coupled inductors are an ideal transformer with a leakage and a magnetising
//! inductance (the cantilever model: Erickson and Maksimovic, *Fundamentals of Power Electronics*, section 13.5);
//! larger groups are in [`super::windings`].
//!
//! ```text
//! v1 = L1 i1' + M i2',    v2 = M i1' + L2 i2',    M = k sqrt(L1 L2)
//! leakage (1 - k^2) L1 in series, k^2 L1 across the primary winding, ratio k sqrt(L1/L2)
//! ```

use super::tokens::Token;
use super::{NetlistError, Rest, windings};
use crate::circuit::components::{Component, Inductor, Transformer};
use crate::expression::Expression;
use numerics::components as connected;
use std::collections::HashMap;

/// A statement `K` of a netlist, which couples inductors.
pub(super) struct Coupling<'a> {
    pub first: Token<'a>,
    pub name: String,
    /// Names of the coupled inductors, at least two.
    pub inductors: Vec<String>,
    pub k: f64,
}

impl<'a> Coupling<'a> {
    /// Reads the rest of a statement `K`, which couples inductors, after its first word.
    pub fn read(
        first: Token<'a>,
        name: String,
        rest: &mut Rest<'a, '_>,
        mut component: impl FnMut(Token<'a>) -> String,
    ) -> Result<Self, NetlistError> {
        let mut inductors = [rest.next("two inductors")?, rest.next("a second inductor")?].map(&mut component).to_vec();
        while rest.words().len() > 1 {
            inductors.push(component(rest.next("an inductor")?));
        }
        let k = rest.value("a coupling from 0 to 1")?;
        if !(k > 0.0 && k <= 1.0) {
            let detail = format!("the coupling coefficient is {k}");
            return Err(NetlistError::new(first, "out_of_range", detail, "a coupling above 0, and 1 at most"));
        }
        Ok(Self { first, name, inductors, k })
    }

    /// Replaces two inductors, which no other statement couples, by a transformer with leakage and magnetising
    /// inductances.
    ///
    /// # Errors
    /// The inductors do not exist, or have no positive numbers as inductances.
    fn apply(
        &self,
        [primary, secondary]: [&String; 2],
        components: &mut Vec<Component>,
        lines: &mut Vec<usize>,
    ) -> Result<(), NetlistError> {
        let [p, s] = [self.place(primary, components)?, self.place(secondary, components)?];
        let (Component::Inductor(primary), Component::Inductor(secondary)) = (&components[p], &components[s]) else {
            return Ok(());
        };
        let (primary, secondary) = (primary.clone(), secondary.clone());
        let [l1, l2] = [&primary, &secondary].map(|inductor| number(&inductor.henries));
        let [i1, i2] = [&primary, &secondary].map(|inductor| inductor.amperes.as_ref().map(number));
        let ratio = self.k * (l1 / l2).sqrt();
        if !(ratio > 0.0 && ratio.is_finite()) || p == s {
            let detail = format!(
                "`{}` couples two inductors, and their inductances must be positive numbers",
                self.first.shown()
            );
            return Err(NetlistError::new(self.first, "out_of_range", detail, "inductances above 0"));
        }
        let has_start = i1.is_some() || i2.is_some();
        let magnetising = has_start.then(|| Expression::Number(i1.unwrap_or(0.0) + i2.unwrap_or(0.0) / ratio));
        let (a, b) = primary.nodes;
        let leakage = (1.0 - self.k * self.k) * l1;
        let (inner, mut made) = if leakage > 0.0 {
            let inner = format!("{}.in", self.name);
            let (name, nodes) = (primary.name.clone(), (a, inner.clone()));
            (
                inner,
                vec![Component::Inductor(Inductor { name, nodes, henries: leakage.into(), amperes: primary.amperes })],
            )
        } else {
            (a, Vec::new())
        };
        let nodes = (inner, b);
        let across = Inductor {
            name: format!("{}.m", self.name),
            nodes: nodes.clone(),
            henries: (self.k * self.k * l1).into(),
            amperes: magnetising,
        };
        made.push(Component::Inductor(across));
        let transformer =
            Transformer { name: self.name.clone(), primary: nodes, secondary: secondary.nodes, ratio: ratio.into() };
        made.push(Component::Transformer(transformer));
        // Of the two coupled inductors, remove the later component first, which keeps the index of the other valid.
        for k in [p.max(s), p.min(s)] {
            components.remove(k);
            lines.remove(k);
        }
        lines.extend(made.iter().map(|_| self.first.line));
        components.extend(made);
        Ok(())
    }

    /// Returns the index of an inductor among the components.
    ///
    /// # Errors
    /// There is no such inductor.
    pub fn place(&self, name: &String, components: &[Component]) -> Result<usize, NetlistError> {
        let is_it =
            |component: &Component| matches!(component, Component::Inductor(inductor) if inductor.name == *name);
        components.iter().position(is_it).ok_or_else(|| {
            let detail = format!("`{}` must couple inductors of the netlist", self.first.shown());
            NetlistError::new(self.first, "unknown_name", detail, "the names of inductors")
        })
    }
}

/// Replaces all coupled inductors of a netlist by equivalent components; returns an error for each group that cannot be
/// replaced.
pub(super) fn couple(
    couplings: &[Coupling<'_>],
    components: &mut Vec<Component>,
    lines: &mut Vec<usize>,
) -> Vec<NetlistError> {
    let mut errors = Vec::new();
    for group in groups(couplings) {
        let result = match (group.as_slice(), group[0].inductors.as_slice()) {
            ([coupling], [primary, secondary]) => coupling.apply([primary, secondary], components, lines),
            _ => windings::apply(&group, components, lines),
        };
        errors.extend(result.err());
    }
    errors
}

/// Returns the couplings of inductors in groups that are connected by common inductors, in the order of their first
/// lines.
fn groups<'c, 'a>(couplings: &'c [Coupling<'a>]) -> Vec<Vec<&'c Coupling<'a>>> {
    let mut edges = vec![Vec::new(); couplings.len()];
    let mut last: HashMap<&str, usize> = HashMap::new();
    for (k, coupling) in couplings.iter().enumerate() {
        for inductor in &coupling.inductors {
            if let Some(before) = last.insert(inductor, k) {
                edges[before].push(k);
                edges[k].push(before);
            }
        }
    }
    // Edges between couplings go in both directions, so that a strongly connected component of the graph is a whole
    // group.
    connected(&edges).into_iter().map(|group| group.into_iter().map(|k| &couplings[k]).collect()).collect()
}

/// Returns the value of an expression that is given as a number, and NaN for an expression in text.
pub(super) fn number(expression: &Expression) -> f64 {
    if let Expression::Number(number) = expression { *number } else { f64::NAN }
}
