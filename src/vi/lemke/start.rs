//! The initial basis of the path of complementary pivoting: free variables, which must be basic at a solution, and
//! variables that the guess places inside their intervals are exchanged with the `w` of the same index.
//!
//! Free variables come first, by complete pivoting in their own block. If the block is singular, as in a saddle point
//! `[[H, -B^T], [B, 0]]` with `H` on bounded variables, each remaining pair is bordered by a bounded variable with
//! entries in both its row and its column. A row without such entries is a redundant equation, or an infeasible one.

use super::ratio::NOISE;
use super::tableau::Tableau;

/// The block of the free variables counts as singular if its next pivot is below this fraction of the largest pivot.
const SINGULAR: f64 = 1e-12;

/// A diagonal pivot below this fraction of its column is replaced by a two by two pivot.
const WEAK_DIAGONAL: f64 = 0.01;

/// The values of the nonbasic components of `z`, by index.
pub(super) type Resting = [f64];

/// Moves the nonbasic `z` of column `c` until the `w` of row `r` is zero, and exchanges the two.
fn drive_to_zero(tableau: &mut Tableau, resting: &Resting, r: usize, c: usize) {
    let change = -tableau.value[r] / tableau.entry(r, c);
    let entering = tableau.nonbasic[c];
    tableau.advance(c, change);
    tableau.exchange(r, c, tableau.m);
    tableau.value[r] = resting[entering] + change;
    tableau.magnitude[r] = resting[entering].abs().max(change.abs());
}

/// Returns the row of `w_i` and the column of `z_i` in the tableau, if `w_i` is basic and `z_i` is nonbasic.
fn open_row(tableau: &Tableau, i: usize) -> Option<(usize, usize)> {
    Some((tableau.row_of(tableau.m + i)?, tableau.column_of(i)?))
}

/// Makes the free variables basic, with their `w` in `rows` and their `z` in `columns`. Returns false if their
/// equations are singular and not redundant.
pub(super) fn enter_free(tableau: &mut Tableau, resting: &Resting, rows: &mut [usize], columns: &mut [usize]) -> bool {
    let mut largest = 0.0;
    for done in 0..rows.len() {
        let (mut pivot, mut place) = (0.0, (done, done));
        for (b, &c) in columns.iter().enumerate().skip(done) {
            let column = tableau.column(c);
            for (a, &r) in rows.iter().enumerate().skip(done) {
                let size = column[r].abs();
                if size > pivot {
                    (pivot, place) = (size, (a, b));
                }
            }
        }
        if done == 0 {
            largest = pivot;
        }
        if pivot <= SINGULAR * largest {
            return border(tableau, resting, &mut rows[done..], &mut columns[done..]);
        }
        rows.swap(done, place.0);
        columns.swap(done, place.1);
        drive_to_zero(tableau, resting, rows[done], columns[done]);
    }
    true
}

/// Makes the free variables of `rows` and `columns`, whose common block is zero, basic together with bounded
/// variables.
fn border(tableau: &mut Tableau, resting: &Resting, rows: &mut [usize], columns: &mut [usize]) -> bool {
    let m = tableau.m;
    for done in 0..rows.len() {
        let (mut largest, mut best) = (SINGULAR, None);
        for i in 0..m {
            let Some((row, column)) = open_row(tableau, i) else { continue };
            if rows.contains(&row) || columns.contains(&column) {
                continue;
            }
            let argmax = |sizes: &mut dyn Iterator<Item = f64>| {
                sizes.enumerate().fold((done, 0.0), |best, (k, x)| if x > best.1 { (done + k, x) } else { best })
            };
            let (a, in_column) = argmax(&mut rows[done..].iter().map(|&r| tableau.entry(r, column).abs()));
            let (b, in_row) = argmax(&mut columns[done..].iter().map(|&c| tableau.entry(row, c).abs()));
            if in_column * in_row > largest {
                (largest, best) = (in_column * in_row, Some((a, b, row, column)));
            }
        }
        let Some((a, b, row, column)) = best else {
            return rows[done..].iter().all(|&r| is_redundant(tableau, r));
        };
        rows.swap(done, a);
        columns.swap(done, b);
        drive_to_zero(tableau, resting, row, columns[done]);
        drive_to_zero(tableau, resting, rows[done], column);
    }
    true
}

/// Whether the equation `w_r = 0` holds whatever the values of the nonbasic `z` are.
fn is_redundant(tableau: &Tableau, r: usize) -> bool {
    let m = tableau.m;
    let disturbs = |c: usize| tableau.nonbasic[c] < m && tableau.entry(r, c).abs() > SINGULAR;
    tableau.value[r].abs() <= NOISE * tableau.magnitude[r] && !(0..m).any(disturbs)
}

/// Makes the bounded variables that are guessed to be `inside` their intervals basic, as far as their block is
/// regular; the others stay nonbasic.
pub(super) fn enter_inside(tableau: &mut Tableau, resting: &Resting, inside: &mut Vec<usize>) {
    let m = tableau.m;
    inside.retain(|&i| open_row(tableau, i).is_some());
    let mut largest = 0.0_f64;
    while !inside.is_empty() {
        let size = |i: usize, j: usize| match (tableau.row_of(m + i), tableau.column_of(j)) {
            (Some(r), Some(c)) => tableau.entry(r, c).abs(),
            _ => 0.0,
        };
        let (mut a, mut b, mut pivot) = (0, 0, 0.0);
        for (k, &i) in inside.iter().enumerate() {
            let diagonal = size(i, i);
            if diagonal > pivot {
                (a, b, pivot) = (k, k, diagonal);
            }
        }
        let in_column = inside.iter().fold(0.0_f64, |x, &i| x.max(size(i, inside[b])));
        if pivot <= WEAK_DIAGONAL * in_column.max(largest) {
            for (k, &i) in inside.iter().enumerate() {
                for (l, &j) in inside[..k].iter().enumerate() {
                    let product = (size(i, j) * size(j, i)).sqrt();
                    if product > pivot {
                        (a, b, pivot) = (k, l, product);
                    }
                }
            }
        }
        if pivot <= SINGULAR * largest || pivot == 0.0 {
            return;
        }
        largest = largest.max(pivot);
        let (i, j) = (inside[a], inside[b]);
        for (i, j) in [(i, j), (j, i)].into_iter().take(if a == b { 1 } else { 2 }) {
            if let (Some(r), Some(c)) = (tableau.row_of(m + i), tableau.column_of(j)) {
                drive_to_zero(tableau, resting, r, c);
            }
        }
        inside.swap_remove(a.max(b));
        if a != b {
            inside.swap_remove(a.min(b));
        }
    }
}
