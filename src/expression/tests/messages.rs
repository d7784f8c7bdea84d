//! Error messages of expressions, compared verbatim.

use super::parse;

#[track_caller]
fn assert_message(text: &str, message: &str) {
    assert_eq!(parse(text).unwrap_err().message, message);
}

#[test]
fn errors_say_what_was_expected_and_what_was_found() {
    assert_message("", "expected a number, a name or `(`, found the end");
    assert_message("x + * y", "expected a number, a name or `(`, found `*`");
    assert_message("2x", "expected an operator or the end, found `x`; a product is written with `*`");
    assert_message("(x + 1", "expected an operator or `)`, found the end");
    assert_message("(x + 1]", "expected an operator or `)`, found `]`");
    assert_message("max(x; y)", "expected an operator, `,` or `)`, found `;`");
    assert_message("sin x", "expected `(` after the function `sin`, found `x`");
    assert_message("x\0", "expected an operator or the end, found the control character U+0000");
    let range = "expected an operator or the end, found `..2`; a range belongs in a sum: `sum(x[i] for i in 1..n)`";
    assert_message("1..2", range);
    assert_message("atan2(x)", "`atan2` takes two arguments, found 1");
    assert_message("min()", "`min` takes two or more arguments, found 0");
    assert_message("1e999", "`1e999` is out of the range of a double, 4.9e-324 to 1.8e308");
    assert_message("x \u{2212} 1", "an expression is written in ASCII, found U+2212");
    assert_message("w", "there is no name `w` here");
    assert_message("f(x)", "there is no function `f`");
    let long = "a".repeat(1000);
    assert_message(&long, &format!("there is no name `{}...` here", "a".repeat(40)));
}

#[test]
fn what_other_languages_write_is_told_what_is_written_here() {
    for (text, remedy) in [
        ("t > 1 ? 1 : 0", "a choice is written `if(c, a, b)`"),
        ("t % 2", "the remainder of a division is `mod(a, b)`"),
        ("x' + 1", "a derivative is not a term: of an equation, write the right-hand side only"),
        ("x = 1", "a comparison is written `==`; of an equation, write the right-hand side only"),
        ("|x|", "a magnitude is written `abs(v)`"),
        ("2*|x|", "a magnitude is written `abs(v)`"),
        ("-0,1*x", "decimals have a point: `0.1`"),
        ("9.81 m/s^2", "numbers have no units: write all of them in one system, such as SI"),
        ("sin(30deg)", "angles are in radians: `30*pi/180`"),
        ("100u", "numbers have no suffixes: `100e-6`"),
        ("4.7k*x", "numbers have no suffixes: `4.7e3`"),
        ("100 x", "a product is written with `*`"),
        ("if(t > 1 && t < 2, 1, 0)", "conditions are joined by `and`"),
        ("if(t > 1 || t < 2, 1, 0)", "conditions are joined by `or`"),
        ("if(and(t > 1, t < 2), 1, 0)", "`and` and `or` stand between two conditions: `a and b`"),
        ("if(!(t > 1), 1, 0)", "a condition is negated by `not`"),
        ("if(t ~= 1, 1, 0)", "the comparison for not equal is written `a != b`"),
        ("if(t <> 1, 1, 0)", "the comparison for not equal is written `a != b`"),
        ("if(1 < t < 2, 1, 0)", "a chain of comparisons is written `a < b and b < c`"),
        ("(x)[1]", "an index follows the name of a vector: `x[1]`"),
        ("x.sin(1)", "functions are written without a prefix: `sin(x)`"),
    ] {
        let message = parse(text).unwrap_err().message;
        assert!(message.ends_with(&format!("; {remedy}")), "{text}: {message}");
    }
}

#[test]
fn functions_that_jump_say_what_they_take() {
    for (text, message, expected) in [
        ("sawtooth(t)", "`sawtooth` takes two arguments, found 1", "which rises from 0 to 1 in each period"),
        ("pwm(t, 20e-6, 50)", "the duty of `pwm` is 50", "a fraction of the period, from 0 to 1; 50 % is 0.5"),
        ("pulse(0, 5, 0, 1e-9, 1e-9, 1e-6, 2e-6)", "`pulse` takes three arguments, found 7", "pwm(t - start, period"),
        ("mod(x, 0)", "the divisor of `mod` is 0", "a number other than 0"),
        ("x - 2 >= 0", "this is a condition, not a number", "the left side of the inequality only"),
        ("if(x, 1, 2)", "`if` takes conditions, and this is a number", "a comparison, such as `t > 1`"),
    ] {
        let error = parse(text).unwrap_err();
        assert_eq!(error.message, message, "{text}");
        assert!(
            error.expected.as_deref().is_some_and(|found| found.contains(expected)),
            "{text}: {:?}",
            error.expected
        );
    }
}

#[test]
fn what_jumps_with_an_unknown_is_refused_with_the_set_to_write() {
    let (mut graph, mut scope) = super::space();
    scope.solve_for(1);
    for (text, offset, message, expected) in [
        ("1 + if(2*x > y, 1, 2)", 7, "a comparison of `x`", "z in the box [0, 1]"),
        ("floor(t + y)", 0, "`floor` of `y`", "inequality k - a"),
        ("5*pwm(t, 1, z)", 2, "`pwm` of `z`", "the inequality sawtooth(t, T) - d"),
        ("mod(x, 2)", 0, "`mod` of `x`", "`sin` or `cos`"),
    ] {
        let error = graph.parse(text, &scope).unwrap_err();
        assert_eq!((error.code, error.offset), ("jump_of_unknown", offset), "{text}: {}", error.message);
        assert!(error.message.starts_with(message), "{text}: {}", error.message);
        assert!(
            error.expected.as_deref().is_some_and(|found| found.contains(expected)),
            "{text}: {:?}",
            error.expected
        );
    }
    for text in ["if(t > 1, x, y)", "floor(t)*x", "abs(x) + max(x, y)", "pwm(t, 2, 0.5 + 0.1*sin(t))*z", "sign(x)"] {
        assert!(graph.parse(text, &scope).is_ok(), "{text}");
    }
}

#[test]
fn the_nearest_spelling_is_suggested() {
    for (text, suggestion) in [
        ("X + 1", Some("x")),
        ("PI", Some("pi")),
        ("e", Some("exp(1)")),
        ("temperature", None),
        ("sine(x)", Some("sin")),
        ("heavyside(x)", Some("heaviside")),
        ("log(x)", Some("ln")),
        ("arctan(x)", Some("atan")),
        ("foo(x)", None),
        ("square(t)", Some("pwm(t, period, 0.5)")),
        ("interp(t)", Some("a table, under `tables`")),
        ("ceiling(t)", Some("ceil")),
        ("rem(t, 2)", Some("mod")),
        ("x \u{d7} y", Some("*")),
    ] {
        assert_eq!(parse(text).unwrap_err().did_you_mean.as_deref(), suggestion, "{text}");
    }
}

#[test]
fn the_caret_stands_under_the_place() {
    let text = "-k*x - c*v";
    let error = parse(text).unwrap_err();
    assert_eq!(error.caret(text), "-k*x - c*v\n ^");
    let text = "sin(x) + max(x, y z)";
    assert_eq!(parse(text).unwrap_err().caret(text), "sin(x) + max(x, y z)\n                  ^");
}
