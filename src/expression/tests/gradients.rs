//! Derivatives compared with forward-mode dual numbers, which share no code with the reverse sweep.

use super::{derivatives, evaluate, parse};
use num_dual::{Dual64, DualNum};
use proptest::prelude::*;

#[track_caller]
fn assert_close(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= 1e-9 * (1.0 + expected.abs()), "{what}: {found} instead of {expected}");
}

#[test]
fn every_function_has_its_derivative() {
    type Case = (&'static str, fn(Dual64) -> Dual64);
    let table: [Case; 25] = [
        ("sin(x)", |x| x.sin()),
        ("cos(x)", |x| x.cos()),
        ("tan(x)", |x| x.tan()),
        ("asin(x)", |x| x.asin()),
        ("acos(x)", |x| x.acos()),
        ("atan(x)", |x| x.atan()),
        ("atan2(x, 3)", |x| x.atan2(Dual64::from_re(3.0))),
        ("atan2(3, x)", |x| Dual64::from_re(3.0).atan2(x)),
        ("sinh(x)", |x| x.sinh()),
        ("cosh(x)", |x| x.cosh()),
        ("tanh(x)", |x| x.tanh()),
        ("exp(x)", |x| x.exp()),
        ("ln(x + 1)", |x| (x + 1.0).ln()),
        ("log10(x + 1)", |x| (x + 1.0).log10()),
        ("sqrt(x + 1)", |x| (x + 1.0).sqrt()),
        ("cbrt(x)", |x| x.cbrt()),
        ("x^7", |x| x.powi(7)),
        ("x^-3", |x| x.powi(-3)),
        ("x^20", |x| x.powi(20)),
        ("(x + 1)^2.3", |x| (x + 1.0).powf(2.3)),
        ("(x + 1)^-0.5", |x| (x + 1.0).powf(-0.5)),
        ("3^x", |x| (x * 3f64.ln()).exp()),
        ("(x + 1)^x", |x| (x * (x + 1.0).ln()).exp()),
        ("x/(2 - x)", |x| x / (-x + 2.0)),
        ("-(2 - x)*(x - 3)", |x| -(-x + 2.0) * (x - 3.0)),
    ];
    for (text, function) in table {
        for x in [-0.8, -0.1, 0.3, 0.95] {
            let expected = function(Dual64::from_re(x).derivative()).eps;
            assert_close(derivatives(text, [0.0, x, 0.0, 0.0])[1].unwrap(), expected, &format!("{text} at {x}"));
        }
    }
}

#[test]
fn kinked_functions_have_the_derivative_of_one_branch() {
    let by_x = |text: &str, x: f64| derivatives(text, [0.0, x, 1.0, 0.0])[1].unwrap_or(0.0);
    assert_eq!([-2.0, 0.0, 2.0].map(|x| by_x("abs(x)", x)), [-1.0, 1.0, 1.0]);
    assert_eq!([0.0, 2.0].map(|x| by_x("min(x, y)", x)), [1.0, 0.0]);
    assert_eq!([0.0, 2.0].map(|x| by_x("max(x, y)", x)), [0.0, 1.0]);
    assert_eq!([1.0, 1.8, 4.0].map(|x| by_x("max(3*y, 2*x, x^2)", x)), [0.0, 2.0, 8.0]);
    assert_eq!([-1.0, 1.0].map(|x| by_x("sign(x) + heaviside(x)", x)), [0.0, 0.0]);
    for tied in ["min(x, y)", "max(x, y)"] {
        let [_, by_x, by_y, _] = derivatives(tied, [0.0, 1.0, 1.0, 0.0]);
        assert_eq!(by_x.unwrap() + by_y.unwrap(), 1.0, "{tied} where both are equal");
    }
}

#[test]
fn functions_that_jump_have_the_derivatives_of_their_pieces() {
    let by_x = |text: &str, x: f64| derivatives(text, [0.0, x, 3.0, 0.0])[1].unwrap_or(0.0);
    assert_eq!(by_x("floor(x) + ceil(x) + round(x) + pwm(x, 1, 0.3)", 0.7), 0.0);
    assert_eq!([-4.0, 4.0].map(|x| by_x("mod(x, y)", x)), [1.0, 1.0]);
    // Since 7 = 2*3 + 1, mod(7, y) = 7 - 2 y near y = 3.
    assert_eq!(derivatives("mod(x, y)", [0.0, 7.0, 3.0, 0.0])[2], Some(-2.0));
    assert_eq!([0.2, 0.7, 1.2].map(|x| by_x("triangle(x, 1)", x)), [2.0, -2.0, 2.0]);
    assert_eq!([0.5, 2.0].map(|x| by_x("if(x > 1, x^3, 2*x)", x)), [2.0, 12.0]);
    // In the branch of `if` that is not taken, the square root of a negative number has no derivative.
    assert_eq!([-4.0, 4.0].map(|x| by_x("if(x > 0, sqrt(x), 1)", x)), [0.0, 0.25]);
}

#[test]
fn the_branch_not_taken_leaves_no_infinity() {
    let by_x = |x: f64| derivatives("sqrt(max(x, 0))", [0.0, x, 0.0, 0.0])[1];
    assert_eq!([-1.0, 0.0, 4.0].map(by_x), [Some(0.0), Some(0.0), Some(0.25)]);
    assert_eq!(derivatives("ln(min(1, x))", [0.0, 2.0, 0.0, 0.0])[1], Some(0.0));
}

#[test]
fn powers_are_right_at_zero() {
    let at_zero = |text: &str| derivatives(text, [0.0; 4])[1];
    assert_eq!(at_zero("x^2"), Some(0.0));
    assert_eq!(at_zero("x^3"), Some(0.0));
    assert_eq!(at_zero("x^1"), Some(1.0));
    assert_eq!(at_zero("x^0"), None);
    assert_eq!(at_zero("x^1.5"), Some(0.0));
    assert_eq!(at_zero("x^17"), Some(0.0));
    assert_eq!(at_zero("pow(x, 2)"), Some(0.0));
    assert_eq!(at_zero("x^0.5"), Some(f64::INFINITY));
    // With respect to the exponent: 0^y is constant for y > 0, and for a negative base there is no derivative.
    assert_eq!(derivatives("x^y", [0.0, 0.0, 2.0, 0.0])[2], Some(0.0));
    assert_eq!(derivatives("x^y", [0.0, -2.0, 2.0, 0.0])[2], Some(0.0));
    assert_eq!(derivatives("x^y", [0.0, -2.0, 2.0, 0.0])[1], Some(-4.0));
}

#[test]
fn gradients_have_structural_entries_only() {
    assert_eq!(derivatives("2*x + 0*y + t", [0.0; 4]), [Some(1.0), Some(2.0), None, None]);
    assert_eq!(derivatives("sign(x)*y", [0.0, 3.0, 5.0, 0.0]), [None, None, Some(1.0), None]);
    assert_eq!(derivatives("3", [0.0; 4]), [None; 4]);
    assert_eq!(derivatives("x - x", [0.0; 4]), [None; 4]);
}

#[test]
fn derivatives_may_be_differentiated_again() {
    let (mut graph, node) = parse("x^3*exp(y)/max(x, 1)").unwrap();
    let by_x = graph.gradient(node).unwrap()[0].1;
    let second = graph.gradient(by_x).unwrap();
    let nodes: Vec<_> = second.iter().map(|&(_, node)| node).collect();
    // For `x > 1` the tested expression is `x^2 exp(y)`.
    let found = evaluate(&graph, &nodes, [0.0, 3.0, 0.5, 0.0]);
    assert_close(found[0], 2.0 * 0.5f64.exp(), "by x twice");
    assert_close(found[1], 6.0 * 0.5f64.exp(), "by x, then y");
}

#[test]
fn a_product_of_400_sines_stays_small() {
    let factors: Vec<String> = (1..=400).map(|k| format!("sin({k}*x)")).collect();
    let (mut graph, node) = parse(&factors.join("*")).unwrap();
    let before = graph.len();
    graph.gradient(node).unwrap();
    assert!(graph.len() <= 4 * before, "{} terms from {before}", graph.len());
    // By the product rule at x = 1/2, the derivative is the sum of k cos(k x) / sin(k x) times the product, which
    // does not underflow for twenty factors.
    let (mut graph, node) = parse(&factors[..20].join("*")).unwrap();
    let derivative = graph.gradient(node).unwrap()[0].1;
    let angles = || (1..=20).map(|k| 0.5 * f64::from(k));
    let product: f64 = angles().map(f64::sin).product();
    let logarithmic: f64 = angles().map(|angle| 2.0 * angle / angle.tan()).sum();
    let found = evaluate(&graph, &[derivative], [0.0, 0.5, 0.0, 0.0])[0];
    assert!((found - product * logarithmic).abs() <= 1e-12 * found.abs());
}

/// An expression that can be written as text and evaluated with dual numbers.
#[derive(Clone, Debug)]
enum Tree {
    Input(usize),
    Constant(f64),
    Unary(&'static str, Box<Tree>),
    Binary(&'static str, Box<Tree>, Box<Tree>),
    Power(Box<Tree>, i32),
}

impl Tree {
    fn text(&self) -> String {
        match self {
            Self::Input(index) => ["t", "x", "y", "z"][*index].to_owned(),
            Self::Constant(value) => format!("({value})"),
            Self::Unary("-", a) => format!("(-{})", a.text()),
            Self::Unary(name, a) => format!("{name}({})", a.text()),
            Self::Binary(name @ ("min" | "max" | "atan2"), a, b) => format!("{name}({}, {})", a.text(), b.text()),
            Self::Binary(symbol, a, b) => format!("({} {symbol} {})", a.text(), b.text()),
            Self::Power(a, exponent) => format!("(({})^{exponent})", a.text()),
        }
    }

    /// Evaluates the expression with dual numbers; returns `None` if the value is ill-conditioned: near a pole, a
    /// kink or the end of a domain, or large.
    fn dual(&self, inputs: &[Dual64; 4]) -> Option<Dual64> {
        let away = |x: f64| (x.abs() > 1e-2).then_some(());
        let value = match self {
            Self::Input(index) => inputs[*index],
            Self::Constant(value) => Dual64::from_re(*value),
            Self::Power(a, exponent) => {
                let a = a.dual(inputs)?;
                away(a.re)?;
                a.powi(*exponent)
            }
            Self::Unary(name, a) => {
                let a = a.dual(inputs)?;
                match *name {
                    "-" => -a,
                    "sin" => a.sin(),
                    "cos" => a.cos(),
                    "exp" => a.exp(),
                    "tanh" => a.tanh(),
                    "atan" => a.atan(),
                    "sqrt" if a.re > 1e-2 => a.sqrt(),
                    "ln" if a.re > 1e-2 => a.ln(),
                    "abs" if a.re > 1e-2 => a,
                    "abs" if a.re < -1e-2 => -a,
                    _ => return None,
                }
            }
            Self::Binary(symbol, a, b) => {
                let (a, b) = (a.dual(inputs)?, b.dual(inputs)?);
                match *symbol {
                    "+" => a + b,
                    "-" => a - b,
                    "*" => a * b,
                    "/" => {
                        away(b.re)?;
                        a / b
                    }
                    "^" if a.re > 1e-2 => (b * a.ln()).exp(),
                    "atan2" => {
                        away(a.re)?;
                        away(b.re)?;
                        a.atan2(b)
                    }
                    "min" | "max" => {
                        away(a.re - b.re)?;
                        if (a.re < b.re) == (*symbol == "min") { a } else { b }
                    }
                    _ => return None,
                }
            }
        };
        (value.re.abs() < 1e3 && value.eps.abs() < 1e3).then_some(value)
    }
}

fn trees() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![(0..4usize).prop_map(Tree::Input), (-3.0..3.0).prop_map(Tree::Constant)];
    leaf.prop_recursive(6, 40, 2, |inner| {
        let names = prop::sample::select(vec!["-", "sin", "cos", "exp", "tanh", "atan", "sqrt", "ln", "abs"]);
        let symbols = prop::sample::select(vec!["+", "-", "*", "/", "^", "atan2", "min", "max"]);
        prop_oneof![
            (names, inner.clone()).prop_map(|(name, a)| Tree::Unary(name, Box::new(a))),
            (symbols, inner.clone(), inner.clone()).prop_map(|(symbol, a, b)| Tree::Binary(
                symbol,
                Box::new(a),
                Box::new(b)
            )),
            (inner, -5..=5).prop_map(|(a, exponent)| Tree::Power(Box::new(a), exponent)),
        ]
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_expressions_agree_with_dual_numbers(tree in trees(), point in prop::array::uniform4(0.2..2.0f64)) {
        let text = tree.text();
        let found = derivatives(&text, point);
        for direction in 0..4 {
            let mut inputs = point.map(Dual64::from_re);
            inputs[direction] = inputs[direction].derivative();
            let Some(expected) = tree.dual(&inputs) else { continue };
            let value = super::value(&text, point);
            prop_assert!((value - expected.re).abs() <= 1e-8 * (1.0 + value.abs()), "{text}: {value}");
            let derivative = found[direction].unwrap_or(0.0);
            prop_assert!(
                (derivative - expected.eps).abs() <= 1e-7 * (1.0 + derivative.abs()),
                "{text} by input {direction}: {derivative} instead of {}", expected.eps
            );
        }
    }
}
