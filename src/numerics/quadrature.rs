//! Gauss-Kronrod quadrature with 7 and 15 points (Piessens and others 1983, *QUADPACK*): the Kronrod rule is exact
//! for polynomials up to degree 22, the Gauss rule on seven of its points up to degree 13.

/// A point of the Kronrod rule on `[-1, 1]` with its weights in both rules.
struct Point {
    at: f64,
    kronrod: f64,
    gauss: f64,
}

const fn point(at: f64, kronrod: f64, gauss: f64) -> Point {
    Point { at, kronrod, gauss }
}

/// The Kronrod points from the middle to the right end of `[-1, 1]`; the others are their mirror images.
const HALF: [Point; 8] = [
    point(0.0, 0.209_482_141_084_727_83, 0.417_959_183_673_469_4),
    point(0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0),
    point(0.405_845_151_377_397_2, 0.190_350_578_064_785_4, 0.381_830_050_505_118_9),
    point(0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
    point(0.741_531_185_599_394_4, 0.140_653_259_715_525_92, 0.279_705_391_489_276_67),
    point(0.864_864_423_359_769_1, 0.104_790_010_322_250_18, 0.0),
    point(0.949_107_912_342_758_5, 0.063_092_092_629_978_55, 0.129_484_966_168_869_7),
    point(0.991_455_371_120_812_6, 0.022_935_322_010_529_224, 0.0),
];

/// Returns the Kronrod points in `[from, to]`, in increasing order, each with its Kronrod weight and the difference
/// between its Kronrod and its Gauss weight.
pub fn kronrod(from: f64, to: f64) -> impl Iterator<Item = (f64, f64, f64)> {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    let before = HALF.iter().skip(1).rev().map(|point| (-point.at, point));
    before
        .chain(HALF.iter().map(|point| (point.at, point)))
        .map(move |(at, point)| (middle + half * at, half * point.kronrod, half * (point.kronrod - point.gauss)))
}

/// The distance from the last Kronrod point of an interval to the end of the interval, relative to its length.
pub const KRONROD_GAP: f64 = 0.5 * (1.0 - HALF[7].at);

/// Returns, for each point of [`kronrod`] in order, the weights of its value in the extrapolation by the
/// interpolating polynomial to the beginning and to the end of the interval. A kink between the last point and the
/// end shows in no quadrature rule, but in the value at the end.
pub fn kronrod_ends() -> impl Iterator<Item = [f64; 2]> {
    (0..TO_END.len()).map(|i| [TO_END[TO_END.len() - 1 - i], TO_END[i]])
}

/// The Lagrange polynomials of the Kronrod points, in increasing order of the points, evaluated at 1.
const TO_END: [f64; 15] = {
    let mut at = [0.0; 15];
    let mut i = 0;
    while i < 8 {
        (at[7 - i], at[7 + i]) = (-HALF[i].at, HALF[i].at);
        i += 1;
    }
    let mut weights = [1.0; 15];
    let mut i = 0;
    while i < 15 {
        let mut j = 0;
        while j < 15 {
            if j != i {
                weights[i] *= (1.0 - at[j]) / (at[i] - at[j]);
            }
            j += 1;
        }
        i += 1;
    }
    weights
};

#[cfg(test)]
mod tests {
    use super::{kronrod, kronrod_ends};

    #[test]
    fn polynomials_up_to_degree_14_are_extended_to_both_ends() {
        for degree in 0..=14 {
            let values = kronrod(0.5, 2.0)
                .zip(kronrod_ends())
                .fold([0.0; 2], |sums, ((t, ..), weights)| [0, 1].map(|end| sums[end] + weights[end] * t.powi(degree)));
            for (value, exact) in values.into_iter().zip([0.5_f64.powi(degree), 2.0_f64.powi(degree)]) {
                assert!((value - exact).abs() < 1e-13 * 2.0_f64.powi(degree), "{degree}: {value} instead of {exact}");
            }
        }
    }

    #[test]
    fn polynomials_up_to_degree_22_are_integrated_exactly_and_both_rules_agree_up_to_13() {
        let monomial = |degree: i32| {
            kronrod(0.5, 2.0).fold((0.0, 0.0), |(sum, difference), (t, weight, excess)| {
                (sum + weight * t.powi(degree), difference + excess * t.powi(degree))
            })
        };
        for degree in 0..=22 {
            let exact = (2.0_f64.powi(degree + 1) - 0.5_f64.powi(degree + 1)) / f64::from(degree + 1);
            let (sum, difference) = monomial(degree);
            assert!((sum / exact - 1.0).abs() < 1e-14, "{degree}: {sum} instead of {exact}");
            assert_eq!(difference.abs() < 1e-14 * exact, degree <= 13, "{degree}: {difference}");
        }
        let exact = (2.0_f64.powi(31) - 0.5_f64.powi(31)) / 31.0;
        assert!((monomial(30).0 / exact - 1.0).abs() > 1e-14);
        assert!(kronrod(1.0, 2.0).zip(kronrod(1.0, 2.0).skip(1)).all(|(a, b)| a.0 < b.0));
    }
}
