//! The memory that a solve takes, as far as it is known before it runs: its trajectory at the times asked for, and its
//! matrices; of bodies the contacts at the start. What turns out on the way (the fill of sparse factors, contacts that bodies
//! come to, the steps where no times are asked for) is bounded as it does.

use super::checked::Specification;
use super::stages::Stages;
use models::Model;
use radau::matrix_numbers;

/// The stages that a run with a choice of them begins with.
const FEWEST_STAGES: usize = 3;
/// The numbers that a node of a grid takes for itself, and for each of its neighbours, in the matrices, their factors and
/// those of the coarser grids: measured.
const NUMBERS_A_NODE: usize = 60;
const NUMBERS_A_NEIGHBOUR: usize = 6;

impl Specification {
    /// The bytes that a solve is known to take.
    pub fn memory_bytes(&self) -> usize {
        let numbers = self.trajectory_numbers().saturating_add(self.matrix_numbers());
        numbers.saturating_mul(size_of::<f64>()).saturating_add(self.load.bytes())
    }

    fn trajectory_numbers(&self) -> usize {
        let times = self.output_times().map_or(0, <[f64]>::len);
        times.saturating_mul(1 + self.output_fields().len())
    }

    fn matrix_numbers(&self) -> usize {
        match self.model() {
            Model::Dvi(model) => {
                let stages = match self.method().stages {
                    Stages::Fixed(stages) => stages as usize,
                    Stages::Auto => FEWEST_STAGES,
                };
                matrix_numbers(model.structure(), stages)
            }
            // The mass, what is implicit, two Jacobians; the responses to impulses.
            Model::Mechanical(model) => {
                let structure = model.structure();
                let (n, rows) = (structure.coordinates, structure.rows());
                n.saturating_mul(n).saturating_mul(4).saturating_add(n.saturating_mul(rows))
            }
            // Its states, before and after a step.
            Model::RigidBodies(scene) => 4 * 13 * scene.bodies.len(),
            Model::Obstacle(obstacle) => {
                let neighbours = 3_usize.pow(obstacle.grid.dimension() as u32);
                obstacle.grid.nodes().saturating_mul(NUMBERS_A_NODE + neighbours * NUMBERS_A_NEIGHBOUR)
            }
            Model::Convolution(model) => self.convolution_numbers(model),
        }
    }
}
