//! Invalid texts are rejected with their position, and no text exhausts stack, memory or time.

use super::{Graph, Scope, derivatives, parse, value};
use proptest::prelude::*;
use std::thread;

#[track_caller]
fn assert_refused(text: &str, code: &str, offset: usize) {
    let error = parse(text).unwrap_err();
    assert_eq!((error.code, error.offset), (code, offset), "{}", error.message);
}

/// Runs a test with the stack size of a default thread, as in thread pools.
fn on_two_mebibytes(test: fn()) {
    thread::Builder::new().stack_size(2 << 20).spawn(test).unwrap().join().unwrap();
}

#[test]
fn nesting_of_200_is_read_and_of_201_refused() {
    on_two_mebibytes(|| {
        let nested = |opening: &str, depth: usize| format!("{}x{}", opening.repeat(depth), ")".repeat(depth));
        // For the last two openings the parser also uses a stack frame for each operator `+` or `*`.
        for opening in ["(", "sin(", "max(1, ", "1+1*(", "1+1*sin("] {
            assert!(parse(&nested(opening, 200)).is_ok(), "{opening}");
            assert_eq!(parse(&nested(opening, 201)).unwrap_err().code, "too_deep", "{opening}");
        }
        for (prefix, admitted) in [("-", 200), ("+", 200), ("x^", 200), ("x**", 200), ("x^-", 100)] {
            assert!(parse(&format!("{}x", prefix.repeat(admitted))).is_ok(), "{prefix}");
            assert_eq!(parse(&format!("{}x", prefix.repeat(admitted + 1))).unwrap_err().code, "too_deep", "{prefix}");
        }
        assert_eq!(parse(&"(".repeat(60_000)).unwrap_err().code, "too_deep");
        assert_refused(&format!("{}x", "(".repeat(201)), "too_deep", 200);
    });
}

#[test]
fn depth_is_not_used_up_by_what_stands_side_by_side() {
    let flat = vec!["-(x)^2^-(1)*sin(x)"; 400].join("+");
    assert!(parse(&flat).is_ok());
}

#[test]
fn long_chains_are_read_and_differentiated_without_deep_recursion() {
    on_two_mebibytes(|| {
        let terms: Vec<String> = (1..=6000).map(|k| format!("{k}*x*y")).collect();
        let by_x = derivatives(&terms.join("+"), [0.0, 1.0, 2.0, 0.0])[1];
        assert_eq!(by_x, Some(2.0 * f64::from(6000 * 6001 / 2)));
        let towers = vec!["9^9^9^9^9^9^9"; 4500].join("/");
        assert!(value(&towers, [0.0; 4]).is_nan());
    });
}

#[test]
fn towers_of_powers_overflow_to_infinity() {
    assert_eq!(value(&vec!["9"; 150].join("^"), [0.0; 4]), f64::INFINITY);
}

#[test]
fn the_length_is_bounded() {
    let padded = |length: usize| format!("x{}", " ".repeat(length - 1));
    assert!(parse(&padded(64 * 1024)).is_ok());
    assert_refused(&padded(64 * 1024 + 1), "too_long", 64 * 1024);
    assert_refused(&"1".repeat(1_000_000), "too_long", 64 * 1024);
}

#[test]
fn numbers_outside_the_doubles_are_refused() {
    assert_refused("1e999", "number_out_of_range", 0);
    assert_refused("x + 1e-999", "number_out_of_range", 4);
    assert_refused(&"9".repeat(400), "number_out_of_range", 0);
    assert_eq!(value("0e999 + 0.000e-999 + 4.9e-324*0", [0.0; 4]), 0.0);
    assert_eq!(value(&format!("0.{}1", "0".repeat(300)), [0.0; 4]), 1e-301);
}

#[test]
fn malformed_texts_are_refused_at_their_place() {
    for (text, code, offset) in [
        ("", "syntax", 0),
        ("   ", "syntax", 3),
        ("1..2", "syntax", 1),
        (".", "syntax", 1),
        ("1e", "syntax", 1),
        ("1e+", "syntax", 1),
        ("0x10", "syntax", 1),
        ("1,5", "syntax", 1),
        ("2 x", "syntax", 2),
        ("2x", "syntax", 1),
        ("x(1)", "syntax", 1),
        ("x y", "syntax", 2),
        ("x +", "syntax", 3),
        ("* x", "syntax", 0),
        ("x * / y", "syntax", 4),
        ("x *** y", "syntax", 4),
        ("(x", "syntax", 2),
        ("x)", "syntax", 1),
        ("()", "syntax", 1),
        ("sin", "syntax", 3),
        ("sin x", "syntax", 4),
        ("max(1,)", "syntax", 6),
        ("max(1 2)", "syntax", 6),
        ("max(1, 2", "syntax", 8),
        ("x = 1", "syntax", 2),
        ("x < 1", "misplaced_condition", 0),
        ("2 * x >= 0", "misplaced_condition", 0),
        ("1 < x < 2", "syntax", 6),
        ("if(x < 1 < 2, 1, 2)", "syntax", 9),
        ("if(1, 2, 3)", "misplaced_condition", 3),
        ("1 + if(x, 2, 3)", "misplaced_condition", 7),
        ("not x", "misplaced_condition", 4),
        ("x and y > 1", "misplaced_condition", 0),
        ("(x > 1) or y", "misplaced_condition", 11),
        ("x > 1 and", "syntax", 9),
        ("and", "syntax", 0),
        ("x <> 1", "syntax", 3),
        ("x =< 1", "syntax", 2),
        ("x && y", "syntax", 2),
        ("!x", "syntax", 0),
        ("floor", "syntax", 5),
        ("floor(x, y)", "wrong_arity", 0),
        ("mod(x)", "wrong_arity", 0),
        ("mod(x, 0)", "out_of_range", 0),
        ("pwm(t, 1)", "wrong_arity", 0),
        ("pwm(t, 0, 0.5)", "out_of_range", 0),
        ("pwm(t, -1, 0.5)", "out_of_range", 0),
        ("pwm(t, 1, 50)", "out_of_range", 0),
        ("pwm(t, 1, -0.1)", "out_of_range", 0),
        ("1 + pulse(t, 0, -1)", "out_of_range", 4),
        ("sawtooth(t, 0)", "out_of_range", 0),
        ("triangle(t, 1 - 2)", "out_of_range", 0),
        ("x; y", "syntax", 1),
        ("\"x\"", "syntax", 0),
        ("x\0", "syntax", 1),
        ("\0", "syntax", 0),
        ("nan", "unknown_name", 0),
        ("1 + inf", "unknown_name", 4),
        ("e", "unknown_name", 0),
        ("foo(1)", "unknown_function", 0),
        ("nan (1)", "unknown_function", 0),
        ("sin()", "wrong_arity", 0),
        ("sin(x, y)", "wrong_arity", 0),
        ("1 + atan2(x)", "wrong_arity", 4),
        ("min(x)", "wrong_arity", 0),
        ("pow(x)", "wrong_arity", 0),
        ("x + \u{3bc}", "not_ascii", 4),
        ("x \u{2212} 1", "not_ascii", 2),
    ] {
        assert_refused(text, code, offset);
    }
}

#[test]
fn the_number_of_terms_is_bounded() {
    let (mut graph, mut scope) = (Graph::new(), Scope::new());
    scope.bind("x", graph.input(0)).unwrap();
    let mut node = graph.input(0);
    for k in 0..1_000_000 {
        let constant = graph.constant(f64::from(k) + 0.5);
        node = graph.multiply(node, constant);
    }
    let error = graph.gradient(node).unwrap_err();
    assert_eq!(error.code, "too_many_nodes");
    assert_eq!(graph.parse("x + 12345.678", &scope).unwrap_err().code, "too_many_nodes");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_are_read_or_refused_inside_the_text(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
        let text = String::from_utf8_lossy(&bytes);
        if let Err(error) = parse(&text) {
            prop_assert!(text.is_char_boundary(error.offset));
            prop_assert_eq!(error.caret(&text).lines().count(), 2);
        }
    }

    #[test]
    fn random_words_of_the_language_are_read_or_refused_inside_the_text(
        words in prop::collection::vec(prop::sample::select(vec![
            "x", "y", "t", "1", "2.5", "1e3", "+", "-", "*", "/", "^", "**", "(", ")", ",", "sin", "max", "atan2(",
            "<", ">=", "==", "!=", "and", "or", "not ", "if(", "floor(", "pwm(", "mod(", "min(", "abs(", "pi", "e", ".", " ", "\n",
        ]), 0..30)
    ) {
        let text = words.concat();
        match parse(&text) {
            Ok((mut graph, node)) => prop_assert!(graph.gradient(node).is_ok()),
            Err(error) => {
                prop_assert!(error.offset <= text.len());
                prop_assert!(!error.message.is_empty());
                prop_assert!(error.caret(&text).trim_end().ends_with('^'));
            }
        }
    }
}
