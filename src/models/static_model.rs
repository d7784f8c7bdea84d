//! A static variational inequality, `z in K`, `<G(z), z~ - z> >= 0` for all `z~ in K`: the equations of a
//! differential variational inequality without states, and the initial guess of the iteration.

use super::{DviModel, Unbindable};
use problem::{ConvexSet, Dvi};
use vi::SparseVi;

/// A static variational inequality with the initial guess of its variables.
#[derive(Clone, Debug)]
pub struct StaticModel {
    /// The equations of the inequality, a differential variational inequality without states.
    pub equations: DviModel,
    /// The initial guess of the variables, from which the iteration starts.
    pub start: Vec<f64>,
}

impl StaticModel {
    /// Returns a copy of the model with new parameter values and the old initial guess.
    ///
    /// # Errors
    /// See [`DviModel::with_parameters`].
    pub fn with_parameters(&self, values: &[f64]) -> Result<Self, Unbindable> {
        Ok(Self { equations: self.equations.with_parameters(values)?, start: self.start.clone() })
    }

    /// Returns a new evaluator of the static variational inequality with its own workspace.
    pub fn inequality(&self) -> Inequality {
        Inequality { equations: self.equations.problem(), grid: grid(&self.equations.variable_names) }
    }
}

/// Returns the shape of the grid whose nodes are the variables: if the names are those of the nodes of one grid with
/// several indices, `z[1,1]`, `z[1,2]`, .., last index fastest; otherwise `None`.
fn grid(names: &[String]) -> Option<Vec<usize>> {
    let read = |name: &str| -> Option<(String, Vec<i64>)> {
        let (base, inside) = name.strip_suffix(']')?.split_once('[')?;
        let indices = inside.split(',').map(str::parse).collect::<Result<_, _>>().ok()?;
        Some((base.to_owned(), indices))
    };
    let (base, first) = read(names.first()?)?;
    let (_, last) = read(names.last()?)?;
    if first.len() < 2 || last.len() != first.len() {
        return None;
    }
    let side = |(last, first): (&i64, &i64)| usize::try_from(last.checked_sub(*first)?.checked_add(1)?).ok();
    let shape: Vec<usize> = last.iter().zip(&first).map(side).collect::<Option<_>>()?;
    if shape.iter().try_fold(1_usize, |count, side| count.checked_mul(*side)) != Some(names.len()) {
        return None;
    }
    let is_node = |(mut place, name): (usize, &String)| {
        read(name).is_some_and(|(own, indices)| {
            own == base
                && indices.len() == shape.len()
                && (0..shape.len()).rev().all(|k| {
                    let index = first[k] + (place % shape[k]) as i64;
                    place /= shape[k];
                    index == indices[k]
                })
        })
    };
    names.iter().enumerate().all(is_node).then_some(shape)
}

/// An evaluator of the function `G` of a static variational inequality, and of its derivative.
pub struct Inequality {
    /// The equations of the inequality, a differential variational inequality without states.
    pub equations: Box<dyn Dvi>,
    grid: Option<Vec<usize>>,
}

impl SparseVi for Inequality {
    fn set(&self) -> &ConvexSet {
        &self.equations.structure().set
    }

    fn pattern(&self) -> &[(usize, usize)] {
        &self.equations.structure().pattern
    }

    fn is_affine(&self) -> bool {
        self.equations.structure().constant_jacobian
    }

    fn grid(&self) -> Option<Vec<usize>> {
        self.grid.clone()
    }

    fn evaluate(&mut self, z: &[f64], f: &mut [f64]) {
        self.equations.evaluate(0.0, z, f);
    }

    fn derivatives(&mut self, z: &[f64], values: &mut [f64]) {
        self.equations.jacobian(0.0, z, values);
    }
}
