//! A static variational inequality, `z in K`, `<G(z), z~ - z> >= 0` for all `z~ in K`: the equations of a differential one
//! without states, and the point where a search for its solution begins.

use super::{DviModel, Unbindable};
use problem::{ConvexSet, Dvi};
use vi::SparseVi;

/// A static problem with its names.
#[derive(Clone, Debug)]
pub struct StaticModel {
    /// The equations, without states.
    pub equations: DviModel,
    /// The variables where a search begins.
    pub start: Vec<f64>,
}

impl StaticModel {
    /// The same problem with other values of its parameters; the start stays.
    ///
    /// # Errors
    /// As of [`DviModel::with_parameters`].
    pub fn with_parameters(&self, values: &[f64]) -> Result<Self, Unbindable> {
        Ok(Self { equations: self.equations.with_parameters(values)?, start: self.start.clone() })
    }

    /// An evaluator with registers of its own.
    pub fn inequality(&self) -> Inequality {
        Inequality { equations: self.equations.problem(), grid: grid(&self.equations.variable_names) }
    }
}

/// The shape of the grid whose nodes have these names, `z[1,1]`, `z[1,2]`, .. with the last index fastest, if they have
/// several indices and are those of one grid.
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

/// `G` and its derivative.
pub struct Inequality {
    /// The equations, without states.
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
