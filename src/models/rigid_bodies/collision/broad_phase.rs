//! Broad phase of collision detection: pairs of overlapping bounding boxes, by sweep and prune along one axis.
//!
//! The order of the boxes along the axis is kept from the last step; few boxes change places, so that sorting takes
//! linear time. The sweep axis is the axis along which the centres of the boxes have the largest variance.

use nalgebra::Vector3;
use problem::{Control, Interrupted};

/// The state of the sweep-and-prune algorithm for pairs of nearby bodies, with the order of the bodies along the sweep
/// axis, which is kept from step to step.
#[derive(Clone, Debug, Default)]
pub struct BroadPhase {
    order: Vec<u32>,
    axis: usize,
    boxes: Vec<Bounds>,
}

#[derive(Clone, Copy, Debug)]
struct Bounds {
    body: u32,
    lower: Vector3<f64>,
    upper: Vector3<f64>,
}

/// Number of bodies processed between two polls of [`Control`] for interruption.
const AT_ONCE: usize = 1 << 6;

impl BroadPhase {
    /// Passes the pairs `(i, j)`, `i < j`, with overlapping boxes to `found`, until `found` returns an error.
    /// `bounds(i)` are the lower and the upper corner of the box of body `i`; pairs of two bodies that do not move are
    /// skipped.
    ///
    /// # Errors
    /// The error of `found`, or an interruption if `control` asks to stop.
    pub fn sweep<E: From<Interrupted>>(
        &mut self,
        bodies: usize,
        bounds: impl Fn(usize) -> (Vector3<f64>, Vector3<f64>),
        moves: impl Fn(usize) -> bool,
        control: &Control,
        mut found: impl FnMut(u32, u32) -> Result<(), E>,
    ) -> Result<(), E> {
        if self.order.len() != bodies {
            self.order = (0..bodies as u32).collect();
        }
        self.boxes.clear();
        let (mut sum, mut squares) = (Vector3::zeros(), Vector3::zeros());
        for &body in &self.order {
            let (lower, upper) = bounds(body as usize);
            self.boxes.push(Bounds { body, lower, upper });
            if moves(body as usize) {
                let centre = 0.5 * (lower + upper);
                sum += centre;
                squares += centre.component_mul(&centre);
            }
        }
        let spread = squares - sum.component_mul(&sum) / bodies.max(1) as f64;
        self.axis = spread.imax();
        let axis = self.axis;
        self.boxes.sort_by(|a, b| a.lower[axis].total_cmp(&b.lower[axis]).then(a.body.cmp(&b.body)));
        self.order.clear();
        self.order.extend(self.boxes.iter().map(|bounds| bounds.body));
        for (k, a) in self.boxes.iter().enumerate() {
            if k.is_multiple_of(AT_ONCE) {
                control.go_on()?;
            }
            for b in self.boxes[k + 1..].iter().take_while(|b| b.lower[axis] <= a.upper[axis]) {
                let overlap = (0..3).all(|i| a.lower[i] <= b.upper[i] && b.lower[i] <= a.upper[i]);
                if overlap && (moves(a.body as usize) || moves(b.body as usize)) {
                    found(a.body.min(b.body), a.body.max(b.body))?;
                }
            }
        }
        Ok(())
    }
}
