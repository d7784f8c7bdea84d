//! Expansion of a deck into components, with every subcircuit written out at each use.

use super::arithmetic::Scope;
use super::component::{self, Rest, is_ground};
use super::coupling::{Coupling, couple};
use super::deck::{Deck, Given, assignments, nodes_and_options};
use super::device::Kind;
use super::tokens::{Statement, Token};
use super::value::likely_meant;
use super::{Names, Netlist, NetlistError, value_in};
use crate::circuit::MOST_COMPONENTS;
use crate::circuit::components::Component;
use crate::circuit::lowering::GROUND;
use crate::expression::Expression;
use std::collections::HashMap;

/// Maximum nesting depth of subcircuits in a netlist.
const DEEPEST: usize = 16;
/// Largest number of warnings reported for one netlist.
const MOST_REMARKS: usize = 20;

/// The scope of a line of a netlist: the prefix of the names in its subcircuit, such as `X1.`; the names of the port
/// nodes of the subcircuit in the circuit around it; and the parameters.
pub(super) struct Frame<'f> {
    prefix: &'f str,
    ports: HashMap<String, String>,
    pub scope: Scope,
}

impl Frame<'_> {
    pub fn node(&self, token: Token<'_>, names: &mut Names) -> String {
        if is_ground(token.text) {
            return GROUND.to_owned();
        }
        match self.ports.get(&token.text.to_lowercase()) {
            Some(outside) => outside.clone(),
            None => names.of(format!("{}{}", self.prefix, token.text)),
        }
    }

    pub fn component(&self, token: Token<'_>, names: &mut Names) -> String {
        names.of(format!("{}{}", self.prefix, token.text))
    }
}

struct Expansion<'d, 'a> {
    deck: &'d Deck<'a>,
    names: Names,
    netlist: Netlist,
    couplings: Vec<Coupling<'a>>,
    errors: Vec<NetlistError>,
    /// Number of subcircuit instances of the netlist expanded so far.
    instances: usize,
    is_too_large: bool,
}

/// Reads the components of a deck.
///
/// # Errors
/// The given errors, followed by the first error of each faulty line.
pub(super) fn expand(deck: &Deck<'_>, errors: Vec<NetlistError>) -> Result<Netlist, Vec<NetlistError>> {
    let netlist = Netlist {
        components: Vec::new(),
        lines: Vec::new(),
        title: deck.title.map(str::to_owned),
        transient: deck.transient,
        remarks: Vec::new(),
    };
    let mut expansion = Expansion {
        deck,
        names: Names::default(),
        netlist,
        couplings: Vec::new(),
        errors,
        instances: 0,
        is_too_large: false,
    };
    let frame = Frame { prefix: "", ports: HashMap::new(), scope: deck.scope.clone() };
    expansion.lines(&deck.components, &frame, 0);
    // Initial currents are set on the inductors as written, before coupled inductors are replaced.
    expansion.starts(&frame);
    let Netlist { components, lines, .. } = &mut expansion.netlist;
    let refused = couple(&expansion.couplings, components, lines);
    expansion.errors.extend(refused);
    expansion.remarks();
    if expansion.errors.is_empty() { Ok(expansion.netlist) } else { Err(expansion.errors) }
}

impl<'a> Expansion<'_, 'a> {
    fn lines(&mut self, statements: &[Statement<'a>], frame: &Frame<'_>, depth: usize) {
        for statement in statements {
            let Some(&first) = statement.tokens.first() else { continue };
            if self.netlist.components.len() > MOST_COMPONENTS || self.instances > MOST_COMPONENTS {
                if !std::mem::replace(&mut self.is_too_large, true) {
                    let detail = format!("subcircuits make more than {MOST_COMPONENTS} components");
                    let expected = format!("1 to {MOST_COMPONENTS} components");
                    self.errors.push(NetlistError::new(first, "number_of_components", detail, &expected));
                }
                return;
            }
            let read = match first.text.chars().next().unwrap_or(' ').to_ascii_uppercase() {
                'X' => self.instance(statement, frame, depth),
                'K' => self.coupling(statement, frame),
                _ => component::read(statement, frame, &self.deck.models, &mut self.names).map(|components| {
                    self.netlist.lines.extend(components.iter().map(|_| first.line));
                    self.netlist.components.extend(components);
                }),
            };
            if let Err(error) = read {
                self.errors.push(error);
            }
            for token in statement.tokens.iter().skip(1) {
                // The hint that the suffix `F` means femto, not farad, applies to the value of a capacitor alone.
                let meant = likely_meant(token.text);
                if let Some(meant) =
                    meant.filter(|meant| !meant.contains("farad") || first.text.starts_with(['C', 'c']))
                {
                    self.remark(format!("line {}: `{}`: {meant}", token.line, token.shown()));
                }
            }
        }
    }

    fn coupling(&mut self, statement: &Statement<'a>, frame: &Frame<'_>) -> Result<(), NetlistError> {
        let first = statement.tokens[0];
        let name = frame.component(first, &mut self.names);
        let mut rest = Rest::new(statement, &frame.scope);
        let names = &mut self.names;
        self.couplings.push(Coupling::read(first, name, &mut rest, |token| frame.component(token, names))?);
        Ok(())
    }

    /// Expands an instance `X1 nodes NAME [key=value ..]` of the subcircuit `NAME`.
    fn instance(&mut self, statement: &Statement<'a>, frame: &Frame<'_>, depth: usize) -> Result<(), NetlistError> {
        const EXPECTED: &str = "nodes, and the name of a .subckt";
        let first = statement.tokens[0];
        let (words, options) = nodes_and_options(&statement.tokens[1..]);
        let Some((&name, nodes)) = words.split_last() else {
            let detail = format!("something is missing after `{}`", first.shown());
            return Err(NetlistError::new(first, "incomplete_component", detail, EXPECTED));
        };
        let Some(subcircuit) = self.deck.subcircuits.get(&name.text.to_lowercase()) else {
            let detail = format!("there is no subcircuit `{}`", name.shown());
            return Err(NetlistError::new(
                name,
                "unknown_name",
                detail,
                ".subckt with that name, in the netlist itself",
            ));
        };
        if nodes.len() != subcircuit.ports.len() {
            let (given, wanted) = (nodes.len(), subcircuit.ports.len());
            let detail = format!("`{}` has {wanted} nodes, and {given} are given", name.shown());
            return Err(NetlistError::new(name, "wrong_count", detail, EXPECTED));
        }
        if depth >= DEEPEST {
            let detail = format!("subcircuits are nested more than {DEEPEST} levels deep");
            return Err(NetlistError::new(name, "too_deep", detail, "subcircuits that do not contain themselves"));
        }
        self.instances += 1;
        let ports: HashMap<String, String> = subcircuit
            .ports
            .iter()
            .zip(nodes)
            .map(|(port, &node)| (port.clone(), frame.node(node, &mut self.names)))
            .collect();
        let mut scope = self.deck.scope.clone();
        let mut given = Scope::new();
        for (key, value) in assignments(options)? {
            given.insert(key.text.to_lowercase(), value_in(value, &frame.scope)?);
        }
        // Default values of the parameters of a subcircuit may refer to the values given at its instance.
        scope.extend(given.clone());
        for &(key, value) in &subcircuit.defaults {
            let key = key.text.to_lowercase();
            if !given.contains_key(&key) {
                let value = value_in(value, &scope)?;
                scope.insert(key, value);
            }
        }
        let prefix = format!("{}.", frame.component(first, &mut self.names));
        // A `.param` within a subcircuit is local to the instance.
        let mut body = Vec::with_capacity(subcircuit.body.len());
        for statement in &subcircuit.body {
            match statement.tokens.split_first() {
                Some((command, words)) if command.text.eq_ignore_ascii_case(".param") => {
                    for (key, value) in assignments(words)? {
                        let value = value_in(value, &scope)?;
                        scope.insert(key.text.to_lowercase(), value);
                    }
                }
                _ => body.push(statement.clone()),
            }
        }
        let inner = Frame { prefix: &prefix, ports, scope };
        self.lines(&body, &inner, depth + 1);
        Ok(())
    }

    /// Copies the initial values of `.ic` to capacitors and inductors without an `IC=` of their own.
    fn starts(&mut self, frame: &Frame<'_>) {
        let mut volts = HashMap::from([(GROUND.to_owned(), 0.0)]);
        let mut used: Vec<bool> = Vec::new();
        let given: Vec<(String, Given<'_>)> = self
            .deck
            .initial
            .iter()
            .map(|&given| {
                let name = if given.is_current {
                    frame.component(given.of, &mut self.names)
                } else {
                    frame.node(given.of, &mut self.names)
                };
                (name, given)
            })
            .collect();
        for (name, given) in given.iter().filter(|(_, given)| !given.is_current) {
            volts.insert(name.clone(), given.value);
        }
        used.resize(given.len(), false);
        for component in &mut self.netlist.components {
            match component {
                Component::Capacitor(capacitor) => {
                    let (a, b) = &capacitor.nodes;
                    let (Some(above), Some(below)) = (volts.get(a), volts.get(b)) else { continue };
                    for (used, (name, _)) in used.iter_mut().zip(&given) {
                        *used |= name == a || name == b;
                    }
                    capacitor.volts.get_or_insert(Expression::Number(above - below));
                }
                Component::Inductor(inductor) => {
                    for (used, (name, given)) in used.iter_mut().zip(&given) {
                        if given.is_current && *name == inductor.name {
                            *used = true;
                            inductor.amperes.get_or_insert(Expression::Number(given.value));
                        }
                    }
                }
                _ => {}
            }
        }
        for ((_, given), _) in given.iter().zip(used).filter(|(_, used)| !used) {
            let what = if given.is_current {
                "no inductor of that name"
            } else {
                "no capacitor from it to ground or to another node of .ic"
            };
            let detail = format!(".ic of `{}` cannot be set: there is {what}", given.of.shown());
            self.errors.push(NetlistError::new(
                given.of,
                "inconsistent_start",
                detail,
                "IC= of a capacitor or an inductor",
            ));
        }
    }

    /// Warns, once per netlist, of all parts of the netlist that are read differently from SPICE.
    fn remarks(&mut self) {
        let mut idealised: Vec<(&String, Vec<&str>)> = self
            .deck
            .models
            .iter()
            .filter(|(_, model)| model.kind == Kind::Diode && model.value(&["vf", "vfwd"]).is_none())
            .map(|(name, model)| (name, model.left_out()))
            .collect();
        idealised.sort_unstable();
        for (name, left_out) in idealised {
            let which = if left_out.is_empty() { String::new() } else { format!(" without {}", left_out.join(", ")) };
            let message = format!(
                "the diodes of the model `{name}` are ideal{which}: no voltage drop except `VF=`, no reverse recovery"
            );
            self.remark(message);
        }
        let passed_over: Vec<String> =
            self.deck.passed_over.iter().map(|token| format!("`{}`", token.shown())).collect();
        if !passed_over.is_empty() {
            self.remark(format!("{} is ignored: only `.tran` is run", passed_over.join(", ")));
        }
        if self.netlist.transient.is_some_and(|transient| !transient.from_initial) {
            let message = "initial values are those of IC= and .ic, else zero, as with UIC after .tran: no operating \
                           point is computed";
            self.remark(message.to_owned());
        }
    }

    fn remark(&mut self, remark: String) {
        if self.netlist.remarks.len() < MOST_REMARKS && !self.netlist.remarks.contains(&remark) {
            self.netlist.remarks.push(remark);
        }
    }
}
