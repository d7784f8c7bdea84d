//! The normal tree of a circuit: a spanning tree with as many voltage sources, then capacitors, switches and diodes
//! as possible, and with as few inductors and current sources as possible.
//!
//! Every element outside the tree, a link `l`, closes one loop with the tree, and Kirchhoff's laws for tree elements
//! `t` are
//!
//! ```text
//! v_l = sum_t F_lt v_t,    i_t = -sum_l F_lt i_l
//! ```

use super::{Element, Fault, Law};

/// Maximum number of nonzeros of the fundamental loop matrix `F` of a circuit.
const MOST_ENTRIES: usize = 2_000_000;

/// A normal tree of a circuit, with its fundamental loops and cut sets.
#[derive(Clone, Debug)]
pub struct NormalTree {
    /// For each circuit element, whether it is in the normal tree.
    pub contains: Vec<bool>,
    /// The rows of the fundamental loop matrix `F`: for each link, the tree elements `(t, F_lt)` of its loop; empty for
    /// tree elements.
    pub loops: Vec<Vec<(usize, f64)>>,
    /// The columns of the fundamental loop matrix `F`: for each tree element, the links `(l, F_lt)` of its cut set;
    /// empty for links.
    pub cuts: Vec<Vec<(usize, f64)>>,
    /// For each circuit node, the tree element towards ground, with the sign of the element's voltage in the node
    /// voltage.
    parents: Vec<Option<Step>>,
}

#[derive(Clone, Copy, Debug)]
struct Step {
    element: usize,
    sign: f64,
    to: usize,
    depth: usize,
}

impl NormalTree {
    /// Builds a normal tree of the elements over nodes `0..nodes`.
    ///
    /// # Errors
    /// Nodes without a path to ground, loops of voltage sources or switches, and cut sets of current
    /// sources.
    pub fn new(elements: &[Element], nodes: usize) -> Result<Self, Vec<Fault>> {
        let contains = spanning_tree(elements, nodes);
        let parents = parents(elements, &contains, nodes);
        let floating: Vec<usize> = (1..nodes).filter(|&node| parents[node].is_none()).collect();
        if !floating.is_empty() {
            return Err(vec![Fault::Floating(floating)]);
        }
        let mut tree =
            Self { contains, loops: vec![Vec::new(); elements.len()], cuts: vec![Vec::new(); elements.len()], parents };
        let mut entries = 0;
        for (l, element) in elements.iter().enumerate().filter(|&(l, _)| !tree.contains[l]).collect::<Vec<_>>() {
            let path = tree.between(element.nodes);
            entries += path.len();
            if entries > MOST_ENTRIES {
                return Err(vec![Fault::TooIntertwined(MOST_ENTRIES)]);
            }
            path.iter().for_each(|&(t, sign)| tree.cuts[t].push((l, sign)));
            tree.loops[l] = path;
        }
        let faults: Vec<Fault> = (0..elements.len()).filter_map(|k| tree.fault(elements, k)).collect();
        if faults.is_empty() { Ok(tree) } else { Err(faults) }
    }

    /// Returns the number of nodes of the circuit.
    pub fn nodes(&self) -> usize {
        self.parents.len()
    }

    /// Returns all circuit nodes except ground as `(node, t, sign, parent)`, parents first: the voltage of `node` is
    /// that of `parent` plus `sign v_t`, with the tree element `t` between them.
    pub fn outwards(&self) -> impl Iterator<Item = (usize, usize, f64, usize)> {
        let mut steps: Vec<(usize, Step)> =
            self.parents.iter().enumerate().filter_map(|(node, step)| Some((node, (*step)?))).collect();
        steps.sort_by_key(|(_, step)| step.depth);
        steps.into_iter().map(|(node, step)| (node, step.element, step.sign, step.to))
    }

    /// Returns the island of each node: a component of the tree without its resistors, inductors and current sources.
    /// An island is identified by the resistor that connects it towards ground; `None` is the first island of a group
    /// connected by resistors.
    pub fn islands(&self, elements: &[Element]) -> Vec<Option<usize>> {
        let mut islands = vec![None; self.nodes()];
        for (node, element, _, to) in self.outwards() {
            islands[node] = match elements[element].law {
                Law::Resistor(_) => Some(element),
                Law::Inductor(..) | Law::CurrentSource(_) | Law::DependentCurrent => None,
                _ => islands[to],
            };
        }
        islands
    }

    /// Returns the voltage between two circuit nodes as a signed sum over tree elements `(t, sign)`.
    fn between(&self, (mut a, mut b): (usize, usize)) -> Vec<(usize, f64)> {
        let depth = |node: usize| self.parents[node].map_or(0, |step| step.depth);
        let mut path = Vec::new();
        while a != b {
            let (from, sign) = if depth(a) >= depth(b) { (&mut a, 1.0) } else { (&mut b, -1.0) };
            let Some(step) = self.parents[*from] else { break };
            path.push((step.element, sign * step.sign));
            *from = step.to;
        }
        path
    }

    fn fault(&self, elements: &[Element], k: usize) -> Option<Fault> {
        let with = |others: &[(usize, f64)]| {
            let mut all: Vec<usize> = others.iter().map(|&(other, _)| other).chain([k]).collect();
            all.sort_unstable();
            all
        };
        match (&elements[k].law, self.contains[k]) {
            (Law::VoltageSource(_) | Law::DependentVoltage, false) => Some(Fault::SourceLoop(with(&self.loops[k]))),
            (Law::Switch { .. } | Law::DependentSwitch, false) => Some(Fault::SwitchLoop(with(&self.loops[k]))),
            (Law::CurrentSource(_) | Law::DependentCurrent, true) => Some(Fault::SourceCutSet(with(&self.cuts[k]))),
            _ => None,
        }
    }
}

/// Kruskal's algorithm (1956): adds circuit elements to the spanning tree in the order of their rank unless they close
/// a loop.
fn spanning_tree(elements: &[Element], nodes: usize) -> Vec<bool> {
    fn root(leader: &mut [usize], mut node: usize) -> usize {
        while leader[node] != node {
            leader[node] = leader[leader[node]];
            node = leader[node];
        }
        node
    }
    let mut order: Vec<usize> = (0..elements.len()).collect();
    // Elements at ground come first among elements of equal rank, so that fundamental loops are shorter.
    order.sort_by_key(|&k| (elements[k].law.rank(), elements[k].nodes.0 != 0 && elements[k].nodes.1 != 0));
    let mut leader: Vec<usize> = (0..nodes).collect();
    let mut contains = vec![false; elements.len()];
    for k in order {
        let (a, b) = elements[k].nodes;
        let (a, b) = (root(&mut leader, a), root(&mut leader, b));
        contains[k] = a != b;
        leader[a] = b;
    }
    contains
}

/// Returns, for each circuit node, the tree element towards ground, by breadth-first search.
fn parents(elements: &[Element], contains: &[bool], nodes: usize) -> Vec<Option<Step>> {
    let mut branches = vec![Vec::new(); nodes];
    for (element, &Element { nodes: (a, b), .. }) in elements.iter().enumerate().filter(|&(k, _)| contains[k]) {
        // Store each branch of the tree at both of its nodes; ground, where the breadth-first search below starts, gets
        // no parent.
        branches[a].push((b, Step { element, sign: -1.0, to: a, depth: 0 }));
        branches[b].push((a, Step { element, sign: 1.0, to: b, depth: 0 }));
    }
    let mut parents: Vec<Option<Step>> = vec![None; nodes];
    let mut open = vec![0];
    let mut depth = 0;
    while !open.is_empty() {
        depth += 1;
        let mut next = Vec::new();
        for at in open {
            for &(node, step) in &branches[at] {
                if node != 0 && parents[node].is_none() {
                    parents[node] = Some(Step { depth, ..step });
                    next.push(node);
                }
            }
        }
        open = next;
    }
    parents
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resistor(a: usize, b: usize) -> Element {
        Element { nodes: (a, b), law: Law::Resistor(1.0) }
    }

    #[test]
    fn a_loop_is_written_in_the_directions_of_its_elements() {
        let diode = |a, b| Element { nodes: (a, b), law: Law::Diode { forward: 0.0 } };
        // Diodes from node 1 to nodes 0 and 2 are the tree; the resistor from node 2 to node 0 is a link with
        // `v = -v(1 -> 2) + v(1 -> 0)`.
        let tree = NormalTree::new(&[diode(1, 0), diode(1, 2), resistor(2, 0)], 3).expect("a tree");
        let mut path = tree.loops[2].clone();
        path.sort_by_key(|&(t, _)| t);
        assert_eq!((tree.contains, path), (vec![true, true, false], vec![(0, 1.0), (1, -1.0)]));
        assert_eq!((&tree.cuts[0], &tree.cuts[1]), (&vec![(2, 1.0)], &vec![(2, -1.0)]));
    }

    #[test]
    fn nodes_without_a_way_to_ground_are_told() {
        let faults = NormalTree::new(&[resistor(0, 1), resistor(2, 3)], 4).expect_err("a floating part");
        assert_eq!(faults, [Fault::Floating(vec![2, 3])]);
    }
}
