//! Time to compile and to evaluate right-hand sides with their sparse Jacobians: Van der Pol (n = 2), POLLU (n = 20;
//! Verwer 1994) and chains of reaction and diffusion.

use divan::{AllocProfiler, Bencher, black_box};
use expression::{Graph, Node, Scope, Tape};

/// A right-hand side in the states `y1, .., yn`, as text.
struct System {
    parameters: Vec<(&'static str, f64)>,
    rates: Vec<String>,
}

impl System {
    fn new(parameters: &[(&'static str, f64)], rates: &[&str]) -> Self {
        Self { parameters: parameters.to_vec(), rates: rates.iter().map(|rate| (*rate).to_owned()).collect() }
    }

    fn van_der_pol() -> Self {
        Self::new(&[("eps", 1e-6)], &["y2", "((1 - y1**2)*y2 - y1)/eps"])
    }

    fn pollu() -> Self {
        Self::new(&POLLU_PARAMETERS, &POLLU)
    }

    /// Returns the chain `y_i' = 100 (y_{i-1} - 2 y_i + y_{i+1}) + reaction(y_i)`, where `%` in `reaction` stands for
    /// `y_i`.
    fn chain(n: usize, reaction: &str) -> Self {
        let neighbour = |i: usize| if (1..=n).contains(&i) { format!("y{i}") } else { "0".to_owned() };
        let rate = |i: usize| {
            let diffusion = format!("100*({} - 2*y{i} + {})", neighbour(i - 1), neighbour(i + 1));
            format!("{diffusion} + {}", reaction.replace('%', &format!("y{i}")))
        };
        Self { parameters: Vec::new(), rates: (1..=n).map(rate).collect() }
    }

    /// Returns the expression graph of the rates, followed by their derivatives row by row if `with_jacobian`.
    fn outputs(&self, with_jacobian: bool) -> (Graph, Vec<Node>) {
        let (mut graph, mut scope) = (Graph::new(), Scope::new());
        for &(name, value) in &self.parameters {
            scope.bind(name, graph.constant(value)).expect("a free name");
        }
        for i in 1..=self.rates.len() {
            scope.bind(&format!("y{i}"), graph.input(i)).expect("a free name");
        }
        scope.bind("t", graph.input(0)).expect("a free name");
        let mut outputs: Vec<Node> =
            self.rates.iter().map(|rate| graph.parse(rate, &scope).expect("an expression")).collect();
        if with_jacobian {
            for row in 0..self.rates.len() {
                outputs.extend(graph.gradient(outputs[row]).expect("a small graph").into_iter().map(|(_, node)| node));
            }
        }
        (graph, outputs)
    }

    fn compiled(&self, with_jacobian: bool) -> (Tape, usize) {
        let (graph, outputs) = self.outputs(with_jacobian);
        (Tape::compile(&graph, &outputs), outputs.len())
    }

    fn evaluate(&self, bencher: Bencher, with_jacobian: bool) {
        let (mut tape, outputs) = self.compiled(with_jacobian);
        let inputs: Vec<f64> = (0..=self.rates.len()).map(|i| 0.5 + 1e-3 * i as f64).collect();
        let mut outputs = vec![0.0; outputs];
        bencher.bench_local(|| tape.evaluate(inputs[0], black_box(&inputs[1..]), black_box(&mut outputs)));
    }
}

/// A right-hand side, as text, with its name.
type Named = (&'static str, fn() -> System);

/// Right-hand sides for the benchmark in which all stages of a step are evaluated.
const PROGRAMS: [Named; 7] = [
    ("van der Pol", System::van_der_pol),
    ("friction belt", || System::new(&[("c", 0.1)], &["y2", "-c*y2 - y1 - y3", "-(y2 - 0.5)"])),
    ("pendulum", || System::new(&[], &["y3", "y4", "-y1*y5", "-y2*y5 - 9.81", "y1*y3 + y2*y4"])),
    ("forced circle", || System::new(&[], &["y2 + sin(3*t)", "-y1 + 0.5*cos(t)*y2 - max(y1, 0)"])),
    ("POLLU", System::pollu),
    ("chain of 20", || System::chain(20, "%*(1 - %^2)")),
    ("chain of 1000", || System::chain(1000, "%*(1 - %^2)")),
];

/// Returns the names of all benchmarks: all combinations of a right-hand side and a number of stages.
fn at_stages() -> impl Iterator<Item = String> {
    let programs = PROGRAMS.iter();
    programs.flat_map(|(name, _)| [3, 5, 7].map(|stages| format!("{name}, {stages} stages")))
}

/// Evaluates the rates of a right-hand side at all stages, in one batch or one stage after the other.
fn evaluate_at_stages(bencher: Bencher, case: &str, side_by_side: bool) {
    let (name, stages) = case.rsplit_once(", ").expect("a program and stages");
    let stages: usize = stages[..1].parse().expect("a number of stages");
    let (_, system) = PROGRAMS.iter().find(|program| program.0 == name).expect("a program");
    let (mut tape, width) = system().compiled(false);
    let unknowns = width.max(5);
    let times: Vec<f64> = (0..stages).map(|i| 0.1 * i as f64).collect();
    let inputs: Vec<f64> = (0..stages * unknowns).map(|i| 0.5 + 1e-3 * i as f64).collect();
    let mut outputs = vec![0.0; stages * width];
    if side_by_side {
        bencher.bench_local(|| tape.evaluate_points(&times, black_box(&inputs), black_box(&mut outputs)));
    } else {
        bencher.bench_local(|| {
            let points = times.iter().zip(black_box(&inputs).chunks_exact(unknowns));
            for ((&t, inputs), outputs) in points.zip(black_box(&mut outputs).chunks_exact_mut(width)) {
                tape.evaluate(t, inputs, outputs);
            }
        });
    }
}

/// Counts allocations in addition to times: an evaluation must not allocate.
#[global_allocator]
static ALLOCATIONS: AllocProfiler = AllocProfiler::system();

fn main() {
    divan::main();
}

#[divan::bench(args = at_stages())]
fn stages_one_after_the_other(bencher: Bencher, case: &str) {
    evaluate_at_stages(bencher, case, false);
}

#[divan::bench(args = at_stages())]
fn stages_side_by_side(bencher: Bencher, case: &str) {
    evaluate_at_stages(bencher, case, true);
}

#[divan::bench]
fn van_der_pol_rates(bencher: Bencher) {
    System::van_der_pol().evaluate(bencher, false);
}

#[divan::bench]
fn van_der_pol_rates_and_jacobian(bencher: Bencher) {
    System::van_der_pol().evaluate(bencher, true);
}

#[divan::bench]
fn pollu_rates(bencher: Bencher) {
    System::pollu().evaluate(bencher, false);
}

#[divan::bench]
fn pollu_rates_and_jacobian(bencher: Bencher) {
    System::pollu().evaluate(bencher, true);
}

#[divan::bench]
fn pollu_compile(bencher: Bencher) {
    let system = System::pollu();
    bencher.bench_local(|| black_box(system.compiled(true)));
}

#[divan::bench(args = [100, 1_000, 10_000])]
fn chain_rates_and_jacobian(bencher: Bencher, n: usize) {
    System::chain(n, "%*(1 - %^2)").evaluate(bencher, true);
}

#[divan::bench(args = [100, 1_000, 10_000])]
fn chain_of_exponentials_rates_and_jacobian(bencher: Bencher, n: usize) {
    System::chain(n, "exp(-%) + sin(%)").evaluate(bencher, true);
}

#[divan::bench(args = [100, 10_000])]
fn chain_compile(bencher: Bencher, n: usize) {
    let system = System::chain(n, "%*(1 - %^2)");
    bencher.bench_local(|| black_box(system.compiled(true)));
}

const POLLU_PARAMETERS: [(&str, f64); 25] = [
    ("k1", 0.35),
    ("k2", 26.6),
    ("k3", 12300.0),
    ("k4", 0.00086),
    ("k5", 0.00082),
    ("k6", 15000.0),
    ("k7", 0.00013),
    ("k8", 24000.0),
    ("k9", 16500.0),
    ("k10", 9000.0),
    ("k11", 0.022),
    ("k12", 12000.0),
    ("k13", 1.88),
    ("k14", 16300.0),
    ("k15", 4800000.0),
    ("k16", 0.00035),
    ("k17", 0.0175),
    ("k18", 100000000.0),
    ("k19", 444000000000.0),
    ("k20", 1240.0),
    ("k21", 2.1),
    ("k22", 5.78),
    ("k23", 0.0474),
    ("k24", 1780.0),
    ("k25", 3.12),
];

const POLLU: [&str; 20] = [
    "- k1*y1 - k10*y11*y1 - k14*y1*y6 - k23*y1*y4 - k24*y19*y1 + k2*y2*y4 + k3*y5*y2 + k9*y11*y2 + k11*y13 + k12*y10*y2 + k22*y19 + k25*y20",
    "- k2*y2*y4 - k3*y5*y2 - k9*y11*y2 - k12*y10*y2 + k1*y1 + k21*y19",
    "- k15*y3 + k1*y1 + k17*y4 + k19*y16 + k22*y19",
    "- k2*y2*y4 - k16*y4 - k17*y4 - k23*y1*y4 + k15*y3",
    "- k3*y5*y2 + k4*y7 + k4*y7 + k6*y7*y6 + k7*y9 + k13*y14 + k20*y17*y6",
    "- k6*y7*y6 - k8*y9*y6 - k14*y1*y6 - k20*y17*y6 + k3*y5*y2 + k18*y16 + k18*y16",
    "- k4*y7 - k5*y7 - k6*y7*y6 + k13*y14",
    "+ k4*y7 + k5*y7 + k6*y7*y6 + k7*y9",
    "- k7*y9 - k8*y9*y6",
    "- k12*y10*y2 + k7*y9 + k9*y11*y2",
    "- k9*y11*y2 - k10*y11*y1 + k8*y9*y6 + k11*y13",
    "+ k9*y11*y2",
    "- k11*y13 + k10*y11*y1",
    "- k13*y14 + k12*y10*y2",
    "+ k14*y1*y6",
    "- k18*y16 - k19*y16 + k16*y4",
    "- k20*y17*y6",
    "+ k20*y17*y6",
    "- k21*y19 - k22*y19 - k24*y19*y1 + k23*y1*y4 + k25*y20",
    "- k25*y20 + k24*y19*y1",
];
