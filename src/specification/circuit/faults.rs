//! Faults of a circuit as error messages, in the names of its components.

use crate::error::SpecificationError;
use crate::wording::abridged;
use models::circuit::Fault;

/// The names in a circuit, and the JSON pointers to its components, for messages.
pub(super) struct Names<'a> {
    /// The name of each circuit element.
    pub components: Vec<String>,
    pub nodes: Vec<&'a str>,
    /// Returns the JSON pointer to the component that a circuit element belongs to.
    pub pointer: &'a dyn Fn(usize) -> String,
    /// The JSON pointer to the whole list of components, or to the netlist that the circuit is read from.
    pub whole: String,
}

impl Names<'_> {
    /// Describes a fault of a circuit as a specification error.
    pub fn error(&self, fault: &Fault) -> SpecificationError {
        let first = |elements: &[usize]| elements.first().map_or_else(|| self.whole.clone(), |&k| (self.pointer)(k));
        match fault {
            Fault::Floating(nodes) => {
                let nodes = list(nodes.iter().map(|&node| self.nodes[node]));
                SpecificationError::new(
                    self.whole.clone(),
                    "floating_node",
                    format!("nothing connects {nodes} to ground: only differences of voltages are determined there"),
                )
                .expected("a component from each part of the circuit to the node `0`")
            }
            Fault::SourceLoop(elements) => {
                let detail = format!("{} form a loop of voltage sources without other components", self.list(elements));
                SpecificationError::new(first(elements), "source_loop", detail)
                    .expected("a resistor in the loop: without it the current is not determined")
            }
            Fault::SwitchLoop(elements) => {
                let detail = format!(
                    "{} form a loop of only voltage sources, capacitors and switches: a short circuit when the \
                     switches close",
                    self.list(elements)
                );
                SpecificationError::new(first(elements), "switch_loop", detail)
                    .expected("a resistor in the loop, such as that of a closed switch")
            }
            Fault::SourceCutSet(elements) => {
                let detail = format!(
                    "{} are current sources and the only connection of two parts of the circuit: a cut set",
                    self.list(elements)
                );
                SpecificationError::new(first(elements), "source_cut_set", detail)
                    .expected("a resistor across one of them: without it the voltage is not determined")
            }
            Fault::TooIntertwined(most) => SpecificationError::new(
                self.whole.clone(),
                "too_intertwined",
                format!("the components depend on each other in more than {most} ways"),
            )
            .expected("fewer components, or fewer of them in one loop"),
            &Fault::Impulse { source, element } => {
                let (source_name, name) = (self.quoted(source), self.quoted(element));
                let detail = format!(
                    "{source_name} jumps, and {name} answers to its derivative: an impulse (they share a loop of capacitors \
                     and voltage sources, or a cut set of inductors and current sources)"
                );
                SpecificationError::new((self.pointer)(source), "impulse", detail)
                    .expected("a source that rises in a time of its own, or a resistor between them")
            }
            &Fault::Derivative(source) => {
                let detail = format!(
                    "{} follows voltages or currents in a loop of capacitors and voltage sources, or in a cut set of inductors and \
                     current sources, which answer to its derivative",
                    self.quoted(source)
                );
                SpecificationError::new((self.pointer)(source), "derivative_of_dependent", detail)
                    .expected("a resistor in series with the source of a voltage, or across the source of a current")
            }
            &Fault::InconsistentStart { element, given, implied } => {
                let detail = format!(
                    "{} starts from {given}, but the other components leave only {implied}: off by {:e}",
                    self.quoted(element),
                    given - implied
                );
                SpecificationError::new((self.pointer)(element), "inconsistent_start", detail)
                    .expected("a start that Kirchhoff's laws allow, or none: it follows from the others")
            }
            Fault::Dead => SpecificationError::new(
                self.whole.clone(),
                "dead_circuit",
                "there is no source and nothing that stores energy: every voltage and every current is zero",
            )
            .expected("a source, a capacitor or an inductor"),
            Fault::Singular => SpecificationError::new(
                self.whole.clone(),
                "singular_circuit",
                "the values of the components are too far apart for the equations to be solved",
            ),
        }
    }

    fn quoted(&self, k: usize) -> String {
        format!("`{}`", abridged(&self.components[k]))
    }

    fn list(&self, elements: &[usize]) -> String {
        list(elements.iter().map(|&k| self.components[k].as_str()))
    }
}

/// Joins names in quotes for a message; at most `SHOWN` names are shown.
fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const SHOWN: usize = 12;
    let mut names = names.map(|name| format!("`{}`", abridged(name)));
    let mut list: Vec<String> = names.by_ref().take(SHOWN).collect();
    let more = names.count();
    if more > 0 {
        list.push(format!("{more} more"));
    }
    list.join(", ")
}
