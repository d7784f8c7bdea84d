//! Radau IIA with `s` stages has the order `2s - 1` in the states `x`: on a smooth ODE and on a smooth problem of
//! index one, for s = 1, .., 5.

use dvi::problem::{Control, ConvexSet, Dvi, Mass, Structure};
use dvi::radau::{Radau, Settings, StageChoice, Switches};
use dvi::vi::SolverKind;
use hybrid::OneStep;

/// A differential variational inequality whose functions and derivatives are closures.
pub struct Problem<F, J> {
    pub structure: Structure,
    pub values: F,
    pub derivatives: J,
}

impl<F, J> Dvi for Problem<F, J>
where
    F: FnMut(f64, &[f64], &mut [f64]) + Send,
    J: FnMut(f64, &[f64], &mut [f64]) + Send,
{
    fn structure(&self) -> &Structure {
        &self.structure
    }

    fn evaluate(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        (self.values)(t, y, values);
    }

    fn jacobian(&mut self, t: f64, y: &[f64], values: &mut [f64]) {
        (self.derivatives)(t, y, values);
    }

    fn time_derivative(&mut self, _: f64, _: &[f64], values: &mut [f64]) {
        values.fill(0.0);
    }
}

pub fn structure(n: usize, set: ConvexSet) -> Structure {
    let unknowns = n + set.dimension();
    Structure {
        states: n,
        variables: set.dimension(),
        mass: Mass::Identity,
        set,
        moving: Vec::new(),
        pattern: (0..unknowns * unknowns).map(|k| (k / unknowns, k % unknowns)).collect(),
        constant_jacobian: false,
    }
}

pub fn settings(stages: usize, step: f64, n: usize) -> Settings {
    Settings {
        stages: StageChoice::Fixed(stages),
        rtol: 1e-14,
        atol: vec![1e-14; n],
        step: Some(step),
        first_step: None,
        max_step: f64::INFINITY,
        min_step: 0.0,
        interpolated: false,
        switches: Switches::Locate,
        vi_solver: SolverKind::Auto,
        vi_tolerance: 1e-12,
    }
}

/// The end time of all runs, so late that even the fine runs have errors above rounding.
const END: f64 = 151.0;
/// Number of steps of the coarsest run of a sequence, for s = 1, .., 5 stages.
const COARSEST: [usize; 5] = [60_000, 3000, 800, 460, 350];

/// Returns the states and variables `y = (x, z)` that Radau IIA reports at `end` after `steps` equal steps.
fn run(problem: &mut dyn Dvi, stages: usize, x: &[f64], end: f64, steps: usize) -> Vec<f64> {
    let control = Control::new();
    let mut radau = Radau::new(problem, settings(stages, end / steps as f64, x.len()), 0.0, x, end, &control).unwrap();
    while !radau.is_done() {
        radau.step().unwrap();
    }
    let mut y = radau.y().to_vec();
    radau.at(end, &mut y);
    y
}

/// The observed order of convergence: from a sequence of runs with ever more steps, it takes the finest run with an
/// error above rounding, and the run two places before it.
fn order(error: impl Fn(usize) -> f64, coarsest: usize) -> f64 {
    let ladder = (0..8).map(|k| (coarsest as f64 * 1.06_f64.powi(k)).round() as usize);
    let runs: Vec<(f64, f64)> = ladder
        .map(|steps| ((steps as f64).ln(), error(steps)))
        .take_while(|&(_, error)| error > 1e-11)
        .map(|(steps, error)| (steps, error.ln()))
        .collect();
    assert!(runs.len() >= 3, "too few runs above rounding: {runs:?}");
    let (fine, coarse) = (runs[runs.len() - 1], runs[runs.len() - 3]);
    println!("{runs:?}");
    (coarse.1 - fine.1) / (fine.0 - coarse.0)
}

#[test]
fn a_smooth_ode_converges_with_order_2s_minus_1() {
    // A smooth ODE: x1' = cos(t) x1 with the solution x1 = exp(sin t), and a second state that depends on x1.
    for s in 1..=5 {
        let order = order(
            |steps| {
                let mut problem = Problem {
                    structure: structure(2, ConvexSet::free(0)),
                    values: |t: f64, y: &[f64], v: &mut [f64]| {
                        v[0] = t.cos() * y[0];
                        v[1] = -t.sin() * y[0] * y[1];
                    },
                    derivatives: |t: f64, y: &[f64], d: &mut [f64]| {
                        d.copy_from_slice(&[t.cos(), 0.0, -t.sin() * y[1], -t.sin() * y[0]]);
                    },
                };
                let y = run(&mut problem, s, &[1.0, 0.0], END, steps);
                (y[0] - END.sin().exp()).abs()
            },
            COARSEST[s - 1],
        );
        let expected = (2 * s - 1) as f64;

        assert!((order - expected).abs() < 0.2, "s = {s}: order {order}");
    }
}

#[test]
fn a_smooth_problem_of_index_one_converges_with_order_2s_minus_1_in_x_and_in_z() {
    // A problem of index one: 0 <= z perp x1 (2 + x2) >= 0 with z > 0 has x1 = 0, x2 = exp(sin t), z = x2 / (1 + x2^2).
    // The stage values of z have the order s only; the reported values of z are computed from x.
    let x = END.sin().exp();
    for s in 1..=5 {
        for (component, exact) in [(1, x), (2, x / (1.0 + x * x))] {
            let error = |steps: usize| {
                let mut problem = Problem {
                    structure: structure(2, ConvexSet::nonnegative(1)),
                    values: |t: f64, y: &[f64], v: &mut [f64]| {
                        v[0] = -y[1] * (1.0 + y[0]) + y[2] * (1.0 + y[1] * y[1]);
                        v[1] = t.cos() * y[1] + y[0];
                        v[2] = y[0] * (2.0 + y[1]);
                    },
                    derivatives: |t: f64, y: &[f64], d: &mut [f64]| {
                        d.copy_from_slice(&[
                            -y[1],
                            -(1.0 + y[0]) + 2.0 * y[1] * y[2],
                            1.0 + y[1] * y[1],
                            1.0,
                            t.cos(),
                            0.0,
                            2.0 + y[1],
                            y[0],
                            0.0,
                        ]);
                    },
                };
                let y = run(&mut problem, s, &[0.0, 1.0], END, steps);
                (y[component] - exact).abs()
            };
            let order = order(error, COARSEST[s - 1]);
            let expected = (2 * s - 1) as f64;
            assert!((order - expected).abs() < 0.2, "s = {s}, component {component}: order {order}");
        }
    }
}
