//! Variations of the data within a step that its beginning, stage and end miss: no error estimate detects a pulse of
//! a coefficient, of the source or of a bound between the beginning, the stage and the end of a step.
//!
//! Each datum that depends on time is enclosed over the step, at every place where the equations use it. Unless the
//! enclosure shows that the values at these three times [represent](numerics::is_seen) the datum over the step, the
//! step is bisected, the part with the widest enclosure first, until the contribution of the undecided parts is
//! negligible. The deviation of the datum from the parabola through its three values is integrated over time,
//! separately for positive and negative deviations. The integral is a change of the operator or of the load, and
//! displaces nodes accordingly. Dirichlet values displace their nodes by the deviation itself, and obstacles by the
//! depth to which the parabola of `u` lies beyond them.

use super::hidden::Seen;
use super::semidiscrete::go_on;
use super::{Condition, Field, Obstacle, ObstacleError, Semidiscrete};
use crate::finite_elements::{Element, Face, Quadrature, Side};
use nalgebra::DMatrix;
use numerics::{Interval, is_seen};
use problem::Control;

/// Maximum number of bisections of a step, for one time-dependent datum at one place. The parts of the step whose
/// values then still do not represent the datum contribute the width of its enclosure.
const PARTS: usize = 64;

/// Largest deviation of a datum from the parabola through its values at the beginning, the stage and the end of a
/// step, relative to the range of these values, that is ignored: the error estimate bounds the effect of smaller
/// deviations.
const SHOWN: f64 = 0.1;

/// A datum of the obstacle problem: a coefficient, the source, a boundary value or an obstacle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Datum {
    Source,
    Reaction,
    Diffusion(usize),
    Advection(usize),
    Flux(Side),
    Given(Side),
    Lower,
    Upper,
}

/// The search of one run for variations in time of the problem's data (coefficients, source, boundary values,
/// obstacles) that the steps miss.
pub struct Unseen {
    /// The data of the obstacle problem that depend on time.
    data: Vec<Datum>,
    /// The fraction of the step at which the first variation of the data begins that the values at the beginning, the
    /// stage and the end of the step miss; `None` if none is found.
    pub begin: Option<f64>,
}

/// A part of a step in which the values at the beginning, the stage and the end do not represent a time-dependent datum
/// closely enough.
struct Part {
    from: f64,
    to: f64,
    range: Interval,
    /// A bound on the effect of the datum's variation in this part of the step.
    size: f64,
}

/// Samples of a time-dependent datum in the parts of a step where the values at three times represent it, and the parts
/// where they do not.
struct Course {
    shown: Vec<([f64; 3], [f64; 3])>,
    open: Vec<Part>,
}

/// The time integrals of the deviations of a datum from the parabola through its values at the beginning, the stage and
/// the end of the step: upwards and downwards.
#[derive(Clone, Copy, Default)]
struct Missed {
    above: f64,
    below: f64,
}

impl Unseen {
    /// Collects the data of the obstacle problem that depend on time.
    pub fn new(problem: &Obstacle) -> Self {
        let Obstacle { diffusion, advection, reaction, source, lower, upper, conditions, grid, .. } = problem;
        let single = [
            (Datum::Source, source.as_ref()),
            (Datum::Reaction, reaction.as_ref()),
            (Datum::Lower, lower.as_ref()),
            (Datum::Upper, upper.as_ref()),
        ];
        let single = single.into_iter().filter_map(|(datum, field)| Some((datum, field?)));
        let along = diffusion.iter().enumerate().map(|(q, field)| (Datum::Diffusion(q), field));
        let carried = advection.iter().enumerate().map(|(q, field)| (Datum::Advection(q), field));
        let sides = Side::all(grid.dimension()).zip(conditions).map(|(side, condition)| match condition {
            Condition::Dirichlet(field) => (Datum::Given(side), field),
            Condition::Neumann(field) => (Datum::Flux(side), field),
        });
        let all = single.chain(along).chain(carried).chain(sides);
        Self { data: all.filter(|(_, field)| field.varies_in_time()).map(|(datum, _)| datum).collect(), begin: None }
    }

    /// Adds to `moved` the displacements of nodes caused by variations of the data that the step misses;
    /// displacements below `negligible` are not refined.
    ///
    /// # Errors
    /// If `control` asks to stop.
    pub fn bound(
        &mut self,
        system: &mut Semidiscrete,
        seen: &Seen<'_>,
        negligible: f64,
        moved: &mut [f64],
        control: &Control,
    ) -> Result<(), ObstacleError> {
        self.begin = None;
        for k in 0..self.data.len() {
            let datum = self.data[k];
            let open = open_places(&mut system.problem, datum, seen.times, control)?;
            if open.is_empty() {
                continue;
            }
            match datum {
                Datum::Given(side) => self.given(system, side, &open, seen, negligible, moved),
                Datum::Lower | Datum::Upper => self.bounds(system, (datum, &open), seen, negligible, moved, control)?,
                _ => self.forces(system, (datum, &open), seen, negligible, moved, control)?,
            }
        }
        Ok(())
    }

    fn begins(&mut self, times: [f64; 3], at: f64) {
        let part = (at - times[0]) / (times[2] - times[0]);
        self.begin = Some(self.begin.map_or(part, |begin| begin.min(part)));
    }

    /// Adds to the displacements `moved` the deviations of Dirichlet values on a side from the parabolas through their
    /// values at the beginning, the stage and the end of the step.
    fn given(
        &mut self,
        system: &mut Semidiscrete,
        side: Side,
        open: &[usize],
        seen: &Seen<'_>,
        negligible: f64,
        moved: &mut [f64],
    ) {
        let nodes: Vec<usize> = system.problem.grid.nodes_on(side).collect();
        let varies = field(&mut system.problem, Datum::Given(side)).is_some_and(|field| field.varies_in_space());
        for &place in open {
            let at = system.problem.grid.coordinates(nodes[place]);
            let Some(field) = field(&mut system.problem, Datum::Given(side)) else { return };
            let known = seen.times.map(|t| field.at(t, at));
            let course = Course::of(field, at, seen.times, negligible, |_| 1.0);
            let by = course.deviations(seen, known, |from, off| {
                if off.abs() > negligible {
                    self.begins(seen.times, from);
                }
            });
            let concerned = if varies { &nodes[place..=place] } else { &nodes[..] };
            concerned.iter().for_each(|&node| moved[node] += by);
        }
    }

    /// Raises the displacements `moved` to the depths to which the parabolas through nodal values lie beyond an
    /// obstacle.
    fn bounds(
        &mut self,
        system: &mut Semidiscrete,
        (datum, open): (Datum, &[usize]),
        seen: &Seen<'_>,
        negligible: f64,
        moved: &mut [f64],
        control: &Control,
    ) -> Result<(), ObstacleError> {
        let sign = if datum == Datum::Lower { 1.0 } else { -1.0 };
        let high = |range: Interval| if sign > 0.0 { range.hi } else { -range.lo };
        let least = |node: usize, from: f64, to: f64| {
            let values = seen.values.map(|values| sign * values[node]);
            let [a, b] = [from, to].map(|t| seen.parabola(t, values));
            let bend = 2.0 * (a + b - 2.0 * seen.parabola(0.5 * (from + to), values));
            a.min(b) - 0.25 * bend.max(0.0)
        };
        let [begin, _, end] = seen.times;
        let whole = Interval::new(begin, end);
        for &place in open {
            go_on(place, begin, control)?;
            let at = system.problem.grid.coordinates(place);
            let Some(field) = field(&mut system.problem, datum) else { return Ok(()) };
            let concerned = if field.varies_in_space() { place..place + 1 } else { 0..moved.len() };
            let top = high(field.over_time(whole, at));
            let near = |&i: &usize| !system.is_given[i] && least(i, begin, end) < top - negligible;
            let near: Vec<usize> = concerned.filter(near).collect();
            if near.is_empty() {
                continue;
            }
            for node in near {
                let values = seen.values.map(|values| sign * values[node]);
                let possible = |field: &mut Field, from: f64, to: f64| {
                    let top = high(field.over_time(Interval::new(from, to), at));
                    (from, to, top - least(node, from, to))
                };
                let mut parts = vec![possible(field, begin, end)];
                let (mut deepest, mut first) = (0.0_f64, end);
                for _ in 0..PARTS {
                    let Some(worst) = (0..parts.len()).max_by(|&i, &j| parts[i].2.total_cmp(&parts[j].2)) else {
                        break;
                    };
                    let (from, to, depth) = parts[worst];
                    let middle = 0.5 * (from + to);
                    // Stop bisecting the step once a sampled depth is at least a quarter of the bound on the depth,
                    // which is accurate enough to choose the step size.
                    if depth <= negligible.max(4.0 * deepest) || middle <= from || middle >= to {
                        break;
                    }
                    parts.swap_remove(worst);
                    parts.extend([possible(field, from, middle), possible(field, middle, to)]);
                    let bound = high(field.over(Interval::point(middle), &at.map(Interval::point)));
                    let depth = bound - seen.parabola(middle, values);
                    deepest = deepest.max(depth);
                    if depth > negligible {
                        first = first.min(from);
                    }
                }
                let open = parts.iter().filter(|part| part.2.is_finite() && part.2 > negligible.max(4.0 * deepest));
                (deepest, first) =
                    open.fold((deepest, first), |(deepest, first), part| (deepest.max(part.2), first.min(part.0)));
                if deepest > negligible {
                    self.begins(seen.times, first);
                }
                moved[node] = moved[node].max(deepest);
            }
        }
        Ok(())
    }

    /// Adds to the displacements `moved` those caused by changes of the load or of the operator that the step misses.
    fn forces(
        &mut self,
        system: &mut Semidiscrete,
        (datum, open): (Datum, &[usize]),
        seen: &Seen<'_>,
        negligible: f64,
        moved: &mut [f64],
        control: &Control,
    ) -> Result<(), ObstacleError> {
        let shape = Shape::of(&system.problem, datum);
        let times = seen.times;
        let h = times[2] - times[0];
        let values = if shape.is_load() { &seen.values[..1] } else { &seen.values[..] };
        // The largest displacement of a node caused by a unit of the time integral of the datum.
        let unit = values.iter().flat_map(|u| shape.displacements(system, u, |_| 1.0));
        let unit = unit.fold(0.0_f64, |largest, by| largest.max(by.abs()));
        if unit == 0.0 && open.len() == shape.places.len() {
            return Ok(());
        }
        let allowed = if unit > 0.0 { negligible / unit } else { f64::INFINITY };
        let mut missed = vec![Missed::default(); shape.places.len()];
        let mut is_any = false;
        for &place in open {
            go_on(place, times[0], control)?;
            let at = shape.places[place];
            let Some(field) = field(&mut system.problem, datum) else { return Ok(()) };
            let known = times.map(|t| field.at(t, at));
            let course = Course::of(field, at, times, allowed / h, |length| h.min(length) / h);
            let found = course.integrals(seen, known, |from, off| {
                if off > allowed / h {
                    self.begins(times, from);
                }
            });
            is_any |= found.above > 0.0 || found.below > 0.0;
            if field.varies_in_space() {
                missed[place] = found;
            } else {
                missed.fill(found);
            }
        }
        if !is_any {
            return Ok(());
        }
        let mut by = vec![0.0_f64; moved.len()];
        for u in values {
            let upwards = shape.displacements(system, u, |place| missed[place].above);
            let downwards = shape.displacements(system, u, |place| -missed[place].below);
            for (node, by) in by.iter_mut().enumerate() {
                let held = seen.moments.each_ref().map(|moment| moment.held[node]);
                let rests = held[0] != 0 && held == [held[0]; 3];
                for way in [upwards[node], downwards[node]] {
                    let counts = match (rests, shape.is_load()) {
                        (true, true) => 0.0,
                        (true, false) => (f64::from(held[0]) * way).max(0.0),
                        (false, _) => way.abs(),
                    };
                    *by = by.max(counts);
                }
            }
        }
        moved.iter_mut().zip(&by).for_each(|(moved, by)| *moved += by);
        Ok(())
    }
}

/// Returns the places at which the values of a datum at the beginning, the stage and the end of a step do not represent
/// it over the step; only the first place if the datum does not vary in space.
fn open_places(
    problem: &mut Obstacle,
    datum: Datum,
    times: [f64; 3],
    control: &Control,
) -> Result<Vec<usize>, ObstacleError> {
    let grid = problem.grid.clone();
    let Some(field) = field(problem, datum) else { return Ok(Vec::new()) };
    let places: Box<dyn Iterator<Item = [f64; 3]>> = match datum {
        Datum::Flux(side) => Box::new(grid.faces_on(side).map(|face| face.centre)),
        Datum::Given(side) => Box::new(grid.nodes_on(side).map(|node| grid.coordinates(node))),
        Datum::Lower | Datum::Upper => Box::new((0..grid.nodes()).map(|node| grid.coordinates(node))),
        _ => Box::new((0..grid.elements()).map(|element| grid.centre(element))),
    };
    let most = if field.varies_in_space() { usize::MAX } else { 1 };
    let mut open = Vec::new();
    for (place, at) in places.take(most).enumerate() {
        go_on(place, times[0], control)?;
        let values = times.map(|t| field.at(t, at));
        let range = field.over_time(Interval::new(times[0], times[2]), at);
        let rounding = f64::EPSILON * range.size();
        if !is_seen(range, values, if rounding.is_finite() { 8.0 * rounding } else { 0.0 }) {
            open.push(place);
        }
    }
    Ok(open)
}

fn field(problem: &mut Obstacle, datum: Datum) -> Option<&mut Field> {
    match datum {
        Datum::Source => problem.source.as_mut(),
        Datum::Reaction => problem.reaction.as_mut(),
        Datum::Diffusion(q) => problem.diffusion.get_mut(q),
        Datum::Advection(q) => problem.advection.get_mut(q),
        Datum::Lower => problem.lower.as_mut(),
        Datum::Upper => problem.upper.as_mut(),
        Datum::Flux(side) | Datum::Given(side) => match problem.conditions.get_mut(side.place())? {
            Condition::Dirichlet(field) | Condition::Neumann(field) => Some(field),
        },
    }
}

impl Course {
    /// Samples and encloses a datum over a step, and bisects the step until the effect of the undecided parts is at
    /// most `allowed` in all, or the limit on bisections is reached. `part` maps the length of a part of the step to
    /// the factor by which the width of the enclosure over that part is multiplied.
    fn of(field: &mut Field, at: [f64; 3], times: [f64; 3], allowed: f64, part: impl Fn(f64) -> f64) -> Self {
        let mut course = Self { shown: Vec::new(), open: Vec::new() };
        let [begin, _, end] = times;
        course.look(field, at, (begin, end), allowed, &part);
        for _ in 0..PARTS {
            let all: f64 = course.open.iter().map(|part| part.size).sum();
            let sizes = course.open.iter().map(|part| part.size).enumerate();
            let Some((widest, _)) = sizes.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|_| all > allowed) else {
                break;
            };
            let Part { from, to, .. } = course.open[widest];
            let middle = 0.5 * (from + to);
            if middle <= from || middle >= to {
                break;
            }
            course.open.swap_remove(widest);
            for half in [(from, middle), (middle, to)] {
                course.look(field, at, half, allowed, &part);
            }
        }
        course
    }

    fn look(
        &mut self,
        field: &mut Field,
        at: [f64; 3],
        (from, to): (f64, f64),
        allowed: f64,
        part: &impl Fn(f64) -> f64,
    ) {
        let times = [from, 0.5 * (from + to), to];
        let values = times.map(|t| field.at(t, at));
        let range = field.over_time(Interval::new(from, to), at);
        if is_seen(range, values, allowed) {
            self.shown.push((times, values));
        } else {
            let width = range.width();
            let size = if width.is_nan() { f64::INFINITY } else { width * part(to - from) };
            self.open.push(Part { from, to, range, size });
        }
    }

    /// Returns the deviation of a datum's value from the parabola through its values at the beginning, the stage and
    /// the end of the step; zero if it is a small fraction of the range of these values.
    fn off(seen: &Seen<'_>, known: [f64; 3], t: f64, value: f64) -> f64 {
        let [least, most] = [f64::min, f64::max].map(|of| known.into_iter().fold(known[0], of));
        let off = value - seen.parabola(t, known);
        if off.abs() > SHOWN * (most - least) { off } else { 0.0 }
    }

    /// Returns the largest deviation of the datum from the parabola through its three known values; `visit` is called
    /// with the beginning of each part of the step and the deviation in that part.
    fn deviations(&self, seen: &Seen<'_>, known: [f64; 3], mut visit: impl FnMut(f64, f64)) -> f64 {
        let mut largest = 0.0_f64;
        for (times, values) in &self.shown {
            for (&t, &value) in times.iter().zip(values) {
                let off = Self::off(seen, known, t, value).abs();
                visit(times[0], off);
                largest = largest.max(off);
            }
        }
        for part in self.open.iter().filter(|part| part.size.is_finite()) {
            visit(part.from, part.range.width());
            largest = largest.max(part.range.width());
        }
        largest
    }

    /// Returns the time integrals of the deviations of the datum from the parabola through its three known values;
    /// `visit` is called with the beginning of each part of the step and the deviation in that part.
    fn integrals(&self, seen: &Seen<'_>, known: [f64; 3], mut visit: impl FnMut(f64, f64)) -> Missed {
        let mut missed = Missed::default();
        for (times, values) in &self.shown {
            let length = times[2] - times[0];
            for ((&t, &value), weight) in times.iter().zip(values).zip([0.25, 0.5, 0.25]) {
                let off = Self::off(seen, known, t, value);
                visit(times[0], off.abs());
                missed.above += weight * length * off.max(0.0);
                missed.below += weight * length * (-off).max(0.0);
            }
        }
        for part in self.open.iter().filter(|part| part.size.is_finite()) {
            let width = part.range.width();
            visit(part.from, width);
            let by = width * (part.to - part.from);
            (missed.above, missed.below) = (missed.above + by, missed.below + by);
        }
        missed
    }
}

/// The places where a datum of the obstacle problem is evaluated, and how its values act on the nodes.
struct Shape {
    places: Vec<[f64; 3]>,
    action: Action,
}

enum Action {
    /// The datum at the centre of an element is a load; each corner of the element receives this share of its value.
    Elements(f64),
    /// The datum at the centre of a face is a load; each node of the face receives this share of its value.
    Faces(f64, Vec<Face>),
    /// The datum is a coefficient: its value times an element matrix acts on `-u`.
    Matrix(DMatrix<f64>),
}

impl Shape {
    fn of(problem: &Obstacle, datum: Datum) -> Self {
        let grid = &problem.grid;
        let element = Element::of(grid, problem.quadrature);
        let centres = || (0..grid.elements()).map(|element| grid.centre(element)).collect();
        match datum {
            Datum::Flux(side) => {
                let faces: Vec<Face> = grid.faces_on(side).collect();
                let share = grid.face_area(side) / (1 << (grid.dimension() - 1)) as f64;
                Self { places: faces.iter().map(|face| face.centre).collect(), action: Action::Faces(share, faces) }
            }
            Datum::Reaction => Self { places: centres(), action: Action::Matrix(element.mass()) },
            Datum::Diffusion(q) => Self { places: centres(), action: Action::Matrix(element.gradients(q, q)) },
            Datum::Advection(q) => Self { places: centres(), action: Action::Matrix(element.derivative(q)) },
            _ => {
                let share = Element::of(grid, Quadrature::Nodal).volume() / (1 << grid.dimension()) as f64;
                Self { places: centres(), action: Action::Elements(share) }
            }
        }
    }

    fn is_load(&self) -> bool {
        !matches!(self.action, Action::Matrix(_))
    }

    /// Returns the displacements of all nodes that a change of the datum causes; `of` gives the time integral of the
    /// change at each place where the datum is evaluated.
    fn displacements(&self, system: &Semidiscrete, u: &[f64], of: impl Fn(usize) -> f64) -> Vec<f64> {
        let grid = &system.problem.grid;
        let mut forces = vec![0.0; u.len()];
        match &self.action {
            Action::Elements(share) => {
                for element in 0..self.places.len() {
                    grid.corners(element).for_each(|node| forces[node] += share * of(element));
                }
            }
            Action::Faces(share, faces) => {
                for (place, face) in faces.iter().enumerate() {
                    face.nodes.iter().for_each(|&node| forces[node] += share * of(place));
                }
            }
            Action::Matrix(matrix) => {
                for element in 0..self.places.len() {
                    let amount = of(element);
                    if amount == 0.0 {
                        continue;
                    }
                    for (a, row) in grid.corners(element).enumerate() {
                        for (b, column) in grid.corners(element).enumerate() {
                            forces[row] -= amount * matrix[(a, b)] * u[column];
                        }
                    }
                }
            }
        }
        for (i, force) in forces.iter_mut().enumerate() {
            *force = if system.is_given[i] { 0.0 } else { *force / system.weights[i] };
        }
        forces
    }
}
