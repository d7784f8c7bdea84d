//! The equations of a circuit on its normal tree. Everything is a linear form over
//!
//! ```text
//! q = (x, z, e, e'),    x = (tree capacitor voltages, link inductor currents),    z: diodes,    e: sources
//! ```
//!
//! 1. What is given: the voltage of each tree element, and the current of each link, but for resistors.
//! 2. The voltages `v` of tree resistors, with `Y` the conductances and `F` the loops of links:
//!    `(Y_t + F^T Y_l F) v = -F^T Y_l v_given - F^T i_given`, positive definite.
//! 3. The charges of capacitors and the fluxes of inductors: `M x' = ..`, where capacitors that are links and inductors
//!    that are in the tree are added to those of their loops and cut sets. `M` is positive definite too.
//! 4. The other of voltage and current of every element, by Kirchhoff's laws; for the diodes, that is `G`.

use super::form::Form;
use super::solve::solve;
use super::{Columns, Element, Fault, Law, NormalTree, Port};

/// The equations of a circuit, as forms over its columns.
#[derive(Clone, Debug)]
pub struct Equations {
    /// `x'`, one a state.
    pub rates: Vec<Form>,
    /// `G`, one a variable.
    pub inequality: Vec<Form>,
    /// The voltage of every element.
    pub voltages: Vec<Form>,
    /// The current of every element.
    pub currents: Vec<Form>,
}

impl Equations {
    /// The equations of `elements` on their tree.
    ///
    /// # Errors
    /// [`Fault::Singular`] where rounding makes a matrix indefinite that is positive definite.
    pub fn new(elements: &[Element], tree: &NormalTree, columns: &Columns) -> Result<Self, Fault> {
        let mut assembly = Assembly::given(elements, tree, columns);
        assembly.resistors()?;
        let rates = assembly.storage()?;
        let Assembly { voltages, currents, .. } = assembly.rest(&rates);
        let slack = |sign: f64, v: &Form, bound: f64| {
            let mut slack = v.times(sign);
            slack.add_term(columns.one(), bound);
            slack
        };
        let inequality = columns.ports.iter().map(|&port| {
            let k = port.element();
            match (port, &elements[k].law) {
                (Port::Voltage(_), _) => currents[k].times(-1.0),
                (Port::Conducting(_), Law::Diode { forward } | Law::Zener { forward, .. }) => {
                    slack(-1.0, &voltages[k], *forward)
                }
                (Port::BreakingDown(_), Law::Zener { breakdown, .. }) => slack(1.0, &voltages[k], *breakdown),
                _ => currents[k].clone(),
            }
        });
        let inequality = inequality.collect();
        Ok(Self { rates, inequality, voltages, currents })
    }
}

/// Voltages and currents, as far as they are known; an element that is not yet known has an empty form.
struct Assembly<'a> {
    elements: &'a [Element],
    tree: &'a NormalTree,
    columns: &'a Columns,
    voltages: Vec<Form>,
    currents: Vec<Form>,
}

impl<'a> Assembly<'a> {
    fn given(elements: &'a [Element], tree: &'a NormalTree, columns: &'a Columns) -> Self {
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
                    if let Law::Diode { forward } = elements[k].law {
                        voltages[k].add_term(columns.one(), forward);
                    }
                }
                Port::Conducting(_) => currents[k].add_term(z, 1.0),
                Port::BreakingDown(_) => currents[k].add_term(z, -1.0),
                Port::Voltage(_) => voltages[k].add_term(z, 1.0),
            }
        }
        for (k, element) in elements.iter().enumerate() {
            match element.law {
                Law::VoltageSource(_) => voltages[k].add_term(columns.source(k), 1.0),
                Law::CurrentSource(_) => currents[k].add_term(columns.source(k), 1.0),
                _ => {}
            }
        }
        let mut assembly = Self { elements, tree, columns, voltages, currents };
        for (k, element) in elements.iter().enumerate() {
            match (&element.law, tree.contains[k]) {
                (Law::Capacitor(..), false) => assembly.voltages[k] = assembly.loop_voltage(k),
                (Law::Inductor(..), true) => assembly.currents[k] = assembly.cut_current(k),
                _ => {}
            }
        }
        assembly
    }

    /// `v_l` as the sum over what is known of its loop.
    fn loop_voltage(&self, l: usize) -> Form {
        let mut sum = Form::default();
        self.tree.loops[l].iter().for_each(|&(t, sign)| sum.add(&self.voltages[t], sign));
        sum
    }

    /// `i_t` as the sum over what is known of its cut set.
    fn cut_current(&self, t: usize) -> Form {
        let mut sum = Form::default();
        self.tree.cuts[t].iter().for_each(|&(l, sign)| sum.add(&self.currents[l], -sign));
        sum
    }

    /// Step 2: the voltages and currents of all resistors.
    fn resistors(&mut self) -> Result<(), Fault> {
        let conductances: Vec<Option<f64>> = self
            .elements
            .iter()
            .map(|element| if let Law::Resistor(ohms) = element.law { Some(1.0 / ohms) } else { None })
            .collect();
        let of = |inside: bool| -> Vec<usize> {
            (0..conductances.len()).filter(|&k| conductances[k].is_some() && self.tree.contains[k] == inside).collect()
        };
        let (branches, links) = (of(true), of(false));
        let y = |k: usize| conductances[k].unwrap_or(0.0);
        let mut row_of = vec![usize::MAX; conductances.len()];
        branches.iter().enumerate().for_each(|(row, &t)| row_of[t] = row);
        let mut matrix: Vec<_> = branches.iter().enumerate().map(|(row, &t)| (row, row, y(t))).collect();
        // The currents of the links that are known, and of the resistors what their known voltages drive.
        let mut right: Vec<Form> = branches.iter().map(|&t| self.cut_current(t)).collect();
        for &l in &links {
            let known = self.loop_voltage(l);
            let inside: Vec<_> = self.tree.loops[l].iter().filter(|&&(t, _)| conductances[t].is_some()).collect();
            for &&(t, sign) in &inside {
                right[row_of[t]].add(&known, -sign * y(l));
                matrix.extend(inside.iter().map(|&&(u, other)| (row_of[t], row_of[u], sign * other * y(l))));
            }
        }
        for (&t, v) in branches.iter().zip(solve(&matrix, right).ok_or(Fault::Singular)?) {
            self.currents[t] = v.times(y(t));
            self.voltages[t] = v;
        }
        for l in links {
            let v = self.loop_voltage(l);
            self.currents[l] = v.times(y(l));
            self.voltages[l] = v;
        }
        Ok(())
    }

    /// Step 3: `x'`.
    fn storage(&self) -> Result<Vec<Form>, Fault> {
        let states = &self.columns.states;
        let mut row_of = vec![usize::MAX; self.elements.len()];
        states.iter().enumerate().for_each(|(row, &k)| row_of[k] = row);
        let mut matrix: Vec<_> = states.iter().enumerate().map(|(x, &k)| (x, x, self.size(k))).collect();
        let mut right: Vec<Form> = states
            .iter()
            .map(|&k| if self.tree.contains[k] { self.cut_current(k) } else { self.loop_voltage(k) })
            .collect();
        for k in 0..self.elements.len() {
            for &(of, sign) in self.dependent(k) {
                let Some(&row) = row_of.get(of).filter(|&&row| row < states.len()) else { continue };
                for &(other, factor) in self.dependent(k) {
                    let coefficient = sign * factor * self.size(k);
                    match row_of[other] {
                        column if column < states.len() => matrix.push((row, column, coefficient)),
                        _ => right[row].add_term(self.columns.derivative(other), -coefficient),
                    }
                }
            }
        }
        solve(&matrix, right).ok_or(Fault::Singular)
    }

    /// Of a capacitor that is a link, its loop; of an inductor in the tree, its cut set; nothing of others.
    fn dependent(&self, k: usize) -> &'a [(usize, f64)] {
        match (&self.elements[k].law, self.tree.contains[k]) {
            (Law::Capacitor(..), false) => &self.tree.loops[k],
            (Law::Inductor(..), true) => &self.tree.cuts[k],
            _ => &[],
        }
    }

    /// Farads or henries.
    fn size(&self, k: usize) -> f64 {
        match self.elements[k].law {
            Law::Capacitor(size, _) | Law::Inductor(size, _) => size,
            _ => 0.0,
        }
    }

    /// Step 4, once `x'` is known.
    fn rest(mut self, rates: &[Form]) -> Self {
        let mut rate_of = vec![None; self.elements.len()];
        self.columns.states.iter().zip(rates).for_each(|(&k, rate)| rate_of[k] = Some(rate));
        for k in 0..self.elements.len() {
            let mut rate = Form::default();
            for &(of, sign) in self.dependent(k) {
                match rate_of[of] {
                    Some(other) => rate.add(other, sign),
                    None => rate.add_term(self.columns.derivative(of), sign),
                }
            }
            match (&self.elements[k].law, self.tree.contains[k]) {
                (&Law::Capacitor(farads, _), false) => self.currents[k] = rate.times(farads),
                (&Law::Inductor(henries, _), true) => self.voltages[k] = rate.times(-henries),
                _ => {}
            }
        }
        for k in 0..self.elements.len() {
            match (&self.elements[k].law, self.tree.contains[k]) {
                (Law::Resistor(_), _) | (Law::Capacitor(..), false) | (Law::Inductor(..), true) => {}
                (_, true) => self.currents[k] = self.cut_current(k),
                (_, false) => self.voltages[k] = self.loop_voltage(k),
            }
        }
        self
    }
}
