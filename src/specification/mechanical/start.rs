//! The initial state of a mechanical system: the mass matrix must be symmetric and positive definite, gaps and joints
//! need nonzero gradients, and bodies must not overlap.

use super::super::error::{Errors, SpecificationError};
use super::super::pointer::Pointer;
use super::Interpenetration;
use contact::{ImpactLaw, State, VelocityStep};
use models::MechanicalModel;
use nalgebra::DMatrix;
use problem::{Constraints, Control};

/// Tolerance for initial gaps and joints, in units of the coordinates: a smaller violation is rounding of the user's
/// numbers.
const ROUNDING: f64 = 1e-9;

/// Largest number of iterations to resolve an overlap of bodies at the start.
const ROUNDS: usize = 40;

/// Checks the initial state of a mechanical system; if `interpenetration` asks to resolve violations, moves it to an
/// admissible state.
pub(super) fn settle(
    model: &mut MechanicalModel,
    t: f64,
    interpenetration: Interpenetration,
    problem: &Pointer<'_>,
    errors: &mut Errors,
) {
    let mut system = model.problem();
    let n = system.structure().coordinates;
    let (q, v) = model.initial.split_at(n);
    let mut state = State { t, q: q.to_vec(), v: v.to_vec() };
    let mut mass = DMatrix::zeros(n, n);
    system.mass(t, &state.q, &mut mass);
    if !check_mass(&mass, &problem.key("mass"), errors) {
        return;
    }
    let mut f = vec![0.0; n];
    system.forces(t, &state.q, &state.v, &mut f);
    if let Some(i) = f.iter().position(|f| !f.is_finite()) {
        let detail = format!("the force on `{}` is {} at the start", model.coordinates[i], f[i]);
        let error = SpecificationError::new(problem.to_string(), "outside_domain", detail);
        errors.push(error.expected("finite forces at the start"));
    }
    let structure = system.structure().clone();
    let mut constraints = Constraints::new(&structure);
    system.constraints(t, &state.q, &mut constraints);
    let place = |row: usize| match row.checked_sub(structure.joints) {
        Some(k) => problem.key("contacts").index(k).key("gap").to_string(),
        None => problem.key("joints").index(row).key("constraint").to_string(),
    };
    for row in 0..structure.joints + structure.contacts.len() {
        let value = constraints.values[row];
        let gradient = constraints.row(row);
        if !value.is_finite() || !gradient.iter().all(|x| x.is_finite()) {
            let detail = format!("this is {value} at the start, or its gradient is not finite");
            errors.push(SpecificationError::new(place(row), "outside_domain", detail));
        } else if gradient.iter().all(|x| *x == 0.0) {
            let detail = "the gradient is zero at the start: the constraint force has no direction";
            errors.push(SpecificationError::new(place(row), "zero_gradient", detail));
        }
    }
    for (k, contact) in structure.contacts.iter().enumerate().filter(|(_, contact)| contact.varies) {
        let speed = contact.slip_speed(&constraints.slip(structure.tangents(k), &state.v));
        let mu = system.friction(k, t, &state.q, &state.v, speed);
        if !(mu.is_finite() && mu >= 0.0) {
            let pointer = problem.key("contacts").index(k).key("friction").key("coefficient").to_string();
            let detail = format!("the coefficient of friction of `{}` is {mu} at the start", model.contacts[k]);
            let error = SpecificationError::new(pointer, "out_of_range", detail);
            errors.push(error.expected("0 or more, wherever and however fast the contact slips"));
        }
    }
    if !errors.is_empty() {
        return;
    }
    if interpenetration == Interpenetration::Resolve {
        let mut step = VelocityStep::new(&mut *system, ImpactLaw::Simultaneous, 1e-12);
        let control = Control::new();
        let resolved = (0..ROUNDS).any(|_| step.resolve(&mut state, &control).unwrap_or(false));
        drop(step);
        if !resolved {
            let detail =
                "the initial state could not be moved to one where no gap is negative and all joints are satisfied";
            errors.push(SpecificationError::new(problem.key("coordinates").to_string(), "interpenetration", detail));
            return;
        }
        model.initial = [state.q, state.v].concat();
        model.is_start_moved = true;
        return;
    }
    for row in 0..structure.joints + structure.contacts.len() {
        let value = constraints.values[row];
        let speed = constraints.velocity(row, &state.v);
        let detail = match row.checked_sub(structure.joints) {
            Some(k) if value < -ROUNDING => format!("`{}` overlaps by {} at the start", model.contacts[k], -value),
            None if value.abs() > ROUNDING => format!("the joint is violated by {value} at the start"),
            None if speed.abs() > ROUNDING => format!("the joint is violated in velocity at the start, by {speed}"),
            _ => continue,
        };
        let error = SpecificationError::new(place(row), "interpenetration", detail);
        errors.push(error.expected("an initial state that satisfies it, or `\"interpenetration\": \"resolve\"`"));
    }
}

/// Checks that the mass matrix is finite, symmetric and positive definite.
fn check_mass(mass: &DMatrix<f64>, place: &Pointer<'_>, errors: &mut Errors) -> bool {
    let size = mass.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let n = mass.nrows();
    for i in 0..n {
        for j in 0..n {
            if !mass[(i, j)].is_finite() {
                let detail = format!("entry ({i}, {j}) is {} at the start", mass[(i, j)]);
                errors.push(SpecificationError::new(place.to_string(), "outside_domain", detail));
                return false;
            }
            if (mass[(i, j)] - mass[(j, i)]).abs() > 1e-12 * size {
                let detail = format!("entries ({i}, {j}) and ({j}, {i}) are {} and {}", mass[(i, j)], mass[(j, i)]);
                let error = SpecificationError::new(place.to_string(), "mass_not_symmetric", detail);
                errors.push(error.expected("a symmetric matrix"));
                return false;
            }
        }
        if mass[(i, i)] <= 0.0 {
            let detail = format!("entry ({i}, {i}) is {} at the start", mass[(i, i)]);
            let error = SpecificationError::new(place.to_string(), "mass_not_positive", detail);
            errors.push(error.expected("a positive definite matrix"));
            return false;
        }
    }
    if mass.clone().cholesky().is_none() {
        let detail =
            "the matrix is not positive definite at the start: some velocity has no kinetic energy, or a negative one";
        let error = SpecificationError::new(place.to_string(), "mass_not_positive", detail);
        errors.push(error.expected("a positive definite matrix"));
        return false;
    }
    true
}
