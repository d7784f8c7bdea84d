//! Networks of resistors, capacitors, inductors, sources and ideal diodes: written as a `circuit`, and reduced by
//! nodal analysis to a linear complementarity system, in which capacitors are voltage sources, and inductors and
//! diodes are current sources. The reduction fails if all components at a node are current sources.

use crate::differential::linear::{Linear, Shape};
use crate::differential::problem::View;
use crate::differential::signal::Signal;
use nalgebra::{DMatrix, DVector};
use serde_json::{Value, json};

/// Leakage resistance, relative to the largest resistance: large enough to have little effect, and small enough for
/// its currents to be far above rounding errors.
const LEAK: f64 = 1e7;

#[derive(Clone, Debug)]
pub enum Part {
    Resistor(f64),
    /// A capacitor, with its capacitance in farads and its initial voltage in volts.
    Capacitor(f64, f64),
    /// An inductor, with its inductance in henries and its initial current in amperes.
    Inductor(f64, f64),
    Voltage(Signal),
    Diode,
}

/// Components between nodes; node 0 is the ground.
#[derive(Clone, Debug, Default)]
pub struct Network {
    pub parts: Vec<(Part, usize, usize)>,
}

impl Network {
    pub fn add(&mut self, part: Part, from: usize, to: usize) {
        self.parts.push((part, from, to));
    }

    fn nodes(&self) -> usize {
        self.parts.iter().map(|(_, a, b)| *a.max(b)).max().unwrap_or(0)
    }

    /// Returns the names of the states, capacitor voltages and inductor currents, in the order of the components.
    pub fn states(&self) -> Vec<String> {
        let name = |(k, (part, _, _)): (usize, &(Part, usize, usize))| match part {
            Part::Capacitor(..) => Some(format!("v(C{k})")),
            Part::Inductor(..) => Some(format!("i(L{k})")),
            _ => None,
        };
        self.parts.iter().enumerate().filter_map(name).collect()
    }

    /// Returns the weights of the squared states in the energy that the network stores.
    pub fn energy(&self) -> Vec<f64> {
        let weight = |(part, _, _): &(Part, usize, usize)| match part {
            Part::Capacitor(capacity, _) => Some(*capacity),
            Part::Inductor(inductance, _) => Some(*inductance),
            _ => None,
        };
        self.parts.iter().filter_map(weight).collect()
    }

    /// Returns the network as the `problem` of a specification.
    pub fn document(&self, view: &View) -> Value {
        let mut state = 0;
        let mut start = |value: f64| {
            state += 1;
            (value + view.change(state - 1)) / view.size
        };
        let component = |(k, (part, from, to)): (usize, &(Part, usize, usize))| {
            let nodes = [from.to_string(), to.to_string()];
            match part {
                Part::Resistor(ohms) => json!({"resistor": {"name": format!("R{k}"), "nodes": nodes, "ohms": ohms}}),
                Part::Capacitor(farads, volts) => json!({"capacitor": {
                    "name": format!("C{k}"), "nodes": nodes, "farads": farads / view.time, "volts": start(*volts)
                }}),
                Part::Inductor(henries, amperes) => json!({"inductor": {
                    "name": format!("L{k}"), "nodes": nodes, "henries": henries / view.time, "amperes": start(*amperes)
                }}),
                Part::Voltage(signal) => json!({"voltage_source": {
                    "name": format!("V{k}"), "nodes": nodes, "volts": signal.expression(1.0 / view.size, view.time)
                }}),
                Part::Diode => json!({"diode": {"name": format!("D{k}"), "nodes": nodes}}),
            }
        };
        let components: Vec<Value> = self.parts.iter().enumerate().map(component).collect();
        json!({"circuit": {"components": components}})
    }

    /// Reduces the network with leakage from every node to the ground, for networks that cannot be reduced without;
    /// also returns the relative change of the solution by the leakage.
    pub fn leaking(&self) -> Option<(Linear, f64)> {
        let resistance =
            |(part, _, _): &(Part, usize, usize)| if let Part::Resistor(ohms) = part { *ohms } else { 0.0 };
        let largest = self.parts.iter().map(resistance).fold(0.0, f64::max);
        let mut network = self.clone();
        (1..=self.nodes()).for_each(|node| network.add(Part::Resistor(LEAK * largest), node, 0));
        Some((network.system()?, 100.0 / LEAK))
    }

    /// Reduces the network to a system in capacitor voltages, inductor currents and diode currents; `None` if nodal
    /// analysis does not determine it.
    pub fn system(&self) -> Option<Linear> {
        let (nodes, parts) = (self.nodes(), &self.parts);
        let place =
            |such: fn(&Part) -> bool| -> Vec<usize> { (0..parts.len()).filter(|&k| such(&parts[k].0)).collect() };
        let states = place(|part| matches!(part, Part::Capacitor(..) | Part::Inductor(..)));
        let diodes = place(|part| matches!(part, Part::Diode));
        let sources = place(|part| matches!(part, Part::Voltage(_)));
        // Unknowns of the nodal analysis: the node voltages, and the currents through components with a given
        // voltage.
        let given = place(|part| matches!(part, Part::Capacitor(..) | Part::Voltage(_)));
        let unknowns = nodes + given.len();
        let columns = states.len() + diodes.len() + sources.len();
        let mut m = DMatrix::zeros(unknowns, unknowns);
        let mut known = DMatrix::zeros(unknowns, columns);
        let column = |k: usize| {
            let of_state = states.iter().position(|&other| other == k);
            let of_diode = || diodes.iter().position(|&other| other == k).map(|p| states.len() + p);
            let of_source = || sources.iter().position(|&other| other == k).map(|p| states.len() + diodes.len() + p);
            of_state.or_else(of_diode).or_else(of_source).expect("a part with a value of its own")
        };
        for (k, (part, from, to)) in parts.iter().enumerate() {
            let ends = [(*from, 1.0), (*to, -1.0)];
            let ends = || ends.into_iter().filter(|(node, _)| *node > 0).map(|(node, sign)| (node - 1, sign));
            match part {
                Part::Resistor(ohms) => {
                    for (i, row) in ends() {
                        for (j, sign) in ends() {
                            m[(i, j)] += row * sign / ohms;
                        }
                    }
                }
                Part::Inductor(..) | Part::Diode => ends().for_each(|(i, sign)| known[(i, column(k))] -= sign),
                Part::Capacitor(..) | Part::Voltage(_) => {
                    let current = nodes + given.iter().position(|&other| other == k)?;
                    for (i, sign) in ends() {
                        m[(i, current)] += sign;
                        m[(current, i)] += sign;
                    }
                    known[(current, column(k))] = 1.0;
                }
            }
        }
        let solved = m.clone().lu().solve(&known)?;
        if !((&m * &solved - &known).amax() < 1e-6 && solved.iter().all(|x| x.is_finite() && x.abs() < 1e12)) {
            return None;
        }
        let voltage = |from: usize, to: usize| -> DVector<f64> {
            let at = |node: usize| -> DVector<f64> {
                if node == 0 { DVector::zeros(columns) } else { solved.row(node - 1).transpose() }
            };
            at(from) - at(to)
        };
        let mut system = Linear { set: vec![(Shape::Nonnegative, diodes.len())], ..Linear::default() };
        let split = |row: DVector<f64>, factor: f64| {
            let row: Vec<f64> = row.iter().map(|x| factor * x).collect();
            let (of_states, rest) = row.split_at(states.len());
            let (of_diodes, of_sources) = rest.split_at(diodes.len());
            let mut signal = Signal::default();
            for (&k, factor) in sources.iter().zip(of_sources) {
                if let Part::Voltage(source) = &parts[k].0 {
                    signal.add(*factor, source);
                }
            }
            (of_states.to_vec(), of_diodes.to_vec(), signal)
        };
        for &k in &states {
            let (part, from, to) = &parts[k];
            let (rate, start) = match part {
                Part::Capacitor(farads, volts) => {
                    let current = nodes + given.iter().position(|&other| other == k)?;
                    (split(solved.row(current).transpose(), 1.0 / farads), volts)
                }
                Part::Inductor(henries, amperes) => (split(voltage(*from, *to), 1.0 / henries), amperes),
                _ => return None,
            };
            system.a.push(rate.0);
            system.b.push(rate.1);
            system.drive.push(rate.2);
            system.initial.push(*start);
        }
        for &k in &diodes {
            let (c, d, gap) = split(voltage(parts[k].1, parts[k].2), -1.0);
            system.c.push(c);
            system.d.push(d);
            system.gap.push(gap);
        }
        // Entries that are rounding errors of the elimination are set to zero, since they would act as small
        // resistances.
        for matrix in [&mut system.a, &mut system.b, &mut system.c, &mut system.d] {
            for row in matrix.iter_mut() {
                let largest = row.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
                row.iter_mut().filter(|x| x.abs() < 1e-13 * largest).for_each(|x| *x = 0.0);
            }
        }
        Some(system)
    }
}
