//! Thinning of a line to the points that a plot can show: the first, lowest, highest and last point in each column of
//! pixels. The line through these points covers the same pixels as the line through all points (U. Jugel et al., "M4:
//! a visualization-oriented time series data aggregation", VLDB 2014, section 4), so that every spike is kept.

/// A point of a plot, in pixels.
pub type Point = (f64, f64);

/// Returns the points of a line from left to right that must be drawn: at most four in each column of pixels.
pub fn thin(points: impl IntoIterator<Item = Point>) -> Vec<Point> {
    let mut kept = Vec::new();
    let mut column: Option<Column> = None;
    for (index, point) in points.into_iter().enumerate() {
        match &mut column {
            Some(column) if column.number == point.0.floor() => column.take(index, point),
            _ => {
                if let Some(full) = column.replace(Column::of(index, point)) {
                    full.give(&mut kept);
                }
            }
        }
    }
    if let Some(last) = column {
        last.give(&mut kept);
    }
    kept
}

/// The first, lowest, highest and last point in a column of pixels, each with its index in the line.
struct Column {
    number: f64,
    first: (usize, Point),
    lowest: (usize, Point),
    highest: (usize, Point),
    last: (usize, Point),
}

impl Column {
    fn of(index: usize, point: Point) -> Self {
        let only = (index, point);
        Self { number: point.0.floor(), first: only, lowest: only, highest: only, last: only }
    }

    fn take(&mut self, index: usize, point: Point) {
        self.last = (index, point);
        if point.1 < self.lowest.1.1 {
            self.lowest = self.last;
        }
        if point.1 > self.highest.1.1 {
            self.highest = self.last;
        }
    }

    fn give(self, kept: &mut Vec<Point>) {
        let mut four = [self.first, self.lowest, self.highest, self.last];
        four.sort_by_key(|(index, _)| *index);
        let mut before = None;
        for (index, point) in four {
            if before.replace(index) != Some(index) {
                kept.push(point);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_points_stay_as_they_are() {
        let points = [(0.0, 5.0), (0.2, 1.0), (0.4, 9.0), (0.6, 2.0), (7.5, 3.0)];
        assert_eq!(thin(points), points);
        assert_eq!(thin([]), []);
    }

    #[test]
    fn a_spike_among_a_million_points_stays_where_it_was() {
        let height = |k: i32| if k == 654_321 { 40.0 } else { f64::from(k % 7) };
        let kept = thin((0..1_000_000).map(|k| (f64::from(k) / 1e6 * 600.0, height(k))));
        assert!(kept.len() <= 2400, "{}", kept.len());
        assert!(kept.contains(&(0.654_321 * 600.0, 40.0)));
        assert!(kept.is_sorted_by(|a, b| a.0 <= b.0));
        assert_eq!(kept.last().map(|point| point.0), Some(0.999_999 * 600.0));
    }
}
