//! The Delassus operator of the contacts of an island, `W = J M^-1 J^T`. Two contacts `i` and `j` on the same body
//! with mass `m` and inverse inertia `I^-1` are coupled by
//!
//! ```text
//! W_ij = s_i s_j (E_i E_j^T / m + A_i I^-1 A_j^T),    s = -1 on the first side, +1 on the second
//! ```
//!
//! with the contact frame `E` and the block `A` of `J` for the angular velocity.

use super::contact::Contact;
use super::motion::Motion;
use nalgebra::Matrix3;
use problem::Control;
use vi::coulomb::{BlockMatrix, Factored, Grip, Mobility};

/// Number of block rows of the Delassus operator assembled between two polls of [`Control`] for interruption.
const ROWS_AT_ONCE: usize = 1 << 6;

/// One side of a contact, with its blocks of the contact Jacobian for the body on this side.
struct Touch {
    body: u32,
    contact: u32,
    /// The block `s E` of the contact Jacobian for the velocity of the body, with the sign `s` of the side.
    linear: Matrix3<f64>,
    /// The block `s A` of the contact Jacobian for the angular velocity of the body, with the sign `s` of the side.
    angular: Matrix3<f64>,
}

/// A block of the Delassus operator with its block row and block column.
pub type Block = (usize, usize, Matrix3<f64>);

/// Returns the Delassus operator as the blocks of a sparse matrix, with two blocks for a pair of contacts that share
/// two bodies. `None` if `control` asks to stop.
pub fn blocks(contacts: &[Contact], moving: &[Motion], control: &Control) -> Option<Vec<Block>> {
    let mut touches: Vec<Touch> = Vec::with_capacity(2 * contacts.len());
    for (k, contact) in contacts.iter().enumerate() {
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            if let Some(body) = contact.bodies[side] {
                touches.push(Touch {
                    body,
                    contact: k as u32,
                    linear: if contact.turns { Matrix3::zeros() } else { contact.frame * sign },
                    angular: contact.angular(side) * sign,
                });
            }
        }
    }
    touches.sort_by_key(|touch| (touch.body, touch.contact));
    let mut on_body = vec![0..0; moving.len()];
    let mut start = 0;
    for group in touches.chunk_by(|a, b| a.body == b.body) {
        on_body[group[0].body as usize] = start..start + group.len();
        start += group.len();
    }
    let mut blocks = Vec::with_capacity(touches.iter().map(|touch| on_body[touch.body as usize].len()).sum());
    // Assemble the Delassus operator by rows, so that blocks are almost sorted: only the blocks of the two bodies of
    // each row have to be merged.
    for (i, contact) in contacts.iter().enumerate() {
        if i % ROWS_AT_ONCE == 0 {
            control.go_on().ok()?;
        }
        let row = blocks.len();
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let Some(place) = contact.bodies[side] else { continue };
            let body = &moving[place as usize];
            let along = if contact.turns { 0.0 } else { sign / body.mass };
            let (linear, angular) = (contact.frame * along, contact.angular(side) * body.mobility * sign);
            for b in &touches[on_body[place as usize].clone()] {
                let block = linear * b.linear.transpose() + angular * b.angular.transpose();
                blocks.push((i, b.contact as usize, block));
            }
        }
        blocks[row..].sort_by_key(|&(_, j, _)| j);
    }
    Some(blocks)
}

/// Returns the Delassus operator of the contacts of an island without joints as a sparse matrix; `None` if `control`
/// asks to stop.
pub fn matrix(contacts: &[Contact], moving: &[Motion], control: &Control) -> Option<BlockMatrix> {
    BlockMatrix::from_blocks(contacts.len(), blocks(contacts, moving, control)?)
}

/// Returns the Delassus operator of the contacts of an island without joints in factored form, by bodies and contact
/// Jacobians.
pub fn factors(contacts: &[Contact], moving: &[Motion]) -> Factored {
    let mobility = |motion: &Motion| Mobility { linear: motion.mass.recip(), angular: motion.mobility };
    let grip = |contact: &Contact| Grip { bodies: contact.bodies, frame: contact.frame, arms: contact.arms };
    Factored::new(moving.iter().map(mobility), contacts.iter().map(grip))
}
