//! The linear differential variational inequality `x' = A x + B z + a(t)`, `z in K`, `G = C x + D z + g(t)`, over any
//! set: the form of circuits, relays and most random problems, written as matrices or as expressions.

use super::problem::View;
use super::signal::Signal;
use serde_json::{Map, Value, json};
use std::fmt::Write;

/// A factor of the set `K`, which is a Cartesian product of such factors.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    Free,
    Nonnegative,
    Box(f64, f64),
    Ball(f64),
    Cone,
    Simplex,
    /// A polyhedron `A z <= b`, given by `A` and `b`.
    Polyhedron(Vec<Vec<f64>>, Vec<f64>),
}

/// The matrices, forcing terms and set of a linear problem. The factors of the set take the variables in order; each
/// is stored with its number of variables.
#[derive(Clone, Debug, Default)]
pub struct Linear {
    pub initial: Vec<f64>,
    pub a: Vec<Vec<f64>>,
    pub b: Vec<Vec<f64>>,
    pub c: Vec<Vec<f64>>,
    pub d: Vec<Vec<f64>>,
    /// The forcing terms `a(t)` of the rates.
    pub drive: Vec<Signal>,
    /// The forcing terms `g(t)` of the inequalities.
    pub gap: Vec<Signal>,
    pub set: Vec<(Shape, usize)>,
}

impl Linear {
    pub fn states(&self) -> usize {
        self.initial.len()
    }

    pub fn variables(&self) -> usize {
        self.gap.len()
    }

    /// Returns the problem as an `lcs`, written in matrices.
    pub fn as_matrices(&self, view: &View) -> Value {
        let scaled = |matrix: &[Vec<f64>], factor: f64| -> Vec<Vec<f64>> {
            matrix.iter().map(|row| row.iter().map(|entry| factor * entry).collect()).collect()
        };
        let signals = |signals: &[Signal], factor: f64| -> Vec<String> {
            signals.iter().map(|signal| signal.expression(factor, view.time)).collect()
        };
        json!({"lcs": {
            "initial": self.initial(view),
            "A": scaled(&self.a, view.time), "B": scaled(&self.b, view.time / view.size),
            "C": scaled(&self.c, view.size), "D": self.d,
            "a": signals(&self.drive, view.time / view.size), "g": signals(&self.gap, 1.0),
            "set": self.blocks(),
        }})
    }

    /// Returns the problem as a `dvi`, written in expressions.
    pub fn as_expressions(&self, view: &View) -> Value {
        let row = |signal: &Signal, factor: f64, x: &[f64], x_factor: f64, z: &[f64]| {
            let mut text = signal.expression(factor, view.time);
            for (letter, row, factor) in [('x', x, x_factor), ('z', z, factor)] {
                for (j, entry) in row.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
                    write!(text, " + ({:?})*{letter}{}", factor * entry, j + 1).expect("a string");
                }
            }
            text
        };
        let initial = self.initial(view);
        let states: Map<String, Value> = (0..self.states())
            .map(|i| {
                let rate = row(&self.drive[i], view.time / view.size, &self.a[i], view.time, &self.b[i]);
                (format!("x{}", i + 1), json!({"initial": initial[i], "rate": rate}))
            })
            .collect();
        let variables: Map<String, Value> = (0..self.variables())
            .map(|i| {
                let inequality = row(&self.gap[i], 1.0, &self.c[i], view.size, &self.d[i]);
                (format!("z{}", i + 1), json!({"inequality": inequality}))
            })
            .collect();
        json!({"dvi": {"states": states, "variables": variables, "set": self.blocks()}})
    }

    fn initial(&self, view: &View) -> Vec<f64> {
        let start = |(i, x): (usize, &f64)| (x + view.change(i)) / view.size;
        self.initial.iter().enumerate().map(start).collect()
    }

    fn blocks(&self) -> Vec<Value> {
        let mut first = 1;
        let block = |(shape, size): &(Shape, usize)| {
            let names: Vec<String> = (first..first + size).map(|k| format!("z{k}")).collect();
            first += size;
            match shape {
                Shape::Free => json!({"free": names}),
                Shape::Nonnegative => json!({"nonnegative": names}),
                Shape::Box(lower, upper) => json!({"box": {"of": names, "lower": lower, "upper": upper}}),
                Shape::Ball(radius) => json!({"ball": {"of": names, "radius": radius}}),
                Shape::Cone => json!({"second_order_cone": names}),
                Shape::Simplex => json!({"simplex": names}),
                Shape::Polyhedron(a, b) => json!({"polyhedron": {"of": names, "A": a, "b": b}}),
            }
        };
        self.set.iter().map(block).collect()
    }
}

/// Returns the product of two matrices.
pub fn product(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let columns = b.first().map_or(0, Vec::len);
    let entry = |row: &[f64], j: usize| row.iter().zip(b).map(|(x, other)| x * other[j]).sum();
    a.iter().map(|row| (0..columns).map(|j| entry(row, j)).collect()).collect()
}

pub fn transposed(a: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let columns = a.first().map_or(0, Vec::len);
    (0..columns).map(|j| a.iter().map(|row| row[j]).collect()).collect()
}

pub fn zeros(rows: usize, columns: usize) -> Vec<Vec<f64>> {
    vec![vec![0.0; columns]; rows]
}
