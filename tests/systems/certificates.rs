//! Necessary conditions of every exact solution of a differential variational inequality, verified on computed
//! solutions: the natural map, complementarity, and the differentiation lemmas `<z', G> = 0` and `<z', G'> <= 0`.

use super::harness::solve;
use super::reference::example;

/// Asserts the necessary conditions for the solution of an example; `size`, its largest `|z|` or `|G|`, scales the
/// tolerance of all of them.
fn assert_certified(name: &str, size: f64) {
    let solution = solve(&example(name));
    let figures = solution.diagnostics.complementarity.expect("figures");
    let tolerance = 1e-10 * size;
    let seen = [
        figures.natural_map,
        -figures.smallest_z,
        -figures.smallest_g,
        figures.largest_product,
        figures.first_lemma,
        figures.second_lemma,
    ];
    assert!(seen.iter().all(|figure| (0.0..=tolerance).contains(figure)), "{name}: {figures:?}");
}

#[test]
fn of_the_diode_bridge() {
    assert_certified("diode_bridge", 10.0);
}

#[test]
fn of_friction_on_a_belt() {
    assert_certified("friction_belt", 1.0);
}

#[test]
fn of_the_sliding_mode() {
    assert_certified("sliding_mode", 1.0);
}

#[test]
fn of_the_reverse_zeno_spiral() {
    assert_certified("reverse_zeno", 1.0);
}

#[test]
fn of_the_bottleneck_with_its_thousands_of_commuters() {
    assert_certified("bottleneck", 1e4 * 1e4);
}
