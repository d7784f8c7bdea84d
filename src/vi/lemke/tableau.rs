//! The condensed tableau of complementary pivoting: `m` basic variables as affine functions of `m + 1` nonbasic ones,
//!
//! ```text
//! x_B = const + T x_N,    at first  w = q + A z + d theta
//! ```
//!
//! An exchange swaps a basic and a nonbasic variable (Cottle, Pang and Stone 1992, *The Linear Complementarity
//! Problem*, section 2.3). The values of the basic variables are stored instead of the constant, since nonbasic
//! variables may rest at either bound of an interval.

/// The index of a variable: `z_i` is `i`, `w_i` is `m + i`, `theta` is `2 m`.
pub(super) type Variable = usize;

/// The condensed tableau of complementary pivoting.
#[derive(Debug)]
pub(super) struct Tableau {
    /// The number of basic variables, `m`.
    pub m: usize,
    /// The columns of the matrix `T`, each of length `m`, one after the other.
    entries: Vec<f64>,
    /// The basic variable of each row.
    pub basic: Vec<Variable>,
    /// The nonbasic variable of each column.
    pub nonbasic: Vec<Variable>,
    /// The row of each basic variable or, for a nonbasic variable, `m` plus its column.
    place: Vec<usize>,
    /// The values of the basic variables, by row.
    pub value: Vec<f64>,
    /// For each basic variable, the largest term of the sum that is its value: rounding errors have this size times
    /// the machine precision.
    pub magnitude: Vec<f64>,
    /// The lower bound of each basic variable, by row.
    pub lower: Vec<f64>,
    /// The upper bound of each basic variable, by row.
    pub upper: Vec<f64>,
    spare: Vec<f64>,
}

impl Tableau {
    pub fn new(m: usize) -> Self {
        Self {
            m,
            entries: vec![0.0; m * (m + 1)],
            basic: (m..2 * m).collect(),
            nonbasic: (0..m).chain([2 * m]).collect(),
            place: vec![0; 2 * m + 1],
            value: vec![0.0; m],
            magnitude: vec![0.0; m],
            lower: vec![0.0; m],
            upper: vec![0.0; m],
            spare: vec![0.0; m],
        }
    }

    /// Resizes the tableau to `m` variables; its content is lost.
    pub fn resize(&mut self, m: usize) {
        self.m = m;
        self.entries.resize(m * (m + 1), 0.0);
        self.basic.resize(m, 0);
        self.nonbasic.resize(m + 1, 0);
        self.place.resize(2 * m + 1, 0);
        for vector in [&mut self.value, &mut self.magnitude, &mut self.lower, &mut self.upper, &mut self.spare] {
            vector.resize(m, 0.0);
        }
    }

    /// Makes every `w` basic and every `z` nonbasic; the caller writes the entries.
    pub fn reset(&mut self) {
        let m = self.m;
        for i in 0..m {
            self.basic[i] = m + i;
            self.nonbasic[i] = i;
            self.place[i] = m + i;
            self.place[m + i] = i;
        }
        self.nonbasic[m] = 2 * m;
        self.place[2 * m] = 2 * m;
    }

    pub fn column(&self, c: usize) -> &[f64] {
        &self.entries[c * self.m..][..self.m]
    }

    pub fn column_mut(&mut self, c: usize) -> &mut [f64] {
        &mut self.entries[c * self.m..][..self.m]
    }

    pub fn entry(&self, r: usize, c: usize) -> f64 {
        self.entries[c * self.m + r]
    }

    /// Returns the complement of a variable: `w_i` for `z_i`, and `z_i` for `w_i`.
    pub fn complement(&self, variable: Variable) -> Variable {
        if variable < self.m { variable + self.m } else { variable - self.m }
    }

    /// Returns the row of a basic variable; `None` for a nonbasic one.
    pub fn row_of(&self, variable: Variable) -> Option<usize> {
        let place = self.place[variable];
        (place < self.m).then_some(place)
    }

    /// Returns the column of a nonbasic variable; `None` for a basic one.
    pub fn column_of(&self, variable: Variable) -> Option<usize> {
        self.place[variable].checked_sub(self.m)
    }

    /// Changes the nonbasic variable of column `c` by `change`, and the basic variables accordingly.
    pub fn advance(&mut self, c: usize, change: f64) {
        let column = &self.entries[c * self.m..][..self.m];
        for ((value, magnitude), &t) in self.value.iter_mut().zip(&mut self.magnitude).zip(column) {
            let term = t * change;
            *value += term;
            *magnitude = if term.abs() > *magnitude { term.abs() } else { *magnitude };
        }
    }

    /// Exchanges the basic variable of row `r` with the nonbasic one of column `c`, among the first `width` columns.
    /// The caller sets the value and the interval of row `r`.
    pub fn exchange(&mut self, r: usize, c: usize, width: usize) {
        let m = self.m;
        self.spare.copy_from_slice(&self.entries[c * m..][..m]);
        let reciprocal = 1.0 / self.spare[r];
        for j in 0..width {
            let column = &mut self.entries[j * m..][..m];
            if j == c {
                for t in column.iter_mut() {
                    *t *= reciprocal;
                }
                column[r] = reciprocal;
                continue;
            }
            let factor = column[r] * reciprocal;
            if factor != 0.0 {
                for (t, &s) in column.iter_mut().zip(&self.spare) {
                    *t -= s * factor;
                }
            }
            column[r] = -factor;
        }
        let (leaving, entering) = (self.basic[r], self.nonbasic[c]);
        self.basic[r] = entering;
        self.nonbasic[c] = leaving;
        self.place[entering] = r;
        self.place[leaving] = m + c;
    }
}
