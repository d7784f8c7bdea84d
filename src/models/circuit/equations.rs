//! The equations of a circuit on its normal tree. Voltages, currents and rates are linear forms over
//!
//! ```text
//! q = (x, z, e, e'),    x = (tree capacitor voltages, link inductor currents),    z: diodes,    e: sources
//! ```
//!
//! 1. Known quantities: the voltage of each tree element and the current of each link, except for resistors.
//! 2. Resistors: removing the resistors from the tree leaves islands of nodes. The potentials `u` of the islands,
//!    relative to the first island of each group connected by resistors, solve `v = B^T u + v_given`, `B Y v =
//!    i_given`, with the incidence matrix `B` of the resistors and their conductances `Y`. `B Y B^T` is positive
//!    definite, and as sparse as the circuit.
//! 3. Storage: charges of capacitors and fluxes of inductors give `M x' = ..`, where capacitors that are links and
//!    inductors that are in the tree contribute to the elements of their loops and cut sets. `M` is positive
//!    definite.
//! 4. The complementary quantity (current of tree elements, voltage of links) by Kirchhoff's laws; for diodes, it is
//!    `G`.

use super::form::{Coefficient, Form};
use super::solve::solve;
use super::{Columns, Direction, Element, Fault, Law, NormalTree, Port, Quantity};
use std::cell::Cell;

/// Maximum number of terms of linear forms added during the elimination of a circuit's unknowns, and of terms in the
/// solution of one linear system.
pub(super) const MOST_TERMS: usize = 2_000_000;

/// The equations of a circuit, as linear forms over its states, variables and sources (its [`Columns`]).
#[derive(Clone, Debug)]
pub struct Equations {
    /// The time derivatives `x'` of the circuit's states, one linear form per state.
    pub rates: Vec<Form>,
    /// The inequality functions `G` of the circuit, one linear form per variable.
    pub inequality: Vec<Form>,
    /// The voltages across all circuit elements, one linear form per element.
    pub voltages: Vec<Form>,
    /// The currents through all circuit elements, one linear form per element.
    pub currents: Vec<Form>,
    /// The voltages of all circuit nodes relative to ground, one linear form per node.
    pub nodes: Vec<Form>,
}

impl Equations {
    /// Derives the equations of `elements` on their normal tree.
    ///
    /// # Errors
    /// [`Fault::Singular`] if rounding errors make a positive definite matrix indefinite, and [`Fault::TooIntertwined`]
    /// if the forms have too many terms.
    pub fn new(elements: &[Element], tree: &NormalTree, columns: &Columns) -> Result<Self, Fault> {
        Self::along(elements, tree, columns, &Direction::default())
    }

    /// Derives the equations as [`new`](Self::new), with the derivatives of all coefficients along a direction in the
    /// space of element values.
    ///
    /// # Errors
    /// See [`new`](Self::new).
    pub fn along(
        elements: &[Element],
        tree: &NormalTree,
        columns: &Columns,
        direction: &Direction,
    ) -> Result<Self, Fault> {
        let mut assembly = Assembly::given(elements, tree, columns, direction)?;
        assembly.resistors()?;
        let mut rates = assembly.storage()?;
        let assembly = assembly.rest(&rates)?;
        rates.extend(columns.integrals.iter().map(|&k| {
            let mut rate = Form::default();
            let own = columns.ports.iter().position(|port| *port == Port::Source(k));
            rate.add_term(own.map_or_else(|| columns.source(k), |z| columns.variable(z)), 1.0);
            rate
        }));
        let nodes = assembly.nodes()?;
        let Assembly { voltages, currents, .. } = assembly;
        let slack = |sign: f64, v: &Form, k: usize, quantity: Quantity| {
            let bound = direction.at(elements, k, quantity);
            let mut slack = v.times(sign);
            slack.add_term(columns.one(), bound);
            slack
        };
        let inequality = columns.ports.iter().map(|&port| {
            let k = port.element();
            match (port, &elements[k].law) {
                (Port::Voltage(_), _) => currents[k].times(-1.0),
                (Port::Source(_), _) => Form::default(),
                (Port::Conducting(_), Law::Diode { .. } | Law::Zener { .. }) => {
                    slack(-1.0, &voltages[k], k, Quantity::Forward)
                }
                (Port::BreakingDown(_), Law::Zener { .. }) => slack(1.0, &voltages[k], k, Quantity::Breakdown),
                _ => currents[k].clone(),
            }
        });
        let inequality = inequality.collect();
        Ok(Self { rates, inequality, voltages, currents, nodes })
    }
}

/// Voltages and currents of the elements during the elimination; the linear form of a voltage or current that is not
/// yet known is empty.
struct Assembly<'a> {
    elements: &'a [Element],
    tree: &'a NormalTree,
    columns: &'a Columns,
    direction: &'a Direction,
    voltages: Vec<Form>,
    currents: Vec<Form>,
    terms_left: Cell<usize>,
}

impl<'a> Assembly<'a> {
    /// Step 1 of the elimination of a circuit's unknowns: sets the known voltages of tree elements and the known
    /// currents of links.
    fn given(
        elements: &'a [Element],
        tree: &'a NormalTree,
        columns: &'a Columns,
        direction: &'a Direction,
    ) -> Result<Self, Fault> {
        let mut voltages = vec![Form::default(); elements.len()];
        let mut currents = voltages.clone();
        for (x, &k) in columns.states.iter().enumerate() {
            let of = if tree.contains[k] { &mut voltages } else { &mut currents };
            of[k].add_term(x, 1.0);
        }
        for (z, &port) in columns.ports.iter().enumerate() {
            let (k, z) = (port.element(), columns.variable(z));
            match port {
                Port::Blocking(_) => {
                    voltages[k].add_term(z, -1.0);
                    if let Law::Diode { .. } = elements[k].law {
                        voltages[k].add_term(columns.one(), direction.at(elements, k, Quantity::Forward));
                    }
                }
                Port::Conducting(_) => currents[k].add_term(z, 1.0),
                Port::BreakingDown(_) => currents[k].add_term(z, -1.0),
                Port::Source(_) if matches!(elements[k].law, Law::DependentCurrent) => currents[k].add_term(z, 1.0),
                Port::Voltage(_) | Port::Source(_) => voltages[k].add_term(z, 1.0),
            }
        }
        for (k, element) in elements.iter().enumerate() {
            match element.law {
                Law::VoltageSource(_) => voltages[k].add_term(columns.source(k), 1.0),
                Law::CurrentSource(_) => currents[k].add_term(columns.source(k), 1.0),
                _ => {}
            }
        }
        let terms_left = Cell::new(MOST_TERMS);
        let mut assembly = Self { elements, tree, columns, direction, voltages, currents, terms_left };
        for (k, element) in elements.iter().enumerate() {
            match (&element.law, tree.contains[k]) {
                (Law::Capacitor(..), false) => assembly.voltages[k] = assembly.loop_voltage(k)?,
                (Law::Inductor(..), true) => assembly.currents[k] = assembly.cut_current(k)?,
                _ => {}
            }
        }
        Ok(assembly)
    }

    /// Returns the voltage of link `l` as the sum of the known voltages of its fundamental loop.
    fn loop_voltage(&self, l: usize) -> Result<Form, Fault> {
        self.sum(&self.tree.loops[l], &self.voltages, 1.0)
    }

    /// Returns the current of tree element `t` as the sum of the known currents of its fundamental cut set.
    fn cut_current(&self, t: usize) -> Result<Form, Fault> {
        self.sum(&self.tree.cuts[t], &self.currents, -1.0)
    }

    fn sum(&self, entries: &[(usize, f64)], forms: &[Form], factor: f64) -> Result<Form, Fault> {
        self.spend(entries.iter().map(|&(k, _)| forms[k].len()).sum())?;
        let mut sum = Form::default();
        entries.iter().for_each(|&(k, sign)| sum.add(&forms[k], factor * sign));
        Ok(sum)
    }

    /// Deducts a number of added terms from the remaining budget of the elimination, `MOST_TERMS` at the start.
    fn spend(&self, terms: usize) -> Result<(), Fault> {
        let left = self.terms_left.get().checked_sub(terms).ok_or(Fault::TooIntertwined(MOST_TERMS))?;
        self.terms_left.set(left);
        Ok(())
    }

    /// Step 2 of the elimination of a circuit's unknowns: computes the voltages and currents of all resistors.
    fn resistors(&mut self) -> Result<(), Fault> {
        let (tree, elements) = (self.tree, self.elements);
        let is_resistor = |k: &usize| matches!(elements[*k].law, Law::Resistor(_));
        let conductance = |k: usize| Coefficient::from(1.0) / self.size(k);
        let resistors: Vec<(usize, Coefficient)> =
            (0..elements.len()).filter(is_resistor).map(|k| (k, conductance(k))).collect();
        let mut row_of = vec![None; elements.len()];
        let branches = resistors.iter().filter(|&&(k, _)| tree.contains[k]);
        let count = branches.enumerate().map(|(row, &(t, _))| row_of[t] = Some(row)).count();
        let islands = tree.islands(elements);
        let ends = |k: usize| {
            let (a, b) = elements[k].nodes;
            [(islands[a], 1.0), (islands[b], -1.0)]
                .into_iter()
                .filter_map(|(island, sign)| Some((row_of[island?]?, sign)))
        };
        let mut matrix = Vec::new();
        let mut right = vec![Form::default(); count];
        let mut known = Vec::with_capacity(resistors.len());
        for &(k, y) in &resistors {
            let (v, i) = match tree.contains[k] {
                true => (Form::default(), self.cut_current(k)?),
                false => (self.loop_voltage(k)?, Form::default()),
            };
            for (row, sign) in ends(k) {
                right[row].add(&i, sign);
                right[row].add(&v, Coefficient::from(-sign) * y);
                matrix.extend(ends(k).map(|(column, other)| (row, column, Coefficient::from(sign * other) * y)));
            }
            known.push(v);
        }
        let potentials = solve(&matrix, right)?;
        for (&(k, y), mut v) in resistors.iter().zip(known) {
            ends(k).for_each(|(row, sign)| v.add(&potentials[row], sign));
            self.currents[k] = v.times(y);
            self.voltages[k] = v;
        }
        Ok(())
    }

    /// Step 3 of the elimination of a circuit's unknowns: computes the time derivatives `x'` of the states.
    fn storage(&self) -> Result<Vec<Form>, Fault> {
        let states = &self.columns.states;
        let mut row_of = vec![usize::MAX; self.elements.len()];
        states.iter().enumerate().for_each(|(row, &k)| row_of[k] = row);
        let mut matrix: Vec<_> = states.iter().enumerate().map(|(x, &k)| (x, x, self.size(k))).collect();
        let mut right: Vec<Form> = states
            .iter()
            .map(|&k| if self.tree.contains[k] { self.cut_current(k) } else { self.loop_voltage(k) })
            .collect::<Result<_, _>>()?;
        for k in 0..self.elements.len() {
            let left = MOST_TERMS.saturating_sub(matrix.len());
            if self.dependent(k).len().pow(2) > left {
                return Err(Fault::TooIntertwined(MOST_TERMS));
            }
            for &(of, sign) in self.dependent(k) {
                let Some(&row) = row_of.get(of).filter(|&&row| row < states.len()) else { continue };
                for &(other, factor) in self.dependent(k) {
                    let coefficient = Coefficient::from(sign * factor) * self.size(k);
                    match row_of[other] {
                        column if column < states.len() => matrix.push((row, column, coefficient)),
                        _ => right[row].add_term(self.columns.derivative(other), -coefficient),
                    }
                }
            }
        }
        solve(&matrix, right)
    }

    /// Returns the fundamental loop of a capacitor that is a link, or the fundamental cut set of an inductor in the
    /// tree; empty for other elements.
    fn dependent(&self, k: usize) -> &'a [(usize, f64)] {
        match (&self.elements[k].law, self.tree.contains[k]) {
            (Law::Capacitor(..), false) => &self.tree.loops[k],
            (Law::Inductor(..), true) => &self.tree.cuts[k],
            _ => &[],
        }
    }

    /// Returns the resistance, capacitance or inductance of circuit element `k` in ohms, farads or henries.
    fn size(&self, k: usize) -> Coefficient {
        self.direction.at(self.elements, k, Quantity::Size)
    }

    /// Step 4 of the elimination of a circuit's unknowns: computes all remaining voltages and currents of elements from
    /// the time derivatives `x'` of the states.
    fn rest(mut self, rates: &[Form]) -> Result<Self, Fault> {
        let mut rate_of = vec![None; self.elements.len()];
        self.columns.states.iter().zip(rates).for_each(|(&k, rate)| rate_of[k] = Some(rate));
        for k in 0..self.elements.len() {
            let mut rate = Form::default();
            for &(of, sign) in self.dependent(k) {
                match rate_of[of] {
                    Some(other) => {
                        self.spend(other.len())?;
                        rate.add(other, sign);
                    }
                    None => rate.add_term(self.columns.derivative(of), sign),
                }
            }
            match (&self.elements[k].law, self.tree.contains[k]) {
                (Law::Capacitor(..), false) => self.currents[k] = rate.times(self.size(k)),
                (Law::Inductor(..), true) => self.voltages[k] = rate.times(-self.size(k)),
                _ => {}
            }
        }
        for k in 0..self.elements.len() {
            match (&self.elements[k].law, self.tree.contains[k]) {
                (Law::Resistor(_), _) | (Law::Capacitor(..), false) | (Law::Inductor(..), true) => {}
                (_, true) => self.currents[k] = self.cut_current(k)?,
                (_, false) => self.voltages[k] = self.loop_voltage(k)?,
            }
        }
        Ok(self)
    }

    /// Computes the node voltages of the circuit, summed along the tree from ground.
    fn nodes(&self) -> Result<Vec<Form>, Fault> {
        let mut nodes = vec![Form::default(); self.tree.nodes()];
        for (node, element, sign, to) in self.tree.outwards() {
            let mut voltage = nodes[to].clone();
            voltage.add(&self.voltages[element], sign);
            self.spend(voltage.len())?;
            nodes[node] = voltage;
        }
        Ok(nodes)
    }
}
