//! Random problems with memory: fractional kernels of order at most one and exponential kernels, over boxes and
//! orthants.

use crate::differential::problem::{Field, Problem, View, Way};
use crate::differential::random::Random;
use crate::differential::signal::Signal;
use serde_json::{Value, json};

pub struct Memory {
    /// A fractional kernel with its exponent, or an exponential kernel with its rate.
    kernel: Kernel,
    q: Vec<Signal>,
    /// Symmetric positive definite matrix by which the kernel couples the variables.
    matrix: Vec<Vec<f64>>,
    bounds: Option<(f64, f64)>,
    end: f64,
}

enum Kernel {
    Fractional(f64),
    Exponential(f64),
}

pub fn generate(random: &mut Random) -> Memory {
    let m = random.whole(1, 2);
    let omega = random.scale(0.5, 3.0);
    let kernel = if random.chance(0.6) {
        Kernel::Fractional(*random.choose(&[0.3, 0.5, 0.7, 0.9, 1.0]))
    } else {
        Kernel::Exponential(random.scale(0.1, 10.0))
    };
    let mut q: Vec<Signal> = (0..m).map(|_| Signal::random(random, 1.0, omega, 2)).collect();
    // At the start the convolution is zero: unless `q` is in the dual cone there, the solution begins with an
    // impulse.
    for q in &mut q {
        q.constant += random.uniform(0.05, 0.5) - q.at(0.0);
    }
    let coupling = if m == 1 { 0.0 } else { random.uniform(-0.5, 0.5) };
    let matrix = (0..m).map(|i| (0..m).map(|j| if i == j { 1.0 } else { coupling }).collect()).collect();
    let bounds = random.chance(0.5).then(|| (0.0, random.scale(0.3, 3.0)));
    Memory { kernel, q, matrix, bounds, end: random.scale(2.0, 8.0) / omega }
}

impl Problem for Memory {
    fn document(&self, view: &View) -> Value {
        let m = self.q.len();
        let name = |i: usize| format!("z{}", i + 1);
        let variables: serde_json::Map<String, Value> =
            (0..m).map(|i| (name(i), json!({"q": self.q[i].expression(1.0, view.time)}))).collect();
        let names: Vec<String> = (0..m).map(name).collect();
        let set = match self.bounds {
            Some((lower, upper)) => {
                json!({"box": {"of": names, "lower": lower / view.size, "upper": upper / view.size}})
            }
            None => json!({"nonnegative": names}),
        };
        let scaled = |factor: f64| -> Vec<Vec<f64>> {
            self.matrix.iter().map(|row| row.iter().map(|x| factor * x).collect()).collect()
        };
        let kernel = match self.kernel {
            Kernel::Fractional(exponent) => {
                json!({"fractional": {"exponent": exponent, "matrix": scaled(view.size * view.time.powf(exponent))}})
            }
            Kernel::Exponential(rate) => {
                let entry = |x: &f64| format!("({x:?})*exp(-{:?}*t)", rate * view.time);
                let rows: Vec<Vec<String>> =
                    scaled(view.size * view.time).iter().map(|row| row.iter().map(entry).collect()).collect();
                json!({"entries": rows})
            }
        };
        json!({"convolution": {"variables": variables, "kernel": kernel, "set": [set]}})
    }

    fn fields(&self) -> Vec<Field> {
        (1..=self.q.len()).map(|i| Field::switching(format!("z{i}"))).collect()
    }

    fn starts(&self) -> usize {
        0
    }

    fn end(&self) -> f64 {
        self.end
    }

    fn way(&self) -> Way {
        Way::Mean
    }

    fn smallest(&self) -> f64 {
        0.1
    }

    fn is_unique(&self) -> bool {
        true
    }
}
