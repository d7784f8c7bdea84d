//! Tests of the elements of vectors and of sums over indices.

use super::*;

/// Returns a scope with `t`, `y`, the elements `x[-1]` to `x[3]`, `m[1,2]`, and the parameter `n`, which is 3.
fn scope(graph: &mut Graph) -> Scope {
    let mut scope = Scope::new();
    let names = ["t", "y", "x[-1]", "x[0]", "x[1]", "x[2]", "x[3]", "m[1,2]"];
    for (index, name) in names.into_iter().enumerate() {
        scope.bind(name, graph.input(index)).unwrap();
    }
    scope.bind("n", graph.parameter(0, 3.0)).unwrap();
    scope
}

fn value_of(text: &str) -> Result<f64, ExpressionError> {
    let mut graph = Graph::new();
    let scope = scope(&mut graph);
    let node = graph.parse(text, &scope)?;
    let mut out = [0.0];
    Tape::compile(&graph, &[node]).evaluate(0.5, &[7.0, 10.0, 20.0, 30.0, 50.0, 70.0, 11.0], &mut out);
    Ok(out[0])
}

#[test]
fn an_index_is_what_is_written_in_brackets() {
    for (text, value) in [
        ("x[1]", 30.0),
        ("x[-1]", 10.0),
        ("x[n]", 70.0),
        ("x[ 2*n - 5 ]^2", 900.0),
        ("m[1, n-1] + m[1,2]", 22.0),
        ("sum(x)", 180.0),
        ("sum(x[i] for i in 1..n)", 150.0),
        ("sum(i*x[i+1] for i = 0..2) - 1", 189.0),
        ("sum(sum(x[i]*x[j] for j in i..2) for i in 1..2)", 30.0 * 30.0 + 30.0 * 50.0 + 50.0 * 50.0),
        ("sum(i/j for i in 1..2, j in 1..2)", 4.5),
        ("sum(x[i] for i in 3..2) + 1", 1.0),
        ("sum(0.5 for k in 1 .. 4)", 2.0),
        ("sum(1. for k in 1..2)", 2.0),
    ] {
        assert_eq!(value_of(text), Ok(value), "{text}");
    }
}

#[test]
fn a_sum_is_the_chain_of_its_terms() {
    let mut graph = Graph::new();
    let scope = scope(&mut graph);
    let sum = graph.parse("sum(y*x[i] for i in 0..3)", &scope).unwrap();
    assert_eq!(graph.parse("y*x[0] + y*x[1] + y*x[2] + y*x[3]", &scope), Ok(sum));
}

#[test]
fn what_is_no_element_and_no_sum_says_why() {
    for (text, code, offset) in [
        ("x[4]", "index_out_of_range", 0),
        ("x[0.5]", "index_out_of_range", 2),
        ("x[t]", "index_out_of_range", 2),
        ("x[1,2]", "index_out_of_range", 0),
        ("w[1]", "unknown_name", 0),
        ("x", "unknown_name", 0),
        ("x[1", "syntax", 3),
        ("x[]", "syntax", 2),
        ("sum(y)", "wrong_arity", 0),
        ("sum()", "wrong_arity", 0),
        ("sum(x[i] for i in 1..4)", "index_out_of_range", 4),
        ("sum(x[i] for in 1..4)", "syntax", 16),
        ("sum(x[i] for i in 1)", "syntax", 19),
        ("sum(x[i] for i, j in 1..2)", "syntax", 14),
        ("sum(sum(x[i] for i in 1..2) for i in 1..2)", "syntax", 17),
        ("sum(1 for i in 1..1e9)", "too_many_nodes", 0),
        ("sum(1 for i in 1..1e99)", "index_out_of_range", 18),
    ] {
        let error = value_of(text).unwrap_err();
        assert_eq!((error.code, error.offset), (code, offset), "{text}: {error}");
    }
    let error = value_of("x[4] + 1").unwrap_err();
    assert_eq!(error.expected.as_deref(), Some("one of the 5 elements `x[-1]` to `x[3]`"));
}

#[test]
fn no_part_of_a_sum_is_a_surprise() {
    let text = "sum(sum(x[i]*m[1, j] for j in 2..2) for i in 1..n) + x[2]";
    for end in 0..=text.len() {
        for start in 0..end {
            // Accept any result: the test is that parsing terminates without a panic.
            let _ = value_of(&text[start..end]);
        }
    }
}
