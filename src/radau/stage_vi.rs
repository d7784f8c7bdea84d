//! The stage equations with the variational inequality at every stage, where the stages need not share a face: the
//! Josephy-Newton method (Facchinei and Pang 2003, section 7.3). Rates and `G` are linearised, and `K` is kept exactly.
//! The states and the unbounded variables are eliminated with the transformed factors, which leaves an affine VI in the
//! bounded variables of all stages,
//!
//! ```text
//! w_i = q_i + sum_j S_ij z_j,    S = I (x) G_z + (T (x) G_y) E^-1 (T^-1 (x) e)
//! ```
//!
//! where `E` is the block-diagonal matrix of [`Factors`] with the bounded variables held fixed, and `e` are their unit
//! vectors. Row block `i` is scaled by `d_i` of the tableau, so that `S` is monotone if the problem is.

use super::face::{ActiveFace, Activity, place};
use super::factors::Factors;
use super::footprint::check_memory;
use super::newton_control::{NewtonControl, UNDERFLOW};
use super::regular_face::{Member, Rests, regularise};
use super::settings::{RejectionCause, StepError};
use super::stages::Stages;
use super::system::System;
use super::tableau::Tableau;
use nalgebra::{Complex, DMatrix};
use problem::{ConvexSet, Shape, Workspace};
use vi::{AffineVi, Attempt, Outcome, SolverKind, ViSolver};

/// The variational inequality coupled over the stages, and the solver of its affine problems.
pub struct StageVi {
    solver: Box<dyn ViSolver>,
    /// Matrix `S` of the affine variational inequality, with its row blocks scaled.
    matrix: DMatrix<f64>,
    q: Vec<f64>,
    /// The set `K` of the bounded variables, and the product of this set over all stages.
    factor: ConvexSet,
    set: ConvexSet,
    workspace: Workspace,
    /// Argument `z - s g` of the projection for the bounded variables of all stages, with the scale `s` of their
    /// block.
    moved: Vec<f64>,
    /// Whether the solution of the last variational inequality is on one face of `K` at all stages.
    pub is_one_face: bool,
    /// The bounded variables of all stages, stage by stage: present values, and values before the last solve.
    z: Vec<f64>,
    last_z: Vec<f64>,
    /// Values of `G` for the bounded variables of all stages.
    g: Vec<f64>,
    /// The face of `K` on which all bounded variables are held fixed and the unbounded ones are free.
    held: ActiveFace,
    /// Stage increments and their transforms before the present Newton iteration.
    saved: (Vec<f64>, Vec<f64>),
    /// The largest magnitude of each unknown over the step.
    largest: Vec<f64>,
    /// Offset added to `G` of each variable: zero, unless a switch is known to be exactly at `G = 0`.
    pub offset: Vec<f64>,
    /// Whether the derivatives are evaluated anew at every Newton iteration, for a first guess that may be far off.
    pub relinearise: bool,
    factors: Factors,
    real: Vec<f64>,
    complex: [Vec<f64>; 2],
    /// The variable whose inequality alone proves that the last affine variational inequality that was not solved has
    /// no solution.
    pub contradiction: Option<usize>,
    /// Number of affine variational inequalities solved.
    pub solves: u64,
    /// Number of pivots or iterations of the solver of affine variational inequalities.
    pub pivots: u64,
    /// The unsuccessful attempts of the solver at affine variational inequalities, each with its number of occurrences.
    pub failures: Vec<(Attempt, u64)>,
}

impl StageVi {
    /// Allocates for the stages of a problem.
    ///
    /// # Errors
    /// If the matrix `S` and the matrices of its solver would not fit into memory.
    pub fn new(system: &System<'_>, stages: usize, solver: SolverKind) -> Result<Self, StepError> {
        let unknowns = system.unknowns;
        let coupled = stages * system.bounded.len();
        check_memory("the inequalities of all stages", coupled)?;
        let factor = system.set.restricted(&system.bounded);
        let mut held = ActiveFace { places: vec![Activity::Inactive; unknowns - system.states], ..system.face.clone() };
        system.bounded.iter().for_each(|&k| held.places[k] = Activity::Fixed);
        Ok(Self {
            solver: solver.build(coupled),
            matrix: DMatrix::zeros(coupled, coupled),
            q: vec![0.0; coupled],
            set: factor.power(stages),
            factor,
            workspace: Workspace::default(),
            moved: vec![0.0; coupled],
            is_one_face: false,
            z: vec![0.0; coupled],
            last_z: vec![0.0; coupled],
            g: vec![0.0; coupled],
            held,
            saved: (vec![0.0; stages * unknowns], vec![0.0; stages * unknowns]),
            largest: vec![0.0; unknowns],
            offset: vec![0.0; unknowns - system.states],
            relinearise: false,
            factors: Factors::new(system),
            real: vec![0.0; unknowns],
            complex: [vec![0.0; unknowns], vec![0.0; unknowns]],
            contradiction: None,
            solves: 0,
            pivots: 0,
            failures: Vec::new(),
        })
    }

    /// Whether the equations of the states and the unbounded variables are regular while the bounded variables are held
    /// fixed, with the current derivatives of `system` and a step of size `h`.
    pub fn eliminates(&mut self, system: &mut System<'_>, tableau: &Tableau, h: f64) -> bool {
        self.resize(tableau.stages() * system.bounded.len());
        self.reduce(system, tableau, h)
    }

    /// Returns the name of the solver that solved the last affine variational inequality.
    pub fn solver(&self) -> &'static str {
        self.solver.name()
    }

    /// Returns the factors of the stage equations of the last solve, with the bounded variables held fixed.
    pub fn factors(&mut self) -> &mut Factors {
        &mut self.factors
    }

    /// Swaps the face of `system` with the face on which the bounded variables are held fixed.
    pub fn swap_face(&mut self, system: &mut System<'_>) {
        std::mem::swap(&mut system.face, &mut self.held);
    }

    /// Solves the stages from the current increments `Z`, with `W = T^-1 Z` and the derivatives of `system` frozen. On
    /// success sets the face of `system` to that of the last stage; otherwise leaves it unchanged.
    ///
    /// # Errors
    /// The cause for which the step should be smaller.
    #[expect(clippy::too_many_arguments, reason = "a step is its problem, method, place and tolerance")]
    pub fn solve(
        &mut self,
        system: &mut System<'_>,
        tableau: &Tableau,
        stages: &mut Stages,
        t: f64,
        h: f64,
        y0: &[f64],
        control: &NewtonControl,
    ) -> Result<(), RejectionCause> {
        let (s, n, count) = (tableau.stages(), system.states, system.bounded.len());
        self.resize(s * count);
        if !self.reduce(system, tableau, h) {
            return Err(RejectionCause::Singular);
        }
        let mut norm = f64::INFINITY;
        for iteration in 0..3 * control.most {
            if !self.evaluate(system, tableau, stages, t, h, y0) {
                return Err(RejectionCause::NotFinite);
            }
            // Increments at the rounding level of `y` neither shrink nor matter; the variational inequality and the
            // transforms add rounding errors.
            let rounding = f64::EPSILON * (4.0 * tableau.mixing).max(1e3);
            let least = control.kappa.max(rounding * stages.size(y0, &control.weight, s));
            if iteration > 0 && norm <= least && self.is_solved(system, stages, h, y0, control) {
                self.set_last_face(system, control);
                return Ok(());
            }
            if iteration > 0 && self.relinearise {
                if !system.differentiate(t + h, stages.stage(y0, s - 1)) {
                    return Err(RejectionCause::NotFinite);
                }
                if !self.reduce(system, tableau, h) {
                    return Err(RejectionCause::Singular);
                }
            }
            system.work.newton += 1;
            self.affine(system, tableau, stages, h, control)?;
            for i in 0..s {
                for (a, &k) in system.bounded.iter().enumerate() {
                    let place = i * count + a;
                    stages.phi[i * stages.unknowns + n + k] = self.z[place] - self.last_z[place];
                }
            }
            match stages.increment(system, tableau, &mut self.factors, h, &control.weight) {
                Some(new) if new <= least || (new.is_finite() && (iteration < 3 || new < 2.0 * norm)) => {
                    norm = new;
                }
                Some(_) => return Err(RejectionCause::Diverged),
                None => return Err(RejectionCause::Singular),
            }
        }
        Err(RejectionCause::Slow)
    }

    /// Sets the face of `system` to the face of `K` of the solution at the last stage, and records whether all stages
    /// share it.
    fn set_last_face(&mut self, system: &mut System<'_>, control: &NewtonControl) {
        let stages = self.z.len() / system.bounded.len();
        let mut face = std::mem::take(&mut system.face);
        self.write_face(stages - 1, system, control, &mut face);
        let mut other = face.clone();
        self.is_one_face = (0..stages - 1).all(|i| {
            self.write_face(i, system, control, &mut other);
            other.is_same(&face)
        });
        system.face = face;
    }

    /// Writes the face of `K` of the solution at stage `i` to `face`.
    fn write_face(&mut self, i: usize, system: &System<'_>, control: &NewtonControl, face: &mut ActiveFace) {
        let (count, blocks) = (system.bounded.len(), system.set.blocks().len());
        for (a, &k) in system.bounded.iter().enumerate() {
            let at = i * count + a;
            let (z, g) = (self.z[at], self.g[at]);
            if let Some(b) = system.set.block_of(k) {
                let (noise_z, noise_g) = self.noise(system, control, i * blocks + b);
                self.moved[at] = z - noise_z / noise_g * g;
            } else {
                face.places[k] = place(&self.set, at, z, g);
            }
        }
        for b in 0..blocks {
            let found = self.set.face(i * blocks + b, &self.moved, &mut self.workspace);
            face.set_block(&system.set, b, found);
        }
    }

    /// Sets the face of `system` to one whose equations determine the variables, and moves the variables in `stages`
    /// to the solution on that face. Has no effect unless the last solve was that of a single stage.
    pub fn regularise(&mut self, system: &mut System<'_>, stages: &mut Stages, y0: &[f64]) {
        let n = system.states;
        if self.z.len() != system.bounded.len() {
            return;
        }
        let of_intervals = system.bounded.iter().enumerate().filter(|(_, k)| system.set.block_of(**k).is_none());
        let rests = |k: usize| match system.face.places[k] {
            Activity::AtLower => Some(Rests::Lower),
            Activity::AtUpper => Some(Rests::Upper),
            Activity::Inactive => Some(Rests::Inactive),
            _ => None,
        };
        let mut members: Vec<Member> = of_intervals
            .filter_map(|(at, &k)| {
                let (lower, upper) = (self.set.lower[at], self.set.upper[at]);
                Some(Member { at, z: self.z[at], g: self.g[at], lower, upper, rests: rests(k)? })
            })
            .collect();
        if !regularise(&self.matrix, &mut members) {
            return;
        }
        for Member { at, z, rests, .. } in members {
            let k = system.bounded[at];
            system.face.places[k] = match rests {
                Rests::Lower => Activity::AtLower,
                Rests::Upper => Activity::AtUpper,
                Rests::Inactive => Activity::Inactive,
            };
            stages.z[n + k] = z - y0[n + k];
        }
    }

    /// Returns the noise levels of `z` and of `G` in block `b`, an index over the blocks of all stages.
    fn noise(&self, system: &System<'_>, control: &NewtonControl, b: usize) -> (f64, f64) {
        let (mut noise_g, mut size) = (f64::MIN_POSITIVE, 0.0_f64);
        for at in &self.set.blocks()[b].members {
            let k = system.bounded[at % system.bounded.len()];
            noise_g = noise_g.max(control.noise_of_g(system, k, &self.largest));
            size = size.max(self.largest[system.states + k]);
        }
        (control.vi_tolerance * if size > 0.0 { size } else { 1.0 }, noise_g)
    }

    /// Evaluates rates, `G` and bounds at every stage, with zeros in the rows of `Phi` of the bounded variables.
    fn evaluate(
        &mut self,
        system: &mut System<'_>,
        tableau: &Tableau,
        stages: &mut Stages,
        t: f64,
        h: f64,
        y0: &[f64],
    ) -> bool {
        let (n, unknowns, count) = (system.states, system.unknowns, system.bounded.len());
        stages.points.evaluate(system, &tableau.c, (t, h), y0, &stages.z);
        for i in 0..tableau.stages() {
            if !system.take(&stages.points, i) {
                return false;
            }
            let phi = &mut stages.phi[i * unknowns..(i + 1) * unknowns];
            phi.copy_from_slice(&system.values[..unknowns]);
            for (a, &k) in system.bounded.iter().enumerate() {
                let place = i * count + a;
                self.g[place] = phi[n + k] + self.offset[k];
                self.z[place] = y0[n + k] + stages.z[i * unknowns + n + k];
                self.set.lower[place] = system.set.lower[k];
                self.set.upper[place] = system.set.upper[k];
                phi[n + k] = 0.0;
            }
            for (b, block) in system.set.blocks().iter().enumerate() {
                if let Shape::Ball { radius } = block.shape {
                    self.set.set_radius(i * system.set.blocks().len() + b, radius);
                }
            }
        }
        true
    }

    /// Solves the affine variational inequality at the present stages for the bounded variables `z`; their old values
    /// are in `last_z`.
    fn affine(
        &mut self,
        system: &System<'_>,
        tableau: &Tableau,
        stages: &mut Stages,
        h: f64,
        control: &NewtonControl,
    ) -> Result<(), RejectionCause> {
        let (s, unknowns, count) = (tableau.stages(), system.unknowns, system.bounded.len());
        let size = s * unknowns;
        self.saved.0[..size].copy_from_slice(&stages.z[..size]);
        self.saved.1[..size].copy_from_slice(&stages.w[..size]);
        // Compute the increment of the states and the unbounded variables while the bounded variables are held fixed.
        if stages.increment(system, tableau, &mut self.factors, h, &control.weight).is_none() {
            return Err(RejectionCause::Singular);
        }
        for i in 0..s {
            let d = tableau.d[i];
            for (a, &k) in system.bounded.iter().enumerate() {
                let (row, block) = (i * count + a, i * unknowns);
                let moved = system.slope(k, |j| stages.z[block + j] - self.saved.0[block + j]);
                let product: f64 = self.z.iter().enumerate().map(|(j, z)| self.matrix[(row, j)] * z).sum();
                self.q[row] = d * (self.g[row] + moved) - product;
            }
        }
        stages.z[..size].copy_from_slice(&self.saved.0[..size]);
        stages.w[..size].copy_from_slice(&self.saved.1[..size]);
        self.last_z.copy_from_slice(&self.z);
        let vi = AffineVi { matrix: &self.matrix, q: &self.q, set: &self.set };
        let report = self.solver.solve(&vi, &mut self.z, system.outside);
        self.solves += 1;
        self.pivots += report.iterations as u64;
        for &attempt in self.solver.attempts().iter().filter(|attempt| attempt.outcome != Outcome::Solved) {
            match self.failures.iter_mut().find(|(known, _)| *known == attempt) {
                Some((_, times)) => *times += 1,
                None => self.failures.push((attempt, 1)),
            }
        }
        if report.outcome == Outcome::Solved {
            return Ok(());
        }
        self.contradiction = vi.contradiction().map(|row| system.bounded[row % count]);
        Err(RejectionCause::Unsolved)
    }

    /// Whether the variational inequality holds at every stage to the tolerance, by the last evaluation. The
    /// transforms mix the stages, so the rounding errors of each stage are those of the largest stage, and the
    /// rounding errors of a state at rest are those of the variables that hold it at rest.
    fn is_solved(
        &mut self,
        system: &System<'_>,
        stages: &mut Stages,
        h: f64,
        y0: &[f64],
        control: &NewtonControl,
    ) -> bool {
        let (n, count) = (system.states, system.bounded.len());
        self.largest.copy_from_slice(&control.size);
        for i in 0..self.z.len() / count {
            for (largest, y) in self.largest.iter_mut().zip(stages.stage(y0, i)) {
                *largest = largest.max(y.abs());
            }
        }
        for (i, j, value) in system.entries().filter(|&(i, j, _)| i < n && j >= n) {
            let mass = system.mass_diagonal[i];
            let change = if mass == 0.0 { 0.0 } else { h * value / mass * self.largest[j] };
            self.largest[i] = self.largest[i].max(change.abs());
        }
        let in_interval = |&(_, k): &(usize, &usize)| system.set.block_of(*k).is_none();
        let intervals = system.bounded.iter().enumerate().filter(in_interval).all(|(a, &k)| {
            let noise_g = control.noise_of_g(system, k, &self.largest);
            let noise_z = (control.vi_tolerance * self.largest[n + k]).max(UNDERFLOW);
            (a..self.z.len()).step_by(count).all(|at| {
                let (z, g) = (self.z[at], self.g[at]);
                let (lower, upper) = (self.set.lower[at], self.set.upper[at]);
                let inside = z >= lower - noise_z && z <= upper + noise_z;
                inside && (g <= noise_g || z <= lower + noise_z) && (g >= -noise_g || z >= upper - noise_z)
            })
        });
        intervals
            && (0..self.set.blocks().len()).all(|b| {
                let (noise_z, noise_g) = self.noise(system, control, b);
                // With p = P(z - s g), the variational inequality holds exactly for p and g - (z - p)/s; for this
                // scale s, the changes of z and of g are both noise if that of z is.
                let scale = noise_z / noise_g;
                self.set.defect(b, &self.z, &self.g, scale, &mut self.workspace) <= noise_z
            })
    }

    /// Forms the matrix `S` of the affine variational inequality over the stages from the derivatives of `system`;
    /// returns false if a matrix is singular or the caller asks to stop.
    fn reduce(&mut self, system: &mut System<'_>, tableau: &Tableau, h: f64) -> bool {
        self.factors.compute(system, &self.held, tableau, h);
        system.work.factorisations += 1;
        let (s, n, count) = (tableau.stages(), system.states, system.bounded.len());
        self.matrix.fill(0.0);
        for (b, &k) in system.bounded.iter().enumerate() {
            // Poll the control once for each variable: each needs a solve, which takes long with large factors.
            if system.outside.poll().is_some() {
                return false;
            }
            // Solve for the response of all unknowns to a unit of z_k, one diagonal block of E at a time, and add the
            // response of G for each pair of stages.
            let mut block = 0;
            if tableau.gamma.is_some() {
                self.real.fill(0.0);
                self.real[n + k] = 1.0;
                if !self.factors.solve_real(&mut self.real) {
                    return false;
                }
                for (a, &l) in system.bounded.iter().enumerate() {
                    let response = system.slope(l, |j| self.real[j]);
                    for i in 0..s {
                        for j in 0..s {
                            self.matrix[(i * count + a, j * count + b)] +=
                                tableau.t[(i, 0)] * tableau.t_inverse[(0, j)] * response;
                        }
                    }
                }
                block = 1;
            }
            for pair in 0..tableau.pairs.len() {
                let [re, im] = &mut self.complex;
                re.fill(0.0);
                im.fill(0.0);
                re[n + k] = 1.0;
                if !self.factors.solve_pair(pair, re, im) {
                    return false;
                }
                for (a, &l) in system.bounded.iter().enumerate() {
                    let [re, im] = [0, 1].map(|part| system.slope(l, |j| self.complex[part][j]));
                    for j in 0..s {
                        let right = Complex::new(tableau.t_inverse[(block, j)], -tableau.t_inverse[(block + 1, j)]);
                        let u = right * Complex::new(re, im);
                        for i in 0..s {
                            self.matrix[(i * count + a, j * count + b)] +=
                                tableau.t[(i, block)] * u.re - tableau.t[(i, block + 1)] * u.im;
                        }
                    }
                }
                block += 2;
            }
        }
        for i in 0..s {
            let d = tableau.d[i];
            self.matrix.rows_mut(i * count, count).scale_mut(d);
        }
        self.matrix.iter().all(|value| value.is_finite())
    }

    /// Resizes the vectors and the matrix of the affine variational inequality to `size` variables coupled over the
    /// stages.
    fn resize(&mut self, size: usize) {
        if self.q.len() != size {
            self.matrix.resize_mut(size, size, 0.0);
            for vector in [&mut self.q, &mut self.moved, &mut self.z, &mut self.last_z, &mut self.g] {
                vector.resize(size, 0.0);
            }
            self.set = self.factor.power(size / self.factor.dimension().max(1));
        }
    }
}
