//! Certificates of uniqueness are correct: none is given for textbook examples with several solutions, one is given
//! wherever a theorem applies, and all formulations of a problem get the same one.

use dvi::analysis::{Analysis, Uniqueness};
use dvi::specification::Specification;
use serde_json::{Value, json};

#[track_caller]
fn analysis(problem: Value) -> Analysis {
    let document = json!({"problem": problem, "time": {"end": 1}}).to_string();
    let specification = Specification::from_json(document.as_bytes());
    specification.unwrap_or_else(|errors| panic!("{errors:#?}")).analysis().clone()
}

#[track_caller]
fn assert_verdict(problem: Value, expected: Uniqueness, because: &str) {
    let Analysis { uniqueness, because: found, .. } = analysis(problem);
    assert!(uniqueness == expected && found.contains(because), "{uniqueness:?} because {found}");
}

fn ode(rate: &str, initial: f64) -> Value {
    json!({"dvi": {"states": {"x": {"initial": initial, "rate": rate}}}})
}

#[test]
fn rates_that_are_not_lipschitz_are_not_certified() {
    // Initial value problems with several solutions from x(0) = 0: x = +-t; x = 0 or t^2; x = 0 or t^3; x = 0 or (2
    // t/3)^(3/2).
    for (rate, expected, because) in [
        ("sign(x)", Uniqueness::NotCertified, "`sign` of a term in `x` jumps"),
        ("1 - 2*heaviside(x)", Uniqueness::NotCertified, "`heaviside` of a term in `x` jumps"),
        ("2*sqrt(abs(x))", Uniqueness::ExistsNotCertified, "`sqrt` of a term in `x` has an infinite slope"),
        ("3*cbrt(x)^2", Uniqueness::ExistsNotCertified, "`cbrt` of a term in `x` has an infinite slope"),
        ("abs(x)^(1/3)", Uniqueness::ExistsNotCertified, "a power below one of a term in `x`"),
    ] {
        assert_verdict(ode(rate, 0.0), expected, because);
        // From an initial value other than x = 0, all of the rates above are smooth at the start.
        assert_verdict(ode(rate, 1.0), Uniqueness::LocallyUnique, "until it gets there");
    }
}

#[test]
fn rates_that_are_lipschitz_are_certified() {
    for rate in
        ["-x^3", "abs(x)", "sqrt(1 + x^2)", "-x*sqrt(x^2)", "x*heaviside(t - 1) + sign(sin(t))", "max(x, 0)^1.5"]
    {
        assert_verdict(ode(rate, 0.0), Uniqueness::Unique, "locally Lipschitz");
    }
}

#[test]
fn what_is_not_lipschitz_beside_variables_is_seen_too() {
    // The water level of a leaking tank, kept below a rim by the outflow `z`.
    let tank = |initial: f64| {
        json!({"dvi": {
            "states": {"h": {"initial": initial, "rate": "1 - sqrt(h) - z"}},
            "variables": {"z": {"inequality": "2 - h"}},
            "set": [{"nonnegative": ["z"]}]
        }})
    };
    assert_verdict(tank(1.0), Uniqueness::LocallyUnique, "`sqrt` of a term in `h`");
}

/// Returns the linear complementarity system `x' = A x + B z`, `G = C x + D z`, `z >= 0`.
fn lcs(a: Value, b: Value, c: Value, d: Value) -> Value {
    let initial = vec![0.0; a.as_array().map_or(0, Vec::len)];
    let names: Vec<String> = (1..=d.as_array().map_or(0, Vec::len)).map(|k| format!("z{k}")).collect();
    json!({"lcs": {"initial": initial, "A": a, "B": b, "C": c, "D": d, "variable_names": names, "set": [{"nonnegative": names}]}})
}

#[test]
fn passive_netlists_have_unique_states() {
    let doubler = "V1 a 0 SIN(0 10 50)\nRs a b 1\nC1 b c 1u\nD1 0 c\nD2 c d\nC2 d 0 1u\nRL d 0 10k";
    let multiplier = "V1 s 0 SIN(0 100 1000)\nRs s n0 10\nCa0 n0 t0 1u\nDa0 0 t0\nCb0 0 b0 1u\nDb0 t0 b0\n\
                      Ca1 t0 t1 1u\nDa1 b0 t1\nCb1 b0 b1 1u\nDb1 t1 b1";
    let bridge =
        "V1 a b SIN(0 10 50)\nRs a c 0.5\nD1 c p\nD2 b p\nD3 0 c\nD4 0 b\nC1 p 0 100u\nRL p 0 1k\nL1 p q 1m\nR2 q 0 50";
    for netlist in [doubler, multiplier, bridge] {
        assert_verdict(json!({"circuit": {"netlist": netlist}}), Uniqueness::Unique, "passive");
    }
}

#[test]
fn a_source_that_feeds_back_is_not_passive() {
    // The matrix D of a voltage doubler, one resistance of which is negated, is regular, but not a P-matrix.
    let negative = lcs(json!([[0.0]]), json!([[1.0, 0.0]]), json!([[1.0], [0.0]]), json!([[1.0, 2.0], [2.0, 1.0]]));
    assert_verdict(negative, Uniqueness::NotCertified, "not a P-matrix");
    // A linear complementarity system with C B = -1 on the kernel of D is not passive: no positive definite P
    // satisfies P B = C^T there.
    let reversed = lcs(json!([[0.0]]), json!([[-1.0, 0.0]]), json!([[1.0], [0.0]]), json!([[0.0, 0.0], [0.0, 1.0]]));
    assert_verdict(reversed, Uniqueness::NotCertified, "");
}

/// The rock-paper-scissors game: shares move along their payoffs, projected onto the plane of constant sum, and stay
/// nonnegative. With `mean`, the projection subtracts the mean explicitly; without, it uses a free variable.
fn rock_paper_scissors(mean: bool) -> Value {
    let pushes = ["b - c + za", "c - a + zb", "a - b + zc"];
    let less = if mean { "(za + zb + zc)/3" } else { "m" };
    let rate = |push: &str| format!("{push} - {less}");
    let state = |push: &str, initial: f64| json!({"initial": initial, "rate": rate(push)});
    let mut variables = json!({"za": {"inequality": "a"}, "zb": {"inequality": "b"}, "zc": {"inequality": "c"}});
    let mut set = vec![json!({"nonnegative": ["za", "zb", "zc"]})];
    if !mean {
        variables["m"] = json!({"inequality": "2 - 2*(a + b + c)"});
        set.push(json!({"free": ["m"]}));
    }
    json!({"dvi": {
        "states": {"a": state(pushes[0], 0.5), "b": state(pushes[1], 0.3), "c": state(pushes[2], 0.2)},
        "variables": variables, "set": set
    }})
}

#[test]
fn one_problem_in_two_writings_has_one_verdict() {
    for mean in [true, false] {
        assert_verdict(rock_paper_scissors(mean), Uniqueness::Unique, "passive");
    }
    // A block with dry friction, whose rate contains the friction force directly or through a free variable equal to
    // it.
    let plain = json!({"dvi": {
        "states": {"v": {"initial": 1, "rate": "-F"}},
        "variables": {"F": {"inequality": "-v"}},
        "set": [{"box": {"of": ["F"], "lower": -1, "upper": 1}}]
    }});
    let mut renamed = plain.clone();
    renamed["dvi"]["states"]["v"]["rate"] = json!("-w");
    renamed["dvi"]["variables"]["F"]["inequality"] = json!("v");
    renamed["dvi"]["variables"]["w"] = json!({"inequality": "3*w + 3*F"});
    renamed["dvi"]["set"] = json!([{"box": {"of": ["F"], "lower": -1, "upper": 1}}, {"free": ["w"]}]);
    assert_eq!(analysis(plain).uniqueness, analysis(renamed).uniqueness);
}

#[test]
fn a_p_matrix_decides_of_intervals_alone() {
    // The matrix D = [[1, 5], [0, 1]] of a linear complementarity system is a P-matrix but not positive definite.
    let problem = |set: Value| json!({"lcs": {"initial": [0], "C": [[1], [0]], "D": [[1, 5], [0, 1]], "variable_names": ["p", "q"], "set": [set]}});
    assert_verdict(problem(json!({"nonnegative": ["p", "q"]})), Uniqueness::Unique, "a P-matrix");
    let disk = problem(json!({"ball": {"of": ["p", "q"], "radius": 1}}));
    assert_verdict(disk, Uniqueness::NotCertified, "intervals only");
}

#[test]
fn a_sign_that_looks_reversed_is_asked_about() {
    let friction = |inequality: &str| {
        json!({"dvi": {
            "states": {"v": {"initial": 1, "rate": "sin(t) - F"}},
            "variables": {"F": {"inequality": inequality}},
            "set": [{"box": {"of": ["F"], "lower": -1, "upper": 1}}]
        }})
    };
    let question = "Is the sign of the inequality of `F`, or of `F` in the rate of `v`, reversed?";
    assert_verdict(friction("v"), Uniqueness::NotCertified, question);
    assert!(!analysis(friction("-v")).because.contains("reversed"));
    let law = lcs(json!([[0.0]]), json!([[1.0]]), json!([[1.0]]), json!([[-2.0]]));
    assert_verdict(law, Uniqueness::NotCertified, "Is the sign of the inequality of `z1` reversed?");
}
