//! A run that is reset to a saved point repeats the remaining steps to the last bit: through switches, and with any
//! number of stages. After the reset, factors and derivatives are computed anew that an uninterrupted run would have
//! reused.

use crate::systems::reference::example;
use dvi::problem::Control;
use dvi::radau::Radau;
use dvi::specification::Specification;
use hybrid::OneStep;

/// Makes all remaining steps of a run, and returns the time and the unknowns at the end of each step.
fn steps(radau: &mut Radau<'_>) -> Vec<(f64, Vec<f64>)> {
    let mut steps = Vec::new();
    while !radau.is_done() {
        radau.step().expect("a step");
        steps.push((radau.t(), radau.y().to_vec()));
    }
    steps
}

#[test]
fn a_restored_run_makes_the_same_steps_to_the_last_bit() {
    for name in ["friction_belt", "diode_bridge", "sliding_mode", "van_der_pol", "pendulum"] {
        let specification = Specification::from_json(example(name).to_string().as_bytes()).expect("a specification");
        let (model, time, control) =
            (specification.model().dvi().expect("a problem"), specification.time(), Control::new());
        let mut problem = model.problem();
        let settings = specification.settings();
        let mut radau =
            Radau::new(&mut *problem, settings, time.start, &model.initial, time.end, &control).expect("a start");
        for _ in 0..4 {
            radau.step().expect("a step");
        }
        let saved = radau.save();
        let first = steps(&mut radau);
        radau.restore(&saved);
        let again = steps(&mut radau);
        assert!(first.len() > 4 && first == again, "{name}: {} and {} steps", first.len(), again.len());
    }
}
