//! An axis of a plot: the interval of the real line that it shows, its power of ten, and ticks at round numbers.
//!
//! Ticks are at multiples of 1, 2 or 5 times a power of ten (P. S. Heckbert, "Nice numbers for graph labels", Graphics
//! Gems, 1990). Values far from one are shown in units of `10^e` with `e` a multiple of three, which also keeps every
//! intermediate number clear of overflow and underflow, whatever the values.

/// Span of an axis, relative to its values, below which differences count as rounding errors: labels would need too
/// many digits.
const LEAST_RELATIVE_SPAN: f64 = 1e-9;

/// Distance by which a tick may lie beyond the end of an axis, relative to the distance of ticks.
const ROUNDING: f64 = 1e-6;

/// Decimal exponents of the values of an axis whose labels are shown without a power of ten.
const PLAIN: std::ops::RangeInclusive<i32> = -1..=4;

/// The interval of the real line that an axis shows, in units of `10^exponent`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    low: f64,
    high: f64,
    exponent: i32,
}

/// A labelled tick of an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Position of the tick on the axis: 0 at its low end, 1 at its high end.
    pub fraction: f64,
    /// The label of the tick.
    pub label: String,
}

impl Axis {
    /// Creates an axis over all finite `values`, extended at both ends by `margin` times their span.
    pub fn spanning(values: impl IntoIterator<Item = f64>, margin: f64) -> Self {
        let finite = values.into_iter().filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
        let exponent = exponent(low.abs().max(high.abs()));
        let (low, high) = (scaled(low, exponent), scaled(high, exponent));
        let largest = low.abs().max(high.abs());
        let (low, high) = if high - low > LEAST_RELATIVE_SPAN * largest {
            (low - margin * (high - low), high + margin * (high - low))
        } else {
            let around = if largest == 0.0 { 1.0 } else { 0.1 * largest };
            (low - around, high + around)
        };
        Self { low, high, exponent }
    }

    /// Returns the position of `value` on the axis: 0 at the low end, 1 at the high end.
    pub fn fraction(&self, value: f64) -> f64 {
        self.place(scaled(value, self.exponent))
    }

    /// Returns the power of ten by which the labels of the axis are multiplied, such as `×10⁻³`; `None` if it is one.
    pub fn unit(&self) -> Option<String> {
        (self.exponent != 0).then(|| format!("×10{}", raised(self.exponent)))
    }

    /// Returns ticks of the axis at round numbers, in increasing order. The number of intervals between them is near
    /// `about`, and at most half as large again.
    pub fn ticks(&self, about: usize) -> Vec<Tick> {
        let wanted = (self.high - self.low) / about.max(1) as f64;
        let power = wanted.log10().floor();
        let base = 10f64.powf(power);
        let (step, power) = match wanted / base {
            multiple if multiple < 1.5 => (base, power),
            multiple if multiple < 3.0 => (2.0 * base, power),
            multiple if multiple < 7.0 => (5.0 * base, power),
            _ => (10.0 * base, power + 1.0),
        };
        let decimals = (-power).max(0.0) as usize;
        // The ends of an axis are often round numbers, and in floating point `0.3 / 0.1 < 3`.
        let first = (self.low / step - ROUNDING).ceil() as i64;
        let last = (self.high / step + ROUNDING).floor() as i64;
        let tick = |multiple: i64| {
            let value = multiple as f64 * step;
            Tick { fraction: self.place(value), label: format!("{value:.decimals$}").replace('-', "−") }
        };
        (first..=last).map(tick).collect()
    }

    fn place(&self, scaled: f64) -> f64 {
        (scaled - self.low) / (self.high - self.low)
    }
}

/// Formats an exponent in superscript, such as `⁻³`.
pub fn raised(exponent: i32) -> String {
    const SUPERSCRIPTS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let digits = exponent.to_string();
    digits.chars().map(|c| c.to_digit(10).map_or('⁻', |digit| SUPERSCRIPTS[digit as usize])).collect()
}

/// Returns the decimal exponent of the unit of an axis for values up to `largest`.
fn exponent(largest: f64) -> i32 {
    if largest == 0.0 {
        return 0;
    }
    let exponent = largest.log10().floor() as i32;
    if PLAIN.contains(&exponent) { 0 } else { exponent.div_euclid(3) * 3 }
}

/// Returns `value / 10^exponent`, with the power in two factors, each of which is finite even if the whole power is
/// not.
fn scaled(value: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    value * 10f64.powi(-half) * 10f64.powi(half - exponent)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: [f64; 2], about: usize) -> Vec<String> {
        Axis::spanning(values, 0.0).ticks(about).into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn ticks_stand_at_round_numbers_within_the_axis() {
        assert_eq!(labels([0.0, 20.0], 10), ["0", "2", "4", "6", "8", "10", "12", "14", "16", "18", "20"]);
        assert_eq!(labels([-0.73, 1.18], 4), ["−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels([99.2, 100.1], 4), ["99.2", "99.4", "99.6", "99.8", "100.0"]);
        assert_eq!(labels([0.0, 0.3], 3), ["0.0", "0.1", "0.2", "0.3"]);
    }

    #[test]
    fn a_tick_stands_where_its_number_is() {
        let axis = Axis::spanning([-1.0, 3.0], 0.0);
        let fractions: Vec<f64> = axis.ticks(4).iter().map(|tick| tick.fraction).collect();
        assert_eq!(fractions, [0.0, 0.25, 0.5, 0.75, 1.0]);
        assert_eq!(axis.fraction(2.0), 0.75);
    }

    #[test]
    fn what_is_far_from_one_has_a_unit_of_its_own() {
        let small = Axis::spanning([-4e-4, 2e-4], 0.0);
        assert_eq!(small.unit().unwrap(), "×10⁻⁶");
        assert_eq!(
            small.ticks(3).iter().map(|tick| tick.label.as_str()).collect::<Vec<_>>(),
            ["−400", "−200", "0", "200"]
        );
        assert_eq!(Axis::spanning([0.0, 1e11], 0.0).unit().unwrap(), "×10⁹");
        assert_eq!(Axis::spanning([0.0, 12.0], 0.0).unit(), None);
    }

    #[test]
    fn every_double_has_its_place_on_some_axis() {
        for values in [[f64::MIN, f64::MAX], [0.0, 5e-324], [-1e-300, 1e-300], [1e300, 1.1e300], [f64::NAN, 1.0]] {
            let axis = Axis::spanning(values, 0.05);
            for value in values.into_iter().filter(|value| value.is_finite()) {
                assert!((0.0..=1.0).contains(&axis.fraction(value)), "{value:e} on {axis:?}");
            }
            let ticks = axis.ticks(5);
            assert!((3..=8).contains(&ticks.len()), "{ticks:?}");
            assert!(ticks.windows(2).all(|pair| pair[0].label != pair[1].label), "{ticks:?}");
        }
    }

    #[test]
    fn a_constant_lies_in_the_middle_and_rounding_is_not_blown_up() {
        for values in [[0.0, 0.0], [-3.0, -3.0], [5.0, 5.0 + 1e-14], [1e-300, 1e-300]] {
            let axis = Axis::spanning(values, 0.05);
            assert!(values.iter().all(|value| (axis.fraction(*value) - 0.5).abs() < 1e-6), "{values:?} on {axis:?}");
            assert!(axis.ticks(3).iter().all(|tick| tick.label.len() <= 6), "{:?}", axis.ticks(3));
        }
    }
}
