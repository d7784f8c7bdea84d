//! Sequential impacts: of the closed contacts that approach, the fastest is struck by Newton's law while the others
//! carry no impulse, until none approaches. The law reproduces a row of balls through which shocks run one by one
//! (Newton's cradle), where the simultaneous law sets every ball in motion at once. Between two contacts with `e < 1`
//! strikes may follow each other without end; beyond a limit the remaining approach is left to the simultaneous law.

use super::{Contacts, Delassus};
use nalgebra::Vector3;
use vi::coulomb::{Role, solve_contact, solve_patch};

/// Largest number of strikes (impulses of a single contact) per contact in one sequential impact; beyond it the
/// simultaneous impact law takes over.
const STRIKES: usize = 1000;

/// Approach velocities below this fraction of the largest velocity before the impacts are treated as zero.
const ROUNDING: f64 = 1e-13;

/// Returns the strikes in their order, each with its contact and its impulse, starting from the velocities before the
/// step. Friction in each strike is that of a single contact with a disk as its friction set, or of a single patch
/// with its torque.
pub fn sequential(contacts: &Contacts<'_>) -> Vec<(usize, Vector3<f64>)> {
    let n = contacts.gap.len();
    let mut u = contacts.before.to_vec();
    let least = ROUNDING * u.iter().fold(0.0_f64, |most, u| most.max(u.norm()));
    let mut strikes = Vec::new();
    while strikes.len() < STRIKES * n {
        let closed = |k: &usize| !contacts.is_torque(*k) && u[*k].x < -least && contacts.closes(*k, u[*k].x);
        let Some(k) = (0..n).filter(closed).min_by(|&a, &b| u[a].x.total_cmp(&u[b].x)) else { break };
        let q = Vector3::new((1.0 + contacts.restitution[k]) * u[k].x, u[k].y, u[k].z);
        let first = strikes.len();
        match (contacts.delassus, contacts.roles.get(k)) {
            (Delassus::Blocks(blocks), Some(&Role::Force(reach))) => {
                let none = [Vector3::zeros(); 2];
                let [force, torque] = solve_patch(blocks, k, &[q, u[k + 1]], contacts.mu[k], reach, &none);
                if force.x <= 0.0 {
                    break;
                }
                strikes.extend([(k, force), (k + 1, torque)]);
            }
            (delassus, _) => {
                let Some(strike) = solve_contact(&delassus.diagonal(k), &q, contacts.mu[k]) else { break };
                strikes.push((k, strike));
            }
        }
        match contacts.delassus {
            // `W` is symmetric up to rounding: its columns are its transposed rows.
            Delassus::Blocks(blocks) => {
                for &(row, strike) in &strikes[first..] {
                    blocks.row(row).for_each(|(l, block)| u[l] += block.transpose() * strike);
                }
            }
            Delassus::Factors(factors) => {
                let mut alone = vec![Vector3::zeros(); n];
                strikes[first..].iter().for_each(|&(row, strike)| alone[row] = strike);
                u.iter_mut().zip(factors.product(&alone)).for_each(|(u, change)| *u += change);
            }
        }
    }
    strikes
}
