//! Specifications with vectors and sums, compared with the same problem written element by element, and error messages
//! for faulty ones.

use crate::documents::{assert_errors, errors_of};
use dvi::problem::Control;
use dvi::specification::Specification;
use serde_json::{Value, json};

/// Specification of a chain of masses with dry friction, connected by springs, written with vectors.
fn chain() -> Value {
    json!({
        "problem": {"dvi": {
            "parameters": {"n": 5, "m": 1, "k": 10, "F0[1..n]": "0.1*i", "x0[1..n]": [0.5, 0, -0.5, 0.25, 1]},
            "states": {
                "x[1..n]": {"initial": "x0[i]", "rate": "v[i]"},
                "v[1..n]": {"initial": 0, "rate": "(k*(x[i+1] - 2*x[i] + x[i-1]) - F[i])/m"}
            },
            "definitions": {
                "x[0]": "sin(t)", "x[n+1]": 0,
                "energy": "sum(m*v[i]^2/2 for i in 1..n) + sum(k*(x[j+1] - x[j])^2/2 for j in 0..n)",
                "pairs": "sum(sum(x[a]*x[b] for b in a..3) for a in 1..2) + sum(x[a]*x[b] for a in 1..2, b in 4..5)"
            },
            "integrals": {"heat": "sum(F[i]*v[i] for i in 1..n)", "all": "sum(F)"},
            "variables": {"F[1..n]": {"inequality": "-v[i]"}},
            "set": [{"box": {"of": ["F[1..n]"], "lower": "-F0[i]", "upper": "F0[i]"}}]
        }},
        "time": {"end": 3},
        "stop": [{"when": "x[i] - 0.9", "label": "far[2..n]", "record": true}],
        "output": {"times": {"count": 31}, "fields": ["x[1..n]", "v[n]", "F[1..2]", "energy", "pairs", "heat", "all"]}
    })
}

/// The chain of masses with dry friction of `chain`, with a name for each element: `x3` for `x[3]`.
fn written_out() -> Value {
    let n = 5;
    let (mut parameters, mut states, mut set) = (json!({"m": 1, "k": 10}), json!({}), Vec::new());
    let mut variables = json!({});
    let starts = [json!(0.5), json!(0), json!(-0.5), json!(0.25), json!(1)];
    for i in 1..=n {
        parameters[format!("f{i}")] = json!(format!("0.1*{i}"));
        parameters[format!("s{i}")] = starts[i - 1].clone();
    }
    for i in 1..=n {
        states[format!("x{i}")] = json!({"initial": format!("s{i}"), "rate": format!("v{i}")});
    }
    for i in 1..=n {
        let rate = format!("(k*(x{} - 2*x{i} + x{}) - F{i})/m", i + 1, i - 1);
        states[format!("v{i}")] = json!({"initial": 0, "rate": rate});
        variables[format!("F{i}")] = json!({"inequality": format!("-v{i}")});
        set.push(json!({"box": {"of": [format!("F{i}")], "lower": format!("-f{i}"), "upper": format!("f{i}")}}));
    }
    let sum = |term: &dyn Fn(usize) -> String, range: std::ops::RangeInclusive<usize>| {
        format!("({})", range.map(term).collect::<Vec<_>>().join(" + "))
    };
    let kinetic = sum(&|i| format!("m*v{i}^2/2"), 1..=n);
    let elastic = sum(&|j| format!("k*(x{} - x{j})^2/2", j + 1), 0..=n);
    let heat = sum(&|i| format!("F{i}*v{i}"), 1..=n);
    let all = sum(&|i| format!("F{i}"), 1..=n);
    let stop: Vec<Value> =
        (2..=n).map(|i| json!({"when": format!("x{i} - 0.9"), "label": format!("far[{i}]"), "record": true})).collect();
    json!({
        "problem": {"dvi": {
            "parameters": parameters, "states": states, "variables": variables, "set": set,
            "definitions": {
                "x0": "sin(t)", "x6": 0, "energy": format!("{kinetic} + {elastic}"),
                "pairs": "(x1*x1 + x1*x2 + x1*x3) + (x2*x2 + x2*x3) + (x1*x4 + x1*x5 + x2*x4 + x2*x5)"
            },
            "integrals": {"heat": heat, "all": all}
        }},
        "time": {"end": 3},
        "stop": stop,
        "output": {
            "times": {"count": 31},
            "fields": ["x1", "x2", "x3", "x4", "x5", "v5", "F1", "F2", "energy", "pairs", "heat", "all"]
        }
    })
}

fn solve(document: &Value) -> dvi::solution::Solution {
    let text = document.to_string();
    let specification = Specification::from_json(text.as_bytes()).unwrap_or_else(|errors| panic!("{errors:#?}"));
    dvi::solve(&specification, &Control::new())
}

#[test]
fn a_vector_is_its_elements_bit_for_bit() {
    let (vectors, scalars) = (solve(&chain()), solve(&written_out()));
    assert_eq!(vectors.trajectory.t, scalars.trajectory.t);
    assert_eq!(vectors.trajectory.fields.len(), 12);
    for (a, b) in vectors.trajectory.fields.iter().zip(&scalars.trajectory.fields) {
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&a.values), bits(&b.values), "{} {}", a.name, b.name);
    }
    let names: Vec<&str> = vectors.trajectory.fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(names[..6], ["x[1]", "x[2]", "x[3]", "x[4]", "x[5]", "v[5]"]);
    let times =
        |solution: &dvi::solution::Solution| solution.trajectory.events.iter().map(|event| event.t).collect::<Vec<_>>();
    assert!(vectors.trajectory.events.len() > 5);
    assert_eq!(times(&vectors), times(&scalars));
}

#[test]
fn what_is_wrong_with_a_vector_is_told_where_it_is_declared_and_once() {
    let with = |pointer: &str, value: Value| {
        let mut document = chain();
        *document.pointer_mut(pointer).expect("a place") = value;
        document
    };
    let states = "/problem/dvi/states/v[1..n]";
    for (place, value, code, says) in [
        (format!("{states}/rate"), json!("x[i+2]"), "index_out_of_range", "there is no `x[7]`"),
        (format!("{states}/rate"), json!("x[t]"), "index_out_of_range", "an index must be a constant whole number"),
        (format!("{states}/rate"), json!("x[1/2]"), "index_out_of_range", "an index must be a whole number, found 0.5"),
        (format!("{states}/rate"), json!("w[i]"), "unknown_name", "there is no name `w[1]` here"),
        (format!("{states}/rate"), json!("x"), "unknown_name", "`x` is a vector of 7 elements"),
        (format!("{states}/rate"), json!("sum(x[i] for i in 1..3)"), "syntax", "the index of a sum"),
        (
            format!("{states}/rate"),
            json!("sum(x[j])"),
            "wrong_arity",
            "a sum takes a vector or a term with its indices",
        ),
        (format!("{states}/initial"), json!([1, 2]), "wrong_count", "2 values for 5 elements"),
        ("/problem/dvi/parameters/x0[1..n]".to_owned(), json!([1, 2]), "wrong_count", "2 values for 5 elements"),
    ] {
        let errors = errors_of(with(&place, value).to_string());
        let found: Vec<_> = errors.iter().filter(|error| error.code == code && error.detail.contains(says)).collect();
        assert_eq!(found.len(), 1, "{place} {says}: {errors:#?}");
        assert!(place.starts_with(&found[0].pointer), "{} {place}", found[0].pointer);
    }
    let declared =
        |name: &str| json!({"problem": {"dvi": {"states": {name: {"initial": 0, "rate": 0}}}}, "time": {"end": 1}});
    for (name, says) in [
        ("x[1..m]", "`m` is neither a whole number nor a parameter that is one"),
        ("x[3..1]", "the range 3..1 is empty"),
        ("x[1..1000000]", "more than 400000 elements"),
    ] {
        let errors = errors_of(declared(name).to_string());
        assert!(errors.iter().any(|error| error.detail.contains(says)), "{errors:#?}");
    }
    let shadowed = json!({
        "problem": {"dvi": {"parameters": {"i": 2}, "states": {"x[1..3]": {"initial": "i", "rate": 0}}}}, "time": {"end": 1}
    });
    let detail = "the index `i` of `x[1..3]` has a name that is in use already";
    assert_errors(&shadowed, &[("/problem/dvi/states/x[1..3]", "duplicate_name", detail)]);
    let document = json!({
        "problem": {"dvi": {"states": {"x": {"initial": 0, "rate": "sum(1 for i in 1..1e9)"}}}}, "time": {"end": 1}
    });
    assert_errors(&document, &[("/problem/dvi/states/x/rate", "too_many_nodes", "too many terms")]);
}

#[test]
fn the_size_of_a_vector_cannot_be_bound_to_another_number() {
    let specification = Specification::from_json(chain().to_string().as_bytes()).expect("a specification");
    assert!(specification.with_parameters(&[("k", 11.0)]).is_ok());
    let errors = specification.with_parameters(&[("n", 6.0)]).expect_err("another structure");
    assert_eq!(errors[0].code, "structure_changes");
}

#[test]
fn a_run_with_vectors_goes_on_from_its_end() {
    let mut document = chain();
    document["output"] = json!({"times": {"count": 4}});
    let whole = solve(&document);
    let last = |name: &str| {
        let field = whole.trajectory.fields.iter().find(|field| field.name == name)?;
        field.values.get(2).copied()
    };
    let text = document.to_string();
    let continued = dvi::specification::continued(text.as_bytes(), 2.0, 3.0, last).expect("a document");
    let rest = solve(&serde_json::from_slice(&continued).expect("JSON"));
    let end =
        |solution: &dvi::solution::Solution| solution.trajectory.fields[0].values.last().copied().expect("a value");
    assert!((end(&rest) - end(&whole)).abs() < 1e-5, "{} {}", end(&rest), end(&whole));
}

#[test]
fn coordinates_and_their_velocities_are_vectors() {
    let document = json!({
        "problem": {"mechanical": {
            "parameters": {"m": 2, "n": "m", "all": "sum(k for k in 1..n)"},
            "coordinates": {"q[1..2]": {"initial": "i", "velocity": "all"}},
            "mass": [[1, 0], [0, 1]], "potential": "9.81*sum(q)", "forces": {"q[1..2]": "-0*q_dot[i]"},
            "contacts": [{"name": "floor[1..2]", "gap": "q[i]", "restitution": 0}]
        }},
        "time": {"end": 0.5}, "output": {"times": {"count": 2}, "fields": ["q[1..2]", "q_dot[1..2]"]}
    });
    let solution = solve(&document);
    for (k, field) in solution.trajectory.fields.iter().enumerate() {
        let exact = [1.0, 2.0].map(|start| start + 3.0 * 0.5 - 9.81 * 0.125);
        let exact = exact.into_iter().chain([3.0 - 9.81 * 0.5; 2]).nth(k).expect("four fields");
        let end = field.values.last().expect("a value");
        assert!((end - exact).abs() < 1e-9, "{}: {end} for {exact}", field.name);
    }
    let names: Vec<&str> = solution.trajectory.fields.iter().map(|field| field.name.as_str()).collect();
    assert_eq!(names, ["q[1]", "q[2]", "q_dot[1]", "q_dot[2]"]);
}

#[test]
fn a_matrix_of_data_is_a_list_of_rows_of_a_name_with_two_ranges() {
    let of = |parameters: Value| {
        json!({"problem": {"vi": {
            "parameters": parameters,
            "variables": {"p[1..2]": {"inequality": "sum(A[i,j]*p[j] for j in 1..3) - 1", "initial": 0}},
            "set": [{"nonnegative": ["p[1..2]"]}],
            "definitions": {"p[3]": "2"}
        }}})
    };
    let solved = |specification: &Value| {
        let specification = Specification::from_json(specification.to_string().as_bytes()).expect("a specification");
        let found = dvi::solve(&specification, &Control::new()).solution.expect("a solution");
        [found.z["p[1]"], found.z["p[2]"]]
    };
    // The solution of 4 p1 + p2 - 2 = 1 and p1 + 2 p2 - 1 = 1 is p1 = 4/7, p2 = 5/7.
    let rows = solved(&of(json!({"A[1..2,1..3]": [[4, 1, "-1"], [1, 2, -0.5]]})));
    let flat = solved(&of(json!({"A[1..2,1..3]": [4, 1, -1, 1, 2, -0.5]})));
    assert_eq!(rows, flat);
    assert!((rows[0] - 4.0 / 7.0).abs() < 1e-12 && (rows[1] - 5.0 / 7.0).abs() < 1e-12, "{rows:?}");
    let errors = errors_of(of(json!({"A": [[4, 1, -1], [1, 2, -0.5]]})).to_string());
    assert!(errors.iter().any(|error| format!("{error:?}").contains("A[1..2,1..3]")), "{errors:?}");
}
