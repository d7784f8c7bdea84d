//! The example specifications published for clients.

use dvi::specification::Specification;
use std::fs;

#[test]
fn every_example_passes_every_check_and_has_a_title() {
    let mut count = 0;
    for entry in fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples")).unwrap() {
        let path = entry.unwrap().path();
        let specification = Specification::from_json(&fs::read(&path).unwrap())
            .unwrap_or_else(|errors| panic!("{path:?}: {errors:#?}"));
        assert!(specification.label().is_some_and(|label| !label.is_empty()), "{path:?} has no label");
        assert!(specification.model().warnings().is_empty(), "{path:?}: {:?}", specification.model().warnings());
        count += 1;
    }
    assert_eq!(count, 57);
}

/// The diode bridge is given as two examples, by matrices and by expressions: the values of the equations of both agree
/// at a point without zero components.
#[test]
fn the_two_forms_of_the_diode_bridge_are_one_problem() {
    let read = |name: &str| {
        let path = format!("{}/api/examples/{name}.json", env!("CARGO_MANIFEST_DIR"));
        Specification::from_json(&fs::read(path).unwrap()).unwrap()
    };
    let (matrices, expressions) = (read("diode_bridge"), read("diode_bridge_dvi"));
    let (mut matrices, mut expressions) =
        (matrices.model().dvi().unwrap().problem(), expressions.model().dvi().unwrap().problem());
    let y = [0.7, -0.002, 1.5, 0.4, 0.003, 0.0011];
    let (mut a, mut b) = ([0.0; 6], [0.0; 6]);
    matrices.evaluate(0.1, &y, &mut a);
    expressions.evaluate(0.1, &y, &mut b);
    for (a, b) in a.iter().zip(&b) {
        assert!((a - b).abs() <= 1e-12 * a.abs().max(1.0), "{a} {b}");
    }
    assert_eq!(matrices.structure().pattern, expressions.structure().pattern);
    assert!(matrices.structure().constant_jacobian && expressions.structure().constant_jacobian);
    let nonzeros = matrices.structure().pattern.len();
    let (mut a, mut b) = (vec![0.0; nonzeros], vec![0.0; nonzeros]);
    matrices.jacobian(0.0, &y, &mut a);
    expressions.jacobian(0.0, &y, &mut b);
    for (a, b) in a.iter().zip(&b) {
        assert!((a - b).abs() <= 1e-12 * a.abs(), "{a} {b}");
    }
}
