//! The Delassus operator of rigid bodies in factored form,
//!
//! ```text
//! u = W r + q,    W = J M^-1 J^T,    M^-1 = diag(m_b^-1 I, I_b^-1),    J_k = +-E_k [I  -[p]x] for the two bodies of contact k
//! ```
//!
//! with the arm `p` from the centre of the body to the contact. The memory, and the time of a product, are linear in
//! the number of contacts, however many contacts a body has, whereas `W` itself has a block for every pair of
//! contacts on one body.

use nalgebra::{Matrix3, Vector3};

/// The inverse mass and the inverse inertia of a body, in world axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mobility {
    /// The inverse mass `1 / m`.
    pub linear: f64,
    /// The inverse inertia tensor `I^-1`.
    pub angular: Matrix3<f64>,
}

/// The linear and the angular velocity of a body.
pub type Twist = (Vector3<f64>, Vector3<f64>);

/// The rows `J_k` of contact `k`, which give its relative velocity: `u = E (v_2 + w_2 x p_2 - v_1 - w_1 x p_1)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grip {
    /// The indices of both bodies of the contact; `None` for a body that does not move.
    pub bodies: [Option<u32>; 2],
    /// The contact frame `E`: the normal and two tangents as rows.
    pub frame: Matrix3<f64>,
    /// The arms `p_1` and `p_2`, from the centre of each body to the point of contact.
    pub arms: [Vector3<f64>; 2],
}

/// The Delassus operator `W` in factored form.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Factored {
    /// The mobilities (inverse mass and inertia) of the bodies; the last one is zero, and is that of every body that
    /// does not move.
    mobilities: Vec<Mobility>,
    /// The rows `J_k` of the contacts, each with the indices of its two bodies among the mobilities.
    rows: Vec<(Grip, [u32; 2])>,
}

impl Factored {
    /// Builds the operator from the mobilities of bodies and the rows of contacts.
    ///
    /// # Panics
    /// Panics if a row refers to a body that does not exist.
    pub fn new(mobilities: impl IntoIterator<Item = Mobility>, grips: impl IntoIterator<Item = Grip>) -> Self {
        let mut mobilities: Vec<Mobility> = mobilities.into_iter().collect();
        let ground = mobilities.len() as u32;
        mobilities.push(Mobility::default());
        let place = |body: Option<u32>| {
            let place = body.unwrap_or(ground);
            assert!(place <= ground, "each body has a mobility");
            place
        };
        Self { rows: grips.into_iter().map(|grip| (grip, grip.bodies.map(place))).collect(), mobilities }
    }

    /// Returns the number of contacts.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no contacts.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Multiplies the rows `J_k` of each contact by its factor in `d`, so that the operator `W` becomes `D W D`.
    pub(super) fn scale(&mut self, d: &[f64]) {
        for ((grip, _), &d) in self.rows.iter_mut().zip(d) {
            grip.frame *= d;
        }
    }

    /// Writes `M^-1 J^T r`, the velocities that the contact impulses give to the bodies.
    pub fn twists(&self, r: &[Vector3<f64>], twists: &mut Vec<Twist>) {
        twists.clear();
        twists.resize(self.mobilities.len(), Twist::default());
        for ((grip, [a, b]), r) in self.rows.iter().zip(r) {
            let push = grip.frame.tr_mul(r);
            let first = &mut twists[*a as usize];
            *first = (first.0 - push, first.1 - grip.arms[0].cross(&push));
            let second = &mut twists[*b as usize];
            *second = (second.0 + push, second.1 + grip.arms[1].cross(&push));
        }
        for ((v, w), mobility) in twists.iter_mut().zip(&self.mobilities) {
            (*v, *w) = (*v * mobility.linear, mobility.angular * *w);
        }
    }

    /// Returns the relative velocity of a contact: its rows `J_k` times the velocities of the bodies.
    #[inline]
    pub fn row_product(&self, k: usize, twists: &[Twist]) -> Vector3<f64> {
        let (grip, [a, b]) = &self.rows[k];
        let ((v_1, w_1), (v_2, w_2)) = (&twists[*a as usize], &twists[*b as usize]);
        grip.frame * (v_2 - v_1 + w_2.cross(&grip.arms[1]) - w_1.cross(&grip.arms[0]))
    }

    /// Adds `M^-1 J_k^T r`, the effect of one contact impulse, to the velocities of the bodies.
    #[inline]
    pub fn push(&self, k: usize, r: &Vector3<f64>, twists: &mut [Twist]) {
        let (grip, bodies) = &self.rows[k];
        let push = grip.frame.tr_mul(r);
        for (side, push) in [(0, -push), (1, push)] {
            let (body, mobility) = (bodies[side] as usize, &self.mobilities[bodies[side] as usize]);
            twists[body].0 += push * mobility.linear;
            twists[body].1 += mobility.angular * grip.arms[side].cross(&push);
        }
    }

    /// Returns the diagonal block `W_kk` of contact `k`.
    pub fn diagonal(&self, k: usize) -> Matrix3<f64> {
        let (grip, bodies) = &self.rows[k];
        let of = |side: usize| {
            let mobility = &self.mobilities[bodies[side] as usize];
            let angular = grip.frame * grip.arms[side].cross_matrix();
            grip.frame * grip.frame.transpose() * mobility.linear + angular * mobility.angular * angular.transpose()
        };
        of(0) + of(1)
    }

    /// Returns the product `W r` with the contact impulses `r`.
    pub fn product(&self, r: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut twists = Vec::new();
        self.twists(r, &mut twists);
        (0..self.len()).map(|k| self.row_product(k, &twists)).collect()
    }
}
