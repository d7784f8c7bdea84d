//! Groups of any number of coupled inductors, replaced by ideal transformers and inductors that are not coupled.
//!
//! The matrix of the coupling coefficients, with ones on its diagonal, has factors `k = T D T'` with `T` unit lower
//! triangular. With `r_im = T_im sqrt(L_i/L_m)` the winding `i` is a series of transformers and of an inductor of its
//! own,
//!
//! ```text
//! v_i = sum over m < i of r_im u_m + u_i,    u_m = D_m L_m j_m',    j_m = i_m + sum over i > m of r_im i_i
//! ```
//!
//! where `u_m` and `j_m` are voltage and current of the inductor of winding `m`, across which the transformers of
//! later windings have their secondaries. A source of zero volts begins each winding: its current is that of the
//! inductor of the netlist.

use super::NetlistError;
use super::coupling::{Coupling, number};
use crate::circuit::MOST_COMPONENTS;
use crate::circuit::components::{Component, Inductor, Transformer, VoltageSource};
use std::collections::HashMap;

/// Replaces the coupled inductors of a group of couplings by transformers and inductors that are not coupled.
///
/// # Errors
/// An inductor does not exist or has no positive number as its inductance, two are coupled twice, there are too many,
/// or the matrix of the coupling coefficients is not positive semidefinite.
pub(super) fn apply(
    group: &[&Coupling<'_>],
    components: &mut Vec<Component>,
    lines: &mut Vec<usize>,
) -> Result<(), NetlistError> {
    let mut windings: Vec<Inductor> = Vec::new();
    let mut order: HashMap<&String, usize> = HashMap::new();
    for coupling in group {
        for name in &coupling.inductors {
            if order.contains_key(name) {
                continue;
            }
            if let Component::Inductor(inductor) = &components[coupling.place(name, components)?] {
                order.insert(name, windings.len());
                windings.push(inductor.clone());
            }
        }
    }
    let first = group[0].first;
    let n = windings.len();
    let count = n.saturating_mul(n + 3) / 2;
    if count > MOST_COMPONENTS {
        let detail = format!("{n} inductors that are coupled make {count} components");
        let expected = format!("1 to {MOST_COMPONENTS} components");
        return Err(NetlistError::new(first, "number_of_components", detail, &expected));
    }
    let factors = Factors::of(&coefficients(group, &order)?).ok_or_else(|| {
        let names: Vec<String> = windings.iter().map(|winding| format!("`{}`", winding.name)).collect();
        let detail = format!("no inductors can have the coupling coefficients of {} all at once", names.join(", "));
        let expected = "coefficients whose matrix, with ones on its diagonal, is positive semidefinite";
        NetlistError::new(first, "out_of_range", detail, expected)
    })?;
    let henries: Vec<f64> = windings.iter().map(|winding| number(&winding.henries)).collect();
    let ratio = |i: usize, m: usize| factors.t[i][m] * (henries[i] / henries[m]).sqrt();
    for coupling in group {
        // Check all inductors of each coupling statement `K`, since an inductor may occur in several, and the error
        // names the statement.
        let are_positive = coupling
            .inductors
            .iter()
            .all(|name| order.get(name).is_some_and(|&i| henries[i] > 0.0 && henries[i] < f64::INFINITY));
        if !are_positive {
            let detail = format!("the inductances that `{}` couples must be positive numbers", coupling.first.shown());
            return Err(NetlistError::new(coupling.first, "out_of_range", detail, "inductances above 0"));
        }
    }
    let has_starts = windings.iter().any(|winding| winding.amperes.is_some());
    let starts: Vec<f64> = windings.iter().map(|winding| winding.amperes.as_ref().map_or(0.0, number)).collect();

    let mut made = Vec::new();
    // The nodes of the inductor that each winding has apart from its coupling, if it has one.
    let mut own: Vec<(String, String)> = Vec::new();
    for (i, winding) in windings.iter().enumerate() {
        let shares: Vec<(usize, f64)> =
            (0..i).map(|m| (m, ratio(i, m))).filter(|(_, ratio)| ratio.abs() > 0.0).collect();
        let has_own = factors.d[i] > 0.0;
        let parts = 1 + shares.len() + usize::from(has_own);
        let node = |k: usize| match k {
            0 => winding.nodes.0.clone(),
            k if k == parts => winding.nodes.1.clone(),
            k => format!("{}.{k}", winding.name),
        };
        let between = |k: usize| (node(k), node(k + 1));
        made.push(Component::VoltageSource(VoltageSource {
            name: winding.name.clone(),
            nodes: between(0),
            volts: 0.0.into(),
            limits: None,
        }));
        for (k, &(m, ratio)) in shares.iter().enumerate() {
            made.push(Component::Transformer(Transformer {
                name: format!("{}.{}", winding.name, windings[m].name),
                primary: between(1 + k),
                secondary: own[m].clone(),
                ratio: ratio.into(),
            }));
        }
        own.push(between(parts - 1));
        if has_own {
            let current = starts[i] + (i + 1..n).map(|later| ratio(later, i) * starts[later]).sum::<f64>();
            made.push(Component::Inductor(Inductor {
                name: format!("{}.m", winding.name),
                nodes: between(parts - 1),
                henries: (factors.d[i] * henries[i]).into(),
                amperes: has_starts.then(|| current.into()),
            }));
        }
    }
    let mut rest = lines.iter();
    let mut kept = Vec::with_capacity(lines.len() + made.len());
    components.retain(|component| {
        let line = rest.next().copied().unwrap_or(first.line);
        let stays = !matches!(component, Component::Inductor(inductor) if order.contains_key(&inductor.name));
        if stays {
            kept.push(line);
        }
        stays
    });
    kept.extend(made.iter().map(|_| first.line));
    *lines = kept;
    components.extend(made);
    Ok(())
}

/// Returns the symmetric matrix of the coupling coefficients of a group of coupled inductors.
fn coefficients(group: &[&Coupling<'_>], order: &HashMap<&String, usize>) -> Result<Vec<Vec<f64>>, NetlistError> {
    let n = order.len();
    let mut k = vec![vec![0.0_f64; n]; n];
    for (i, row) in k.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    for coupling in group {
        let places: Vec<usize> = coupling.inductors.iter().filter_map(|name| order.get(name).copied()).collect();
        for (at, &i) in places.iter().enumerate() {
            for &j in &places[..at] {
                if k[i][j].abs() > 0.0 {
                    let detail = format!("`{}` couples two inductors that are coupled already", coupling.first.shown());
                    let expected = "each pair of inductors in one coupling";
                    return Err(NetlistError::new(coupling.first, "out_of_range", detail, expected));
                }
                k[i][j] = coupling.k;
                k[j][i] = coupling.k;
            }
        }
    }
    Ok(k)
}

/// The factors `T D T'` of a symmetric matrix with ones on its diagonal (coupling coefficients).
struct Factors {
    t: Vec<Vec<f64>>,
    /// The diagonal of `D`; zero where the diagonal of the Schur complement is zero up to rounding.
    d: Vec<f64>,
}

impl Factors {
    /// Factorises a matrix of coupling coefficients. Returns `None` if it is not positive semidefinite, up to rounding.
    fn of(k: &[Vec<f64>]) -> Option<Self> {
        let n = k.len();
        // Bound on rounding errors: an entry of the Schur complement is a sum of at most n products of at most 1.
        let rounding = 4.0 * n as f64 * f64::EPSILON;
        let mut factors = Self { t: vec![vec![0.0; n]; n], d: vec![0.0; n] };
        for (i, row) in k.iter().enumerate() {
            for (j, entry) in row.iter().enumerate().take(i + 1) {
                let Self { t, d } = &factors;
                let rest = entry - (0..j).map(|m| t[i][m] * d[m] * t[j][m]).sum::<f64>();
                if i == j {
                    if rest < -rounding {
                        return None;
                    }
                    factors.d[i] = if rest > rounding { rest } else { 0.0 };
                    factors.t[i][i] = 1.0;
                } else if factors.d[j] > 0.0 {
                    factors.t[i][j] = rest / factors.d[j];
                } else if rest * rest > rounding {
                    // If a diagonal entry of a positive semidefinite matrix is zero, all entries of its row and
                    // column are zero.
                    return None;
                }
            }
        }
        Some(factors)
    }
}
