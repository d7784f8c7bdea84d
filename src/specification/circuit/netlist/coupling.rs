//! Two coupled inductors as an ideal transformer with its leakage and its magnetising inductance (the cantilever model: Erickson
//! and Maksimovic, *Fundamentals of Power Electronics*, section 13.5):
//!
//! ```text
//! v1 = L1 i1' + M i2',    v2 = M i1' + L2 i2',    M = k sqrt(L1 L2)
//! leakage (1 - k^2) L1 in series, k^2 L1 across the primary winding, ratio k sqrt(L1/L2)
//! ```

use super::tokens::Token;
use super::{NetlistError, Rest};
use crate::circuit::components::{Component, Inductor, Transformer};
use crate::expression::Expression;

/// A line `K` of a netlist.
pub(super) struct Coupling<'a> {
    pub first: Token<'a>,
    pub name: String,
    pub inductors: [String; 2],
    pub k: f64,
}

impl<'a> Coupling<'a> {
    /// Reads a line after its first word.
    pub fn read(
        first: Token<'a>,
        name: String,
        rest: &mut Rest<'a, '_>,
        mut component: impl FnMut(Token<'a>) -> String,
    ) -> Result<Self, NetlistError> {
        let inductors = [rest.next("two inductors")?, rest.next("a second inductor")?].map(&mut component);
        if rest.words().len() > 1 {
            let detail = "more than two coupled inductors".to_owned();
            return Err(NetlistError::new(first, "unexpected_word", detail, "two inductors and their coupling"));
        }
        let k = rest.value("a coupling from 0 to 1")?;
        if !(k > 0.0 && k <= 1.0) {
            let detail = format!("the coupling coefficient is {k}");
            return Err(NetlistError::new(first, "out_of_range", detail, "a coupling above 0, and 1 at most"));
        }
        Ok(Self { first, name, inductors, k })
    }

    /// Replaces the two inductors by a transformer with leakage and magnetising inductances.
    ///
    /// # Errors
    /// The inductors do not exist, are coupled already, or have no positive numbers as inductances.
    pub fn apply(&self, components: &mut Vec<Component>, lines: &mut Vec<usize>) -> Result<(), NetlistError> {
        let place = |name: &String| {
            components
                .iter()
                .position(|component| matches!(component, Component::Inductor(inductor) if inductor.name == *name))
        };
        let [Some(p), Some(s)] = [place(&self.inductors[0]), place(&self.inductors[1])] else {
            let detail =
                format!("`{}` must couple two inductors of the netlist that no other `K` couples", self.first.shown());
            return Err(NetlistError::new(self.first, "unknown_name", detail, "two inductors, each in one coupling"));
        };
        let (Component::Inductor(primary), Component::Inductor(secondary)) = (&components[p], &components[s]) else {
            return Ok(());
        };
        let (primary, secondary) = (primary.clone(), secondary.clone());
        let number =
            |expression: &Expression| if let Expression::Number(number) = expression { *number } else { f64::NAN };
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
        let magnetising = i1.zip(i2.or(Some(0.0))).map(|(i1, i2)| Expression::Number(i1 + i2 / ratio));
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
        // Remove the later component first, which keeps the index of the other valid.
        for k in [p.max(s), p.min(s)] {
            components.remove(k);
            lines.remove(k);
        }
        lines.extend(made.iter().map(|_| self.first.line));
        components.extend(made);
        Ok(())
    }
}
