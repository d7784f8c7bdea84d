//! The table of a sweep as a plot. Over one swept name: a line for each collected number. Over two names on a grid: a
//! map of the first collected number, or of modes if a mode word was collected. Over more names: parallel coordinates
//! (A. Inselberg, "The plane with parallel coordinates", 1985).

use super::axis::{Axis, Tick};
use super::elements::{line, plain, tenths, text};
use super::legend::{Legend, mark, polyline};
use super::thinning::{Point, thin};
use super::{LARGE_CHARACTERS, LEFT, LINE_CHARACTERS, RIGHT, WIDTH};
use crate::{Solution, Table, Values};
use svg::Document;
use svg::node::element::{Group, Rectangle, Style, Title};

/// Vertical positions in pixels of the names of the lines, and of the top of the axes below a single row of names.
const NAMES: f64 = 56.0;
const TOP: f64 = 72.0;
/// Heights in pixels of the axes, and of the foot below the axes.
const HEIGHT: f64 = 360.0;
const FOOT: f64 = 62.0;
const TICKS: usize = 8;
/// Largest number of collected numbers of a sweep that are drawn as lines.
const MOST_LINES: usize = 6;
/// Largest number of modes in a map with a colour of their own; rarer modes share one colour.
const MOST_MODES: usize = 11;
/// Largest number of members of a sweep that are drawn as lines in parallel coordinates.
const MOST_PARALLEL: usize = 2000;
/// Largest number of points of a line that are drawn with marks.
const MARKED: usize = 60;
/// Widths in pixels of the colour scale of a map, and of the list of mode words.
const SCALE: f64 = 96.0;
const WORDS: f64 = 210.0;
/// Largest number of characters of a mode word (the text of successive modes); mode words usually differ in their first
/// modes.
const WORD: usize = 28;
/// Number of rectangles of uniform colour that make up the drawn colour scale.
const STEPS: usize = 48;

/// Draws the table of a sweep as an SVG document.
pub fn members(solution: &Solution, table: &Table, label: Option<&str>) -> String {
    let drawn = match (table.swept.as_slice(), grid(table)) {
        ([only], _) => lines(table, only),
        ([_, _], Some(grid)) => map(table, &grid),
        _ => parallel(table),
    };
    let Drawn { group, extra, below } = drawn;
    let floor = TOP + extra + HEIGHT;
    let title = plain(label.unwrap_or("Sweep"), LINE_CHARACTERS);
    let class = if title.chars().count() > LARGE_CHARACTERS { "long title" } else { "title" };
    let mut remarks = vec![format!("{} of {} members", table.rows(), table.members)];
    if table.failed > 0 {
        remarks.push(format!("{} failed", table.failed));
    }
    if !solution.verdict.trusted {
        remarks.push("some are not trusted".to_owned());
    }
    remarks.extend(below);
    Document::new()
        .set("viewBox", (0.0, 0.0, WIDTH, floor + FOOT))
        .set("width", WIDTH)
        .set("height", floor + FOOT)
        .set("role", "img")
        .add(Title::new(title.as_str()))
        .add(Style::new(include_str!("style.css")))
        .add(Rectangle::new().set("class", "paper").set("width", "100%").set("height", "100%").set("rx", 8))
        .add(text(title, class, LEFT, 30.0))
        .add(group)
        .add(text(plain(&remarks.join("; "), LINE_CHARACTERS), "faint", LEFT, floor + 52.0))
        .to_string()
}

/// The main part of the plot of a table, between the title above it and the remarks below it.
struct Drawn {
    group: Group,
    /// Height in pixels of all rows of the legend but the first, by which the plot is higher.
    extra: f64,
    below: Option<String>,
}

/// Two axes of a plot of a sweep, with ticks and labels.
struct Frame {
    x: Axis,
    y: Axis,
    right: f64,
    top: f64,
}

impl Frame {
    fn place(&self, (x, y): Point) -> Point {
        let floor = self.top + HEIGHT;
        (LEFT + self.x.fraction(x) * (self.right - LEFT), floor - self.y.fraction(y) * HEIGHT)
    }

    fn drawn(&self, name_of_x: &str, name_of_y: Option<&str>, has_grid: bool) -> Group {
        let floor = self.top + HEIGHT;
        let mut group = Group::new();
        for Tick { fraction, label } in self.x.ticks(TICKS) {
            let x = LEFT + fraction * (self.right - LEFT);
            if has_grid {
                group = group.add(line("grid", (x, self.top), (x, floor)));
            }
            group = group.add(line("tick", (x, floor), (x, floor + 4.0))).add(text(label, "middle", x, floor + 18.0));
        }
        for Tick { fraction, label } in self.y.ticks(TICKS) {
            let y = floor - fraction * HEIGHT;
            if has_grid {
                group = group.add(line("grid", (LEFT, y), (self.right, y)));
            }
            group = group.add(text(label, "end", LEFT - 8.0, y + 4.0));
        }
        let named = |name: &str, axis: &Axis| {
            let name = plain(name, LINE_CHARACTERS / 2);
            axis.unit().map_or_else(|| name.clone(), |unit| format!("{name}  {unit}"))
        };
        if let Some(name) = name_of_y {
            group = group.add(text(named(name, &self.y), "faint", 12.0, self.top - 8.0));
        } else if let Some(unit) = self.y.unit() {
            group = group.add(text(unit, "faint end", LEFT - 8.0, self.top - 8.0));
        }
        group.add(text(named(name_of_x, &self.x), "faint end", self.right, floor + 36.0))
    }
}

/// Returns the collected columns of the table that contain numbers, with their names.
fn collected(table: &Table) -> Vec<(&str, &Values)> {
    let of =
        |name: &'_ String| Some((table.collected.iter().find(|known| *known == name)?.as_str(), table.column(name)?));
    let numbers = |(_, values): &(&str, &Values)| matches!(values, Values::Numbers(_) | Values::Counts(_));
    table.collected.iter().filter_map(of).filter(numbers).collect()
}

fn lines(table: &Table, over: &str) -> Drawn {
    let shown: Vec<(&str, &Values)> = collected(table).into_iter().take(MOST_LINES).collect();
    let swept = table.column(over);
    let points: Vec<Vec<Point>> = shown
        .iter()
        .map(|(_, values)| {
            let point = |row: usize| Some((swept?.number(row)?, values.number(row)?));
            let mut points: Vec<Point> = (0..table.rows()).filter_map(point).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            points
        })
        .collect();
    let legend = Legend::new(shown.iter().map(|(name, _)| *name), LEFT, RIGHT);
    let all = || points.iter().flatten();
    let frame = Frame {
        x: Axis::spanning(all().map(|point| point.0), 0.0),
        y: Axis::spanning(all().map(|point| point.1), 0.05),
        right: RIGHT,
        top: TOP + legend.extra(),
    };
    let mut group = Group::new().add(legend.drawn(NAMES)).add(frame.drawn(over, None, true));
    for (k, points) in points.iter().enumerate() {
        let placed = thin(points.iter().map(|point| frame.place(*point)));
        group = group.add(polyline(&placed, k));
        if points.len() <= MARKED {
            for point in points {
                group = group.add(mark(frame.place(*point), k, 2.5));
            }
        }
    }
    Drawn { group, extra: legend.extra(), below: None }
}

/// The grid of a sweep over two names: the sorted values of both names.
struct Grid<'t> {
    names: [&'t str; 2],
    values: [Vec<f64>; 2],
    /// The row of the table at each grid point; the second name varies fastest.
    rows: Vec<Option<usize>>,
}

/// Returns the grid of a table with two swept names, if the members form one.
fn grid(table: &Table) -> Option<Grid<'_>> {
    let [a, b] = table.swept.as_slice() else { return None };
    let columns = [table.column(a)?, table.column(b)?];
    let values = columns.map(|column| {
        let mut values: Vec<f64> = (0..table.rows()).filter_map(|row| column.number(row)).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    });
    let places = values[0].len().checked_mul(values[1].len())?;
    // Members at random points have as many distinct values as members, and form no grid.
    if values.iter().any(|values| values.len() < 2) || places as u64 > table.members {
        return None;
    }
    let mut rows = vec![None; places];
    for row in 0..table.rows() {
        let at = |k: usize| {
            let value = columns[k].number(row)?;
            values[k].binary_search_by(|known| known.total_cmp(&value)).ok()
        };
        let (Some(i), Some(j)) = (at(0), at(1)) else { continue };
        rows[i * values[1].len() + j] = Some(row);
    }
    Some(Grid { names: [a, b], values, rows })
}

fn map(table: &Table, grid: &Grid<'_>) -> Drawn {
    let word = table.collected.iter().filter_map(|name| Some((name.as_str(), table.column(name)?)));
    let word = word.into_iter().find(|(_, values)| matches!(values, Values::Words(_)));
    let colours = match (word, collected(table).first()) {
        (Some((name, values)), _) => Colours::of_modes(name, values),
        (None, Some((name, values))) => Colours::of_numbers(name, values),
        (None, None) => {
            return Drawn { group: Group::new(), extra: 0.0, below: Some("no number was collected".to_owned()) };
        }
    };
    let frame = Frame {
        x: Axis::spanning(edges(&grid.values[0]), 0.0),
        y: Axis::spanning(edges(&grid.values[1]), 0.0),
        right: RIGHT - if word.is_some() { WORDS } else { SCALE },
        top: TOP,
    };
    let [x, y] = [0, 1].map(|k| edges(&grid.values[k]));
    let mut group = Group::new();
    for (place, row) in grid.rows.iter().enumerate() {
        let (i, j) = (place / grid.values[1].len(), place % grid.values[1].len());
        let Some(colour) = row.and_then(|row| colours.of(row)) else { continue };
        let ((left, bottom), (right, top)) = (frame.place((x[i], y[j])), frame.place((x[i + 1], y[j + 1])));
        group = group.add(cell((left, top), (right, bottom), &colour));
    }
    group = group.add(frame.drawn(grid.names[0], Some(grid.names[1]), false));
    group = colours.scale(group, frame.right + 16.0, frame.top);
    Drawn { group, extra: 0.0, below: colours.below() }
}

/// Returns the boundaries of the cells of a map around sorted values: the midpoints between the values, and equally far
/// beyond the first and the last value.
fn edges(values: &[f64]) -> Vec<f64> {
    let middle = |pair: &[f64]| pair[0] + 0.5 * (pair[1] - pair[0]);
    let inner: Vec<f64> = values.windows(2).map(middle).collect();
    let (Some(first), Some(last)) = (inner.first(), inner.last()) else { return values.to_vec() };
    let ends = (values[0] - (first - values[0]), values[values.len() - 1] + (values[values.len() - 1] - last));
    std::iter::once(ends.0).chain(inner.iter().copied()).chain([ends.1]).collect()
}

fn cell(from: Point, to: Point, colour: &str) -> Rectangle {
    // Cells of the map are slightly wider than their spacing, to close the gaps between neighbours.
    Rectangle::new()
        .set("x", tenths(from.0))
        .set("y", tenths(from.1))
        .set("width", tenths(to.0 - from.0 + 0.3))
        .set("height", tenths(to.1 - from.1 + 0.3))
        .set("fill", colour)
}

/// The colours of the cells of a map: by numbers, or by modes.
enum Colours<'t> {
    Numbers {
        name: &'t str,
        values: &'t Values,
        axis: Axis,
        ends: (f64, f64),
    },
    /// The modes of the members of a sweep with their numbers of occurrences, the most frequent first.
    Modes {
        name: &'t str,
        values: &'t Values,
        modes: Vec<(&'t str, usize)>,
        others: usize,
    },
}

impl<'t> Colours<'t> {
    fn of_numbers(name: &'t str, values: &'t Values) -> Self {
        let numbers = || (0..values.len()).filter_map(|row| values.number(row));
        let ends = numbers().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        Self::Numbers { name, values, axis: Axis::spanning(numbers(), 0.0), ends }
    }

    fn of_modes(name: &'t str, values: &'t Values) -> Self {
        let mut modes: Vec<(&str, usize)> = Vec::new();
        let mut places = std::collections::HashMap::new();
        for mode in (0..values.len()).filter_map(|row| values.word(row)) {
            let place = *places.entry(mode).or_insert_with(|| {
                modes.push((mode, 0));
                modes.len() - 1
            });
            modes[place].1 += 1;
        }
        // The sort is stable: of equally frequent modes, the first to occur comes first.
        modes.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let others = modes.len().saturating_sub(MOST_MODES);
        modes.truncate(MOST_MODES);
        Self::Modes { name, values, modes, others }
    }

    fn of(&self, row: usize) -> Option<String> {
        match self {
            Self::Numbers { values, axis, ends, .. } => {
                let value = values.number(row)?;
                Some(shade(if ends.0 == ends.1 { 0.5 } else { axis.fraction(value) }))
            }
            Self::Modes { values, modes, .. } => {
                let mode = values.word(row)?;
                Some(modes.iter().position(|(known, _)| *known == mode).map_or_else(|| OTHER.to_owned(), hue))
            }
        }
    }

    /// Draws the colour scale or the list of modes of the map, with its upper left corner at the given position.
    fn scale(&self, group: Group, left: f64, top: f64) -> Group {
        match self {
            Self::Numbers { axis, name, .. } => {
                let step = HEIGHT / STEPS as f64;
                let mut group = (0..STEPS).fold(group, |group, k| {
                    let at = top + HEIGHT - (k + 1) as f64 * step;
                    group.add(cell((left, at), (left + 14.0, at + step), &shade((k as f64 + 0.5) / STEPS as f64)))
                });
                for Tick { fraction, label } in axis.ticks(TICKS) {
                    group = group.add(text(label, "", left + 20.0, top + HEIGHT - fraction * HEIGHT + 4.0));
                }
                let name = plain(name, 14);
                group.add(text(
                    axis.unit().map_or_else(|| name.clone(), |unit| format!("{name} {unit}")),
                    "name",
                    left,
                    top - 8.0,
                ))
            }
            Self::Modes { modes, name, others, .. } => {
                let mut group = group.add(text(plain(name, 14), "name", left, top - 8.0));
                let more = (*others > 0).then(|| (OTHER.to_owned(), format!("{others} others")));
                let named = modes.iter().enumerate().map(|(k, (mode, _))| (hue(k), plain(mode, WORD)));
                for (k, (colour, name)) in named.chain(more).enumerate() {
                    let at = top + 22.0 * k as f64;
                    group = group.add(cell((left, at), (left + 12.0, at + 12.0), &colour));
                    group = group.add(text(name, "", left + 18.0, at + 11.0));
                }
                group
            }
        }
    }

    fn below(&self) -> Option<String> {
        let Self::Modes { modes, others, .. } = self else { return None };
        Some(format!("{} different mode words", modes.len() + others))
    }
}

/// The colour of a map that the rarer modes share.
const OTHER: &str = "#9198a1";

/// Returns the colour of mode number `k` in a map: the colours of Okabe and Ito, then lighter ones.
fn hue(k: usize) -> String {
    const HUES: [&str; MOST_MODES] = [
        "#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#cc79a7", "#f0e442", "#7fb8d8", "#f2cf80", "#80ceb9",
        "#eaae80",
    ];
    HUES[k % HUES.len()].to_owned()
}

/// Returns a colour from dark blue to yellow with uniformly increasing lightness (viridis; S. van der Walt and N.
/// Smith 2015), interpolated between nine colours of this scale.
fn shade(part: f64) -> String {
    const NINE: [[f64; 3]; 9] = [
        [68.0, 1.0, 84.0],
        [71.0, 44.0, 122.0],
        [59.0, 81.0, 139.0],
        [44.0, 113.0, 142.0],
        [33.0, 144.0, 141.0],
        [39.0, 173.0, 129.0],
        [92.0, 200.0, 99.0],
        [170.0, 220.0, 50.0],
        [253.0, 231.0, 37.0],
    ];
    let at = part.clamp(0.0, 1.0) * (NINE.len() - 1) as f64;
    let low = (at as usize).min(NINE.len() - 2);
    let mixed = |k: usize| (NINE[low][k] + (at - low as f64) * (NINE[low + 1][k] - NINE[low][k])).round() as u8;
    format!("#{:02x}{:02x}{:02x}", mixed(0), mixed(1), mixed(2))
}

/// Draws parallel coordinates: a vertical axis for each swept name and each collected number, and a line for each
/// member of the sweep.
fn parallel(table: &Table) -> Drawn {
    let swept = table.swept.iter().filter_map(|name| Some((name.as_str(), table.column(name)?)));
    let axes: Vec<(&str, &Values, Axis)> = swept
        .chain(collected(table))
        .map(|(name, values)| {
            (name, values, Axis::spanning((0..values.len()).filter_map(|row| values.number(row)), 0.0))
        })
        .collect();
    let x = |k: usize| LEFT + (RIGHT - LEFT) * k as f64 / (axes.len().max(2) - 1) as f64;
    let mut group = Group::new();
    let every = table.rows().div_ceil(MOST_PARALLEL).max(1);
    for row in (0..table.rows()).step_by(every) {
        let point = |(k, (_, values, axis)): (usize, &(&str, &Values, Axis))| {
            Some((x(k), TOP + HEIGHT - axis.fraction(values.number(row)?) * HEIGHT))
        };
        let points: Option<Vec<Point>> = axes.iter().enumerate().map(point).collect();
        if let Some(points) = points {
            let of = axes.last().and_then(|(_, values, axis)| Some(axis.fraction(values.number(row)?)));
            group = group.add(
                polyline(&points, 0)
                    .set("style", format!("stroke:{};stroke-width:0.7;opacity:0.6", shade(of.unwrap_or(0.5)))),
            );
        }
    }
    for (k, (name, _, axis)) in axes.iter().enumerate() {
        group = group.add(line("tick", (x(k), TOP), (x(k), TOP + HEIGHT)));
        for Tick { fraction, label } in axis.ticks(5) {
            group = group.add(text(label, "end", x(k) - 4.0, TOP + HEIGHT - fraction * HEIGHT + 4.0));
        }
        let name = axis.unit().map_or_else(|| plain(name, 16), |unit| format!("{} {unit}", plain(name, 16)));
        group = group.add(text(name, "middle", x(k), TOP + HEIGHT + 20.0));
    }
    let below = (every > 1).then(|| format!("one member in {every} is drawn"));
    Drawn { group, extra: 0.0, below }
}
