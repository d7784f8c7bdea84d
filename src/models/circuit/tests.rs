//! Tests on random circuits: eliminated voltages and currents satisfy Kirchhoff's laws and the element laws, and the
//! reduced system is passive.

use super::*;
use expression::Graph;
use nalgebra::DMatrix;
use proptest::prelude::*;

/// Generates random circuits on ground and five further nodes, with a resistor from every node to ground.
fn circuit() -> impl Strategy<Value = Vec<Element>> {
    let element = (0..6_usize, 1..6_usize, 0..5_usize, 1..9_u32).prop_map(|(a, step, kind, size)| {
        let size = f64::from(size);
        let law = match kind {
            0 => Law::Resistor(size),
            1 => Law::Capacitor(size, None),
            2 => Law::Inductor(size, None),
            3 => Law::Diode { forward: size / 10.0 },
            _ => Law::Zener { forward: size / 10.0, breakdown: size },
        };
        Element { nodes: (a, (a + step) % 6), law }
    });
    proptest::collection::vec(element, 1..14).prop_map(|mut elements| {
        elements.extend((1..6).map(|node| Element { nodes: (node, 0), law: Law::Resistor(node as f64) }));
        elements
    })
}

proptest! {
    #[test]
    fn power_is_stored_lost_or_taken_by_diodes(elements in circuit()) {
        let tree = NormalTree::new(&elements, 6).expect("every node has a resistor to ground");
        let columns = Columns::new(&elements, &tree);
        let forms = Equations::new(&elements, &tree, &columns).expect("regular");
        let (n, m) = (columns.states.len(), columns.ports.len());
        // At any states and variables `(x, z)`, the powers of all circuit elements sum to zero (Tellegen), so that
        // `z G` is the sum of stored and dissipated power.
        let q = |k: usize| if k < n + m { ((7 * k + 3) as f64).sin() } else { 1.0 };
        let at = |form: &Form| form.terms().map(|(k, c)| c * q(k)).sum::<f64>();
        let powers: Vec<f64> = forms.voltages.iter().zip(&forms.currents).map(|(v, i)| at(v) * at(i)).collect();
        let size: f64 = powers.iter().map(|power| power.abs()).sum::<f64>() + 1.0;
        prop_assert!(powers.iter().sum::<f64>().abs() < 1e-10 * size);
        for (k, element) in elements.iter().enumerate() {
            let (v, i) = (at(&forms.voltages[k]), at(&forms.currents[k]));
            if let Law::Resistor(ohms) = element.law {
                prop_assert!((v - ohms * i).abs() < 1e-10 * size);
            }
        }
        let d = DMatrix::from_fn(m, m, |i, j| forms.inequality[i].coefficient(n + j));
        if m > 0 {
            let least = (&d + d.transpose()).symmetric_eigenvalues().min();
            prop_assert!(least > -1e-10 * (1.0 + d.amax()), "D has {least:e}");
        }
    }

    #[test]
    fn states_are_as_few_as_the_loops_and_cut_sets_leave(elements in circuit()) {
        // The order of complexity of a circuit (Bryant 1959) is the number of storage elements less the number of
        // capacitor loops less the number of inductor cut sets.
        let tree = NormalTree::new(&elements, 6).expect("every node has a resistor to ground");
        let rank = |kept: fn(&Law) -> bool| {
            let rows: Vec<&Element> = elements.iter().filter(|element| kept(&element.law)).collect();
            let incidence = DMatrix::from_fn(rows.len().max(1), 6, |k, node| {
                let Some(element) = rows.get(k) else { return 0.0 };
                f64::from(u8::from(element.nodes.0 == node)) - f64::from(u8::from(element.nodes.1 == node))
            });
            incidence.rank(1e-9)
        };
        let inductors = elements.iter().filter(|element| matches!(element.law, Law::Inductor(..))).count();
        let without_inductors = rank(|law| !matches!(law, Law::Inductor(..)));
        let order = rank(|law| matches!(law, Law::Capacitor(..))) + inductors - (rank(|_| true) - without_inductors);
        prop_assert_eq!(Columns::new(&elements, &tree).states.len(), order);
    }
}

#[test]
fn a_zener_has_one_variable_in_the_tree_and_two_as_a_link() {
    let zener = Element { nodes: (1, 0), law: Law::Zener { forward: 0.7, breakdown: 5.0 } };
    let resistor = Element { nodes: (1, 0), law: Law::Resistor(10.0) };
    let capacitor = Element { nodes: (1, 0), law: Law::Capacitor(1.0, None) };
    let ports = |elements: &[Element]| {
        let tree = NormalTree::new(elements, 2).expect("a tree");
        let columns = Columns::new(elements, &tree);
        let forms = Equations::new(elements, &tree, &columns).expect("regular");
        let terms = Terms::default();
        let system = System::new(&mut Graph::new(), elements, &columns, &terms, &forms).expect("no sources");
        let (rows, _) = system.rows(&mut Graph::new(), &forms);
        (columns.ports, rows.set.lower, rows.set.upper)
    };
    assert_eq!(ports(&[zener.clone(), resistor]), (vec![Port::Voltage(0)], vec![-5.0], vec![0.7]));
    let two = vec![Port::Conducting(0), Port::BreakingDown(0)];
    assert_eq!(ports(&[zener, capacitor]), (two, vec![0.0; 2], vec![f64::INFINITY; 2]));
}
