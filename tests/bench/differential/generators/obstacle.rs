//! Random parabolic obstacle problems on an interval: driven by time-dependent sources, with one obstacle or two.

use crate::differential::problem::{Field, Problem, View, Way};
use crate::differential::random::Random;
use crate::differential::reference::{Membrane, Values};
use crate::differential::signal::Signal;
use serde_json::{Map, Value, json};

pub struct Obstacle {
    elements: usize,
    diffusion: f64,
    advection: f64,
    reaction: f64,
    source: Signal,
    /// Amplitude of the variation of the source along the interval, relative to its mean.
    bulge: f64,
    lower: f64,
    upper: Option<f64>,
    initial: f64,
    /// Whether the membrane is fixed at zero on the left and on the right.
    held: [bool; 2],
    end: f64,
}

pub fn generate(random: &mut Random) -> Obstacle {
    let omega = random.scale(0.3, 10.0);
    let lower = random.uniform(-1.0, -0.05);
    let upper = random.chance(0.4).then(|| random.uniform(0.05, 1.0));
    Obstacle {
        elements: random.whole(8, 40),
        diffusion: random.scale(1e-3, 1.0),
        advection: if random.chance(0.3) { random.uniform(-0.5, 0.5) } else { 0.0 },
        reaction: if random.chance(0.3) { random.scale(0.01, 1.0) } else { 0.0 },
        source: Signal::random(random, 3.0, omega, 2),
        bulge: random.uniform(-1.0, 1.0),
        lower,
        upper,
        initial: random.uniform(0.0, upper.unwrap_or(1.0)),
        held: [random.chance(0.6), random.chance(0.3)],
        end: random.scale(2.0, 40.0) / omega,
    }
}

impl Problem for Obstacle {
    /// Writes the problem in the units of `view`; the unit of length along the interval stays the same.
    fn document(&self, view: &View) -> Value {
        let (time, size) = (view.time, view.size);
        let mut problem = json!({
            "domain": {"x": [0, 1]},
            "elements": self.elements,
            "diffusion": self.diffusion * time,
            "source": format!("({})*(1 + ({:?})*cos(pi*x))", self.source.expression(time / size, time), self.bulge),
            "obstacle": self.lower / size,
            "initial": format!("({:?})*sin(pi*x)", (self.initial + view.change(0)) / size),
            "probes": {"a": [0.5], "b": [0.25], "c": [0.875]},
        });
        let keys = problem.as_object_mut().expect("an object");
        let sides = ["x_min", "x_max"].into_iter().zip(self.held).filter(|(_, held)| *held);
        let boundary: Map<String, Value> = sides.map(|(side, _)| (side.to_owned(), json!({"dirichlet": 0}))).collect();
        keys.insert("boundary".to_owned(), boundary.into());
        if self.advection != 0.0 {
            keys.insert("advection".to_owned(), json!(self.advection * time));
        }
        if self.reaction != 0.0 {
            keys.insert("reaction".to_owned(), json!(self.reaction * time));
        }
        if let Some(upper) = self.upper {
            keys.insert("upper_obstacle".to_owned(), json!(upper / size));
        }
        json!({"obstacle": problem})
    }

    fn fields(&self) -> Vec<Field> {
        ["a", "b", "c", "total"].map(Field::sized).into()
    }

    fn starts(&self) -> usize {
        1
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn way(&self) -> Way {
        Way::Tolerance
    }

    fn smallest(&self) -> f64 {
        0.1
    }

    /// Bounds the growth of perturbations: by the maximum principle, the largest difference of two solutions does not
    /// grow.
    fn most_growth(&self, sizes: &[f64]) -> f64 {
        sizes[0] / sizes.iter().fold(f64::INFINITY, |least, size| least.min(*size))
    }

    fn is_unique(&self) -> bool {
        true
    }

    /// Solves problems without advection only, since advection can be discretised in many ways.
    fn reference(&self, change: &[f64], times: &[f64]) -> Option<Values> {
        let membrane = (self.advection == 0.0).then(|| Membrane {
            elements: self.elements,
            diffusion: self.diffusion,
            reaction: self.reaction,
            source: self.source.clone(),
            bulge: self.bulge,
            bounds: (self.lower, self.upper.unwrap_or(f64::INFINITY)),
            initial: self.initial + change.first().copied().unwrap_or(0.0),
            held: self.held,
        });
        membrane?.solve(&[0.5, 0.25, 0.875], times)
    }
}
