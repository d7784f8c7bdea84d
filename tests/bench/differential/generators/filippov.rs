//! Random discontinuous systems: relays that feed back one or two linear functions of the states, directly or through
//! two integrations, and pairs of linear vector fields on the two sides of a surface.

use super::{LinearProblem, dissipative, faster};
use crate::differential::linear::{Linear, Shape, transposed, zeros};
use crate::differential::problem::{Field, Problem, View, Way};
use crate::differential::random::Random;
use crate::differential::reference::Values;
use crate::differential::signal::Signal;
use serde_json::{Map, Value, json};
use std::f64::consts::TAU;

pub fn generate(random: &mut Random) -> Box<dyn Problem> {
    match random.whole(0, 9) {
        0..=5 => {
            let relay = relay(random);
            if relay.system.variables() == 1 && random.chance(0.6) {
                return Box::new(Relay(relay));
            }
            Box::new(relay)
        }
        6..=7 => Box::new(Relay(late_relay(random))),
        _ => Box::new(two_fields(random)),
    }
}

/// Returns a random relay system `x' = A x + B u + a(t)`, `u in -Sgn(C x + g)` with `C B` symmetric and positive
/// definite.
fn relay(random: &mut Random) -> LinearProblem {
    let (n, m) = (random.whole(1, 4), random.whole(1, 2));
    let n = n.max(m);
    let omega = random.scale(0.3, 5.0);
    let b = random.matrix(n, m);
    let size = random.scale(0.3, 3.0);
    let system = Linear {
        initial: random.vector(n).iter().map(|x| 2.0 * x).collect(),
        a: dissipative(random, n, 30.0),
        c: transposed(&b),
        b,
        d: zeros(m, m),
        drive: (0..n).map(|_| Signal::random(random, 1.0, omega, 2)).collect(),
        gap: (0..m).map(|_| Signal::random(random, 0.3, omega, 1)).collect(),
        set: vec![(Shape::Box(-size, size), m)],
    };
    let energy = Some(vec![1.0; n]);
    scaled(random, system, omega, energy)
}

/// Returns a random system `x'' = -k x - c x' - u + a(t)`, `u in Sgn x`, in which the relay acts through two
/// integrations.
fn late_relay(random: &mut Random) -> LinearProblem {
    let omega = random.scale(0.3, 5.0);
    let (stiffness, damping) = (random.uniform(0.0, 2.0), random.uniform(0.0, 0.3));
    let system = Linear {
        initial: vec![random.uniform(0.5, 2.0), random.uniform(-1.0, 1.0)],
        a: vec![vec![0.0, 1.0], vec![-stiffness, -damping]],
        b: vec![vec![0.0], vec![1.0]],
        c: vec![vec![1.0, 0.0]],
        d: zeros(1, 1),
        drive: vec![Signal::default(), Signal::random(random, 0.7, omega, 1)],
        gap: vec![Signal::default()],
        set: vec![(Shape::Box(-1.0, 1.0), 1)],
    };
    scaled(random, system, omega, None)
}

fn scaled(random: &mut Random, system: Linear, omega: f64, energy: Option<Vec<f64>>) -> LinearProblem {
    let speed = random.scale(1e-3, 1e3);
    let end = random.scale(3.0, 30.0) / (omega * speed) * TAU / 2.0;
    LinearProblem { system: faster(system, speed), end, is_unique: true, as_matrices: random.chance(0.5), energy }
}

/// A system with one relay, written as a vector field on each side of its switching surface.
struct Relay(LinearProblem);

impl Problem for Relay {
    fn document(&self, view: &View) -> Value {
        let system = &self.0.system;
        let (lower, upper) = match system.set[0].0 {
            Shape::Box(lower, upper) => (lower, upper),
            _ => (0.0, 0.0),
        };
        let field = |u: f64| -> Vec<(Vec<f64>, Signal)> {
            (0..system.states())
                .map(|i| {
                    let mut drive = system.drive[i].clone();
                    drive.constant += system.b[i][0] * u;
                    (system.a[i].clone(), drive)
                })
                .collect()
        };
        let surface = (system.c[0].clone(), system.gap[0].clone());
        filippov(&system.initial, &[field(lower), field(upper)], &surface, view)
    }

    fn fields(&self) -> Vec<Field> {
        self.0.fields()
    }

    fn end(&self) -> f64 {
        self.0.end
    }

    fn way(&self) -> Way {
        Way::Stages
    }

    fn smallest(&self) -> f64 {
        self.0.smallest()
    }

    fn is_unique(&self) -> bool {
        true
    }

    fn most_growth(&self, sizes: &[f64]) -> f64 {
        self.0.most_growth(sizes)
    }

    fn reference(&self, change: &[f64], times: &[f64]) -> Option<Values> {
        self.0.reference(change, times)
    }
}

/// Rows of a linear function of the states, each with its forcing term.
type Rows = Vec<(Vec<f64>, Signal)>;

/// Linear vector fields on the two sides of a switching surface.
struct TwoFields {
    initial: Vec<f64>,
    fields: [Rows; 2],
    surface: (Vec<f64>, Signal),
    end: f64,
}

fn two_fields(random: &mut Random) -> TwoFields {
    let n = random.whole(2, 3);
    let omega = random.scale(0.5, 3.0);
    let normal = random.vector(n);
    let mut side = |towards: f64| -> Rows {
        let a = dissipative(random, n, 10.0);
        // A constant forcing makes most vector fields point towards the switching surface.
        (0..n)
            .map(|i| {
                let mut drive = Signal::random(random, 0.5, omega, 1);
                drive.constant += towards * normal[i] * 1.5;
                (a[i].clone(), drive)
            })
            .collect()
    };
    let fields = [side(-1.0), side(1.0)];
    let surface = (normal, Signal::random(random, 0.3, omega, 1));
    let initial = random.vector(n);
    TwoFields { initial, fields, surface, end: random.scale(3.0, 20.0) / omega * TAU / 2.0 }
}

impl Problem for TwoFields {
    fn document(&self, view: &View) -> Value {
        filippov(&self.initial, &self.fields, &self.surface, view)
    }

    fn fields(&self) -> Vec<Field> {
        (1..=self.initial.len()).map(|i| Field::sized(format!("x{i}"))).collect()
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn way(&self) -> Way {
        Way::Stages
    }

    fn smallest(&self) -> f64 {
        0.1
    }

    /// Uniqueness is decided by the certificates of the runs: solutions branch where both vector fields are tangent
    /// to the surface and it becomes repulsive.
    fn is_unique(&self) -> bool {
        false
    }
}

/// Returns a `filippov` problem with two vector fields, of which the first is that of the positive side.
fn filippov(initial: &[f64], fields: &[Rows; 2], surface: &(Vec<f64>, Signal), view: &View) -> Value {
    let linear = |(row, signal): &(Vec<f64>, Signal), of_states: f64, of_signal: f64| {
        let terms = row.iter().enumerate().filter(|(_, x)| **x != 0.0);
        let terms = terms.map(|(j, x)| format!(" + ({:?})*x{}", of_states * x, j + 1));
        signal.expression(of_signal, view.time) + &terms.collect::<String>()
    };
    let states: Map<String, Value> = (0..initial.len())
        .map(|i| {
            let [plus, minus] = [0, 1].map(|k| linear(&fields[k][i], view.time, view.time / view.size));
            let start = (initial[i] + view.change(i)) / view.size;
            (format!("x{}", i + 1), json!({"initial": start, "plus": plus, "minus": minus}))
        })
        .collect();
    json!({"filippov": {"states": states, "surface": linear(surface, view.size, 1.0)}})
}
