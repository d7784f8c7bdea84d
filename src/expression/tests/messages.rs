//! What a user is told, word for word.

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
    assert_message("1..2", "expected an operator or the end, found `.2`; a product is written with `*`");
    assert_message("atan2(x)", "`atan2` takes two arguments, found 1");
    assert_message("min()", "`min` takes two or more arguments, found 0");
    assert_message("1e999", "`1e999` is out of the range of a double, 4.9e-324 to 1.8e308");
    assert_message("x \u{2212} 1", "an expression is written in ASCII, found U+2212");
    assert_message("w", "nothing is called `w` here");
    assert_message("f(x)", "there is no function `f`");
    let long = "a".repeat(1000);
    assert_message(&long, &format!("nothing is called `{}...` here", "a".repeat(40)));
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
