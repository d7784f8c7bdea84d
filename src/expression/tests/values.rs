//! Operator precedence and values of expressions, compared with plain Rust.

use super::{parse, value};
use std::f64::consts::{E, PI};

#[test]
fn operators_bind_as_in_mathematics() {
    let table = [
        ("-2^2", -4.0),
        ("(-2)^2", 4.0),
        ("2^3^2", 512.0),
        ("(2^3)^2", 64.0),
        ("2**3**2", 512.0),
        ("2^-1", 0.5),
        ("2^-2^2", 0.0625),
        ("2^+1", 2.0),
        ("-2^-2", -0.25),
        ("2*-3", -6.0),
        ("2--3", 5.0),
        ("2+-3", -1.0),
        ("--2", 2.0),
        ("+2", 2.0),
        ("-2*3", -6.0),
        ("2-3-4", -5.0),
        ("2-(3-4)", 3.0),
        ("24/4/3", 2.0),
        ("24/(4/3)", 18.0),
        ("24/4*3", 18.0),
        ("2*3^2", 18.0),
        ("2^3*4", 32.0),
        ("2^-1*4", 2.0),
        ("6/2^2", 1.5),
        ("1+2*3", 7.0),
        ("(1+2)*3", 9.0),
        ("1-2*3+4/2", -3.0),
        (" 1\t+\n2\r ", 3.0),
        ("1e-3*1E+3*1e0", 1.0),
        (".5+1.", 1.5),
        ("pow(2, 3)", 8.0),
        ("min(3, 1, 2)", 1.0),
        ("max(3, min(7, 5), 4)", 5.0),
    ];
    for (text, expected) in table {
        assert_eq!(value(text, [0.0; 4]), expected, "{text}");
    }
}

#[test]
fn functions_have_the_values_of_the_standard_library() {
    type Case = (&'static str, fn(f64, f64) -> f64);
    let table: [Case; 23] = [
        ("sin(x)", |x, _| x.sin()),
        ("cos(x)", |x, _| x.cos()),
        ("tan(x)", |x, _| x.tan()),
        ("asin(x)", |x, _| x.asin()),
        ("acos(x)", |x, _| x.acos()),
        ("atan(x)", |x, _| x.atan()),
        ("atan2(x, y)", f64::atan2),
        ("sinh(x)", |x, _| x.sinh()),
        ("cosh(x)", |x, _| x.cosh()),
        ("tanh(x)", |x, _| x.tanh()),
        ("exp(x)", |x, _| x.exp()),
        ("ln(y)", |_, y| y.ln()),
        ("log10(y)", |_, y| y.log10()),
        ("sqrt(y)", |_, y| y.sqrt()),
        ("cbrt(x)", |x, _| crate::cube_root(x)),
        ("abs(x)", |x, _| x.abs()),
        ("sign(x)", |x, _| x.signum()),
        ("min(x, y)", f64::min),
        ("max(x, y)", f64::max),
        ("heaviside(x)", |x, _| if x < 0.0 { 0.0 } else { 1.0 }),
        ("pow(y, x)", |x, y| y.powf(x)),
        ("y^x*pi", |x, y| y.powf(x) * PI),
        ("((1 - x*x)*y - x)/1e-6", |x, y| ((1.0 - x * x) * y - x) / 1e-6),
    ];
    for (text, expected) in table {
        for (x, y) in [(-0.7, 0.3), (0.2, 5.0), (0.9, 1.0)] {
            assert_eq!(value(text, [0.0, x, y, 0.0]), expected(x, y), "{text} at x = {x}, y = {y}");
        }
    }
}

#[test]
fn kinks_take_their_stated_values() {
    assert_eq!(value("sign(x)", [0.0; 4]), 0.0);
    assert_eq!(value("heaviside(x)", [0.0; 4]), 1.0);
    assert_eq!(value("heaviside(t - 2)", [1.9, 0.0, 0.0, 0.0]), 0.0);
}

#[test]
fn conditions_bind_as_in_logic() {
    for (text, expected) in [
        ("if(1 < 2, 3, 4)", 3.0),
        ("if(2 < 1, 3, 4)", 4.0),
        ("if(2 <= 2 and 2 >= 2 and 2 == 2, 3, 4)", 3.0),
        ("if(2 < 2 or 2 > 2 or 2 != 2, 3, 4)", 4.0),
        // Precedence of operators: `and` before `or`, `not` before both, comparisons before `not`, sums before
        // comparisons.
        ("if(1 > 2 and 1 > 2 or 2 > 1, 3, 4)", 3.0),
        ("if(2 > 1 or 1 > 2 and 1 > 2, 3, 4)", 3.0),
        ("if((2 > 1 or 1 > 2) and 1 > 2, 3, 4)", 4.0),
        ("if(not 1 > 2 and not 2 > 3, 3, 4)", 3.0),
        ("if(not (1 > 2 or 2 > 1), 3, 4)", 4.0),
        ("if(1 + 1 > 3 - 2, 3, 4)", 3.0),
        ("5*(2 > 1) - (1 > 2)", 5.0),
        ("if(1 > 2, ln(0), 4)", 4.0),
    ] {
        assert_eq!(value(text, [0.0; 4]), expected, "{text}");
    }
    // Evaluation of an operator with inputs as operands agrees with its folding for constants.
    for (x, y) in [(0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (-0.0, 0.0), (f64::MIN_POSITIVE, 0.0), (1.0, 1.0 - 1e-16)] {
        let at = |text: &str| value(text, [0.0, x, y, 0.0]);
        let number = |holds: bool| f64::from(u8::from(holds));
        assert_eq!(at("(x < y)"), number(x < y));
        assert_eq!(at("(x <= y)"), number(x <= y));
        assert_eq!(at("(x > y)"), number(x > y));
        assert_eq!(at("(x >= y)"), number(x >= y));
        assert_eq!(at("(x == y)"), number(x == y));
        assert_eq!(at("(x != y)"), number(x != y));
        assert_eq!(at("if(x > y, 1/(x - y), 7)"), if x > y { 1.0 / (x - y) } else { 7.0 });
    }
}

#[test]
fn functions_that_jump_have_their_values() {
    for x in [-2.5, -1.0, -0.3, 0.0, 0.499_999_999_999_999_94, 0.5, 1.7, 3.0, 1e300] {
        let at = |text: &str| value(text, [0.0, x, 0.0, 0.0]);
        assert_eq!(at("floor(x)"), x.floor());
        assert_eq!(at("ceil(x)"), x.ceil());
        assert_eq!(at("round(x)"), x.round());
    }
    // As in MATLAB and Modelica, the result of `mod` has the sign of the divisor.
    for (text, expected) in
        [("mod(7, 3)", 1.0), ("mod(-7, 3)", 2.0), ("mod(7, -3)", -2.0), ("mod(-7, -3)", -1.0), ("mod(6, 3)", 0.0)]
    {
        assert_eq!(value(text, [0.0; 4]), expected, "{text}");
    }
    let over = |text: &str, times: [f64; 6]| times.map(|t| value(text, [t, 0.0, 0.0, 0.0]));
    let times = [-0.5, 0.0, 0.5, 1.0, 1.5, 2.0];
    assert_eq!(over("pwm(t, 2, 0.25)", times), [0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(over("pwm(t, 2, 0)", times), [0.0; 6]);
    assert_eq!(over("pwm(t, 2, 1)", times), [1.0; 6]);
    assert_eq!(over("pwm(t, 2, t)", times), [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    assert_eq!(over("sawtooth(t, 2)", times), [0.75, 0.0, 0.25, 0.5, 0.75, 0.0]);
    assert_eq!(over("triangle(t, 2)", times), [0.5, 0.0, 0.5, 1.0, 0.5, 0.0]);
    assert_eq!(over("pulse(t, 0.5, 1)", times), [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
    assert_eq!(over("pulse(t, 0.5, 0)", times), [0.0; 6]);
}

#[test]
fn a_name_may_be_that_of_a_function_that_jumps() {
    let (mut graph, mut scope) = super::space();
    scope.bind("floor", graph.input(3)).unwrap();
    let node = graph.parse("floor*floor(2.5) + floor", &scope).unwrap();
    assert_eq!(super::evaluate(&graph, &[node], [0.0, 0.0, 0.0, 4.0]), [12.0]);
}

#[test]
fn nan_passes_through_every_function() {
    let texts = [
        "sin(x)",
        "cos(x)",
        "tan(x)",
        "asin(x)",
        "acos(x)",
        "atan(x)",
        "atan2(x, 1)",
        "atan2(1, x)",
        "sinh(x)",
        "cosh(x)",
        "tanh(x)",
        "exp(x)",
        "ln(x)",
        "log10(x)",
        "sqrt(x)",
        "cbrt(x)",
        "abs(x)",
        "sign(x)",
        "min(x, 1)",
        "min(1, x)",
        "max(x, 1)",
        "max(1, x)",
        "max(1, x, 2)",
        "heaviside(x)",
        "floor(x)",
        "ceil(x)",
        "round(x)",
        "mod(x, 2)",
        "mod(2, x)",
        "(x > 1)",
        "(x != 1)",
        "if(x > 1, 2, 3)",
        "if(x > 1, y, 3)",
        "pwm(x, 1, 0.5)",
        "triangle(x, 1)",
        "pulse(x, 1, 1)",
        "x^3",
        "x^2.5",
        "0*x",
        "x - x",
        "0/x",
    ];
    for text in texts {
        assert!(value(text, [0.0, f64::NAN, 0.0, 0.0]).is_nan(), "{text}");
    }
    assert!(value("0*x", [0.0, f64::INFINITY, 0.0, 0.0]).is_nan());
    assert!(value("0*ln(0)", [0.0; 4]).is_nan());
}

#[test]
fn a_bare_e_belongs_to_the_user() {
    let (mut graph, mut scope) = super::space();
    scope.bind("e", graph.input(3)).unwrap();
    let node = graph.parse("2*e + 1e1", &scope).unwrap();
    assert_eq!(super::evaluate(&graph, &[node], [0.0, 0.0, 0.0, 4.0]), [18.0]);
    assert_eq!(value("exp(1)", [0.0; 4]), E);
}

#[test]
fn equal_subterms_are_computed_once() {
    let (graph, node) = parse("sin(x*y)^2 + sin(y*x)^2 + 3*x - (-3)*x").unwrap();
    // The operations of the compiled expression are: x y, sin, square, sum, 3 x, sum, sum.
    assert_eq!(super::Tape::compile(&graph, &[node]).instructions(), 7);
}

#[test]
fn lanes_have_the_bits_of_single_evaluations() {
    let (mut graph, mut scope) = (super::Graph::new(), super::Scope::new());
    const N: usize = 200;
    for i in 0..N {
        scope.bind(&format!("u{i}"), graph.input(i)).unwrap();
    }
    let mut nodes = Vec::new();
    for i in 1..N - 1 {
        let text = format!(
            "1.7*(u{} - 2*u{i} + u{})/0.3 + exp(-u{i})*max(u{i}, 0.4) + sqrt(u{i}) - u{i}^3/atan2(u{i}, 2)*u{}",
            i - 1,
            i + 1,
            7 * i % N
        );
        nodes.push(graph.parse(&text, &scope).unwrap());
    }
    for row in 0..N - 2 {
        nodes.extend(graph.gradient(nodes[row]).unwrap().into_iter().map(|(_, node)| node));
    }
    let inputs: Vec<f64> = (0..N).map(|i| (0.37 * i as f64).sin().abs() + 0.01).collect();
    let mut together = vec![0.0; nodes.len()];
    super::Tape::compile(&graph, &nodes).evaluate(inputs[0], &inputs[1..], &mut together);
    for (node, together) in nodes.into_iter().zip(together) {
        let mut alone = [0.0];
        super::Tape::compile(&graph, &[node]).evaluate(inputs[0], &inputs[1..], &mut alone);
        assert_eq!(alone[0].to_bits(), together.to_bits());
    }
}
