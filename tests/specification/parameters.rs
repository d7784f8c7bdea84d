//! Parameters that can be bound to other values: a bound problem is compared with the same text read with these
//! values, and parameter derivatives of the equations with closed forms and difference quotients.

use dvi::models::{DviModel, MechanicalModel, StaticModel};
use dvi::problem::{Constraints, Control};
use dvi::specification::{EXAMPLES, Specification};
use nalgebra::DMatrix;
use serde_json::{Value, json};
use std::any::Any;

fn read(document: &Value) -> Specification {
    Specification::from_json(document.to_string().as_bytes()).unwrap_or_else(|errors| panic!("{errors:?}\n{document}"))
}

/// Returns the specification with other values for its parameters.
fn with_numbers(document: &Value, given: &[(&str, f64)]) -> Value {
    let mut document = document.clone();
    let problem = document["problem"].as_object_mut().and_then(|problem| problem.values_mut().next()).expect("a type");
    for &(name, value) in given {
        problem["parameters"][name] = json!(value);
    }
    document
}

/// Returns the equations of a variational inequality, dynamic or static.
fn equations(specification: &Specification) -> &DviModel {
    let of_static = || (specification.model() as &dyn Any).downcast_ref().map(|model: &StaticModel| &model.equations);
    specification.model().dvi().or_else(of_static).expect("a variational inequality")
}

/// Returns the values of the equations, their Jacobian and their time derivatives at the time `t` and the unknowns `y`.
fn told(specification: &Specification, t: f64, y: &[f64]) -> [Vec<f64>; 3] {
    let model = equations(specification);
    let (structure, mut problem) = (model.structure(), model.problem());
    let mut told = [structure.rows(), structure.pattern.len(), structure.variables].map(|length| vec![0.0; length]);
    problem.evaluate(t, y, &mut told[0]);
    problem.jacobian(t, y, &mut told[1]);
    problem.time_derivative(t, y, &mut told[2]);
    told
}

/// Asserts that a problem whose parameters are bound to new values equals the problem that is read with the same
/// values: in structure, initial state, and values of the equations at a point.
#[track_caller]
fn assert_same(bound: &Specification, anew: &Specification, what: &str) {
    if let [Some(model), Some(other)] = [bound, anew].map(mechanical) {
        return assert_same_system(model, other, what);
    }
    let [model, other] = [bound, anew].map(equations);
    let (structure, expected) = (model.structure(), other.structure());
    assert_eq!(structure.pattern, expected.pattern, "{what}");
    assert_eq!((&structure.mass, &structure.set), (&expected.mass, &expected.set), "{what}");
    assert_eq!(structure.constant_jacobian, expected.constant_jacobian, "{what}");
    assert_eq!(model.initial, other.initial, "{what}");
    assert_eq!(bound.analysis().uniqueness, anew.analysis().uniqueness, "{what}");
    let y: Vec<f64> = (0..structure.unknowns()).map(|i| 0.3 + 0.7 * (1.0 + 1.3 * i as f64).sin().abs()).collect();
    let pairs = told(bound, 0.37, &y).into_iter().zip(told(anew, 0.37, &y));
    let outputs = [model, other].map(|model| {
        let mut all = y.clone();
        all.resize(model.names().count(), 0.0);
        model.outputs.clone().append(0.37, &mut all);
        all
    });
    let [found, expected] = outputs;
    let pairs = pairs.chain([(found, expected)]);
    for (found, expected) in pairs.flat_map(|(found, expected)| found.into_iter().zip(expected)) {
        let off = (found - expected).abs();
        assert!(off <= 4.0 * f64::EPSILON * expected.abs() || found.to_bits() == expected.to_bits(), "{what}: {off}");
    }
}

fn mechanical(specification: &Specification) -> Option<&MechanicalModel> {
    (specification.model() as &dyn Any).downcast_ref()
}

/// Asserts that a mechanical system whose parameters are bound to new values equals the system that is read with the
/// same values.
#[track_caller]
fn assert_same_system(model: &MechanicalModel, other: &MechanicalModel, what: &str) {
    assert_eq!((model.structure(), &model.initial), (other.structure(), &other.initial), "{what}");
    let n = model.structure().coordinates;
    let at = |i: usize| 0.3 + 0.7 * (1.0 + 1.3 * i as f64).sin().abs();
    let (q, v): (Vec<f64>, Vec<f64>) = (0..n).map(|i| (at(i), at(i + n))).unzip();
    let [found, expected] = [model, other].map(|model| {
        let (mut problem, mut constraints) = (model.problem(), Constraints::new(model.structure()));
        let (mut mass, mut forces) = (DMatrix::zeros(n, n), vec![0.0; n]);
        let (mut by_q, mut by_v) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
        problem.mass(0.37, &q, &mut mass);
        problem.forces(0.37, &q, &v, &mut forces);
        problem.stiffness(0.37, &q, &v, &mut by_q, &mut by_v);
        problem.constraints(0.37, &q, &mut constraints);
        let energies = problem.energies(0.37, &q, &v);
        let mut all = vec![energies.kinetic, energies.potential, energies.power, energies.drive];
        all.extend(mass.iter().chain(&forces).chain(&by_q).chain(&by_v));
        all.extend(constraints.values.iter().chain(&constraints.drift).chain(&constraints.transposed));
        all
    });
    for (found, expected) in found.into_iter().zip(expected) {
        let off = (found - expected).abs();
        assert!(off <= 8.0 * f64::EPSILON * expected.abs().max(1e-3), "{what}: {found} instead of {expected}");
    }
}

#[test]
fn every_example_can_be_bound_to_other_values_of_its_parameters() {
    let mut bound_parameters = 0;
    for example in EXAMPLES {
        let document: Value = serde_json::from_str(example.text).expect("an example");
        let specification = read(&document);
        let Some(parameters) = specification.model().parameters() else { continue };
        // Elements of vectors, and initial values varied by a sweep, are parameters without a member of their own in
        // the document.
        let problem = document["problem"].as_object().and_then(|problem| problem.values().next());
        let members = problem.and_then(|problem| problem["parameters"].as_object());
        let own = |(name, _): &(&String, &f64)| members.is_some_and(|members| members.contains_key(*name));
        for (name, value) in parameters.names().iter().zip(parameters.values()).filter(own) {
            let given = [(name.as_str(), 1.25 * value + 0.01)];
            let what = format!("{}: {given:?}", example.name);
            let anew = Specification::from_json(with_numbers(&document, &given).to_string().as_bytes());
            match (specification.with_parameters(&given), anew) {
                (Ok(bound), Ok(anew)) => assert_same(&bound, &anew, &what),
                // A parameter that is the size of a vector must be a whole number, which the new value of this one is
                // not.
                (Err(found), Err(expected)) if expected[0].code == "index_out_of_range" => {
                    assert_eq!(found[0].code, "structure_changes", "{what}");
                }
                (Err(found), Err(expected)) => assert_eq!(found[0].code, expected[0].code, "{what}"),
                // Two kinds of parameters cannot be bound, although the specification is valid with other values:
                // those of a problem whose initial state is found by the option `resolve`, and a period, which is a
                // number as soon as it has been read.
                (Err(found), Ok(_)) => {
                    let fixed = example.text.contains("resolve") || document["periodic"]["period"] == name.as_str();
                    assert!(fixed && found[0].code == "structure_changes", "{what}: {found:?}");
                }
                (Ok(_), Err(errors)) => panic!("{what}: {errors:?}"),
            }
            bound_parameters += 1;
        }
    }
    assert!(bound_parameters >= 40, "{bound_parameters} parameters of examples are inputs");
}

/// A variational inequality with parameters in all places: rates, inequality, mass, moving and constant bounds, initial
/// values.
fn everywhere() -> Value {
    json!({
        "problem": {"dvi": {
            "parameters": {"m": 2, "k": 3, "c": "k/m", "a": 0.4, "w": 5, "b": 0.25},
            "states": {
                "x": {"initial": "a", "rate": "y"},
                "y": {"initial": "-a*c", "rate": "-k*x - c*y*abs(y) + sin(w*t) + z1"}
            },
            "variables": {
                "z1": {"inequality": "x + c*z1"},
                "z2": {"inequality": "z2 - y + w*t*b"},
                "z3": {"inequality": "z3 - b*x"}
            },
            "set": [
                {"box": {"of": ["z1"], "lower": "-b*x", "upper": "c"}},
                {"box": {"of": ["z2"], "lower": "-k*b", "upper": "m"}},
                {"ball": {"of": ["z3"], "radius": "a*m"}}
            ],
            "mass": [[1, 0], [0, "m"]]
        }},
        "time": {"end": 1}
    })
}

/// A linear complementarity system with parameters in its matrices.
fn linear() -> Value {
    json!({
        "problem": {"lcs": {
            "parameters": {"r": 2, "l": 0.5, "e": 3, "f": 7},
            "initial": ["e/10", 1],
            "A": [["-r/l", 0.2], [0, "-1/r"]],
            "B": [["1/l"], ["-r*l"]],
            "C": [["e", 0]],
            "D": {"shape": [1, 1], "entries": [[0, 0, "r"], [0, 0, "l"]]},
            "a": ["e*sin(f*t)/l", 0],
            "g": ["r - cos(f*t)"],
            "set": [{"nonnegative": ["z1"]}],
            "mass": [["l", 0], [0, 2]]
        }},
        "time": {"end": 1}
    })
}

fn regions() -> Value {
    json!({
        "problem": {"filippov": {
            "parameters": {"up": 1.5, "down": -0.7, "s": 0.25},
            "states": {"x": {"initial": "2*s", "plus": "down - s*x", "minus": "up"}, "y": {"initial": 1, "plus": "-y*up", "minus": "s"}},
            "surface": "x - s*sin(t)"
        }},
        "time": {"end": 1}
    })
}

/// A block on a rough incline, and a spring onto which it falls.
fn block() -> Value {
    json!({
        "problem": {"mechanical": {
            "parameters": {"m": 2, "k": 30, "mu": 0.4, "e": 0.6, "g": 9.81, "h": 1, "v0": 0.7, "w": 3},
            "coordinates": {
                "x": {"initial": "h/10", "velocity": "v0"},
                "y": {"initial": "h", "velocity": 0}
            },
            "mass": [["m", 0], [0, "2*m"]],
            "potential": "2*m*g*y + k*x^2/2 - m*x*sin(w*t)",
            "forces": {"x": "-mu*x_dot*abs(x_dot)"},
            "contacts": [
                {"name": "floor", "gap": "y - h/5", "restitution": "e",
                 "friction": {"coefficient": "mu/2", "slip": ["x_dot - v0*cos(w*t)"]}}
            ]
        }},
        "time": {"end": 1},
        "method": {"rtol": 1e-6}
    })
}

/// A bridge circuit with a capacitor in a loop with the source, two inductors in series, and a Zener diode in the
/// spanning tree.
fn circuit() -> Value {
    json!({
        "problem": {"circuit": {
            "parameters": {"r": 2, "c": 0.3, "l": 0.5, "e": 3, "w": 7, "u": 0.6, "i0": 0.2},
            "components": [
                {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": "e*cos(w*t)"}},
                {"resistor": {"name": "R1", "nodes": ["in", "a"], "ohms": "r"}},
                {"resistor": {"name": "R2", "nodes": ["a", "0"], "ohms": "3*r + 1"}},
                {"resistor": {"name": "R3", "nodes": ["a", "b"], "ohms": "r^2"}},
                {"diode": {"name": "D1", "nodes": ["b", "out"], "forward_volts": "u/10"}},
                {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": "c", "volts": "u"}},
                {"capacitor": {"name": "C2", "nodes": ["in", "0"], "farads": "2*c"}},
                {"inductor": {"name": "L1", "nodes": ["out", "m"], "henries": "l", "amperes": "i0"}},
                {"inductor": {"name": "L2", "nodes": ["m", "0"], "henries": "l/2"}},
                {"zener": {"name": "Z1", "nodes": ["0", "b"], "forward_volts": "u", "breakdown_volts": "2*e"}},
                {"switch": {"name": "S1", "nodes": ["a", "out"], "closed": "sin(w*t) - u", "withstand_volts": "100*e"}}
            ]
        }},
        "time": {"end": 1}
    })
}

#[test]
fn a_bound_problem_is_the_one_that_is_read_anew() {
    for (document, given) in [
        (everywhere(), vec![("m", 3.5), ("k", 0.7), ("a", 0.1)]),
        (everywhere(), vec![("w", 1.1), ("b", 0.9)]),
        (linear(), vec![("r", 1.7), ("e", -0.3)]),
        (linear(), vec![("l", 0.9), ("f", 0.2)]),
        (regions(), vec![("up", 0.3), ("s", 0.6)]),
        (block(), vec![("m", 0.9), ("mu", 0.3), ("h", 1.3), ("e", 0.5)]),
        (block(), vec![("k", 11.0), ("g", 1.62), ("v0", -0.2), ("w", 5.0)]),
        (circuit(), vec![("r", 0.7), ("l", 1.3), ("i0", -0.1)]),
        (circuit(), vec![("c", 1.1), ("e", 2.0), ("w", 3.0), ("u", 0.5)]),
    ] {
        let bound = read(&document).with_parameters(&given).unwrap_or_else(|errors| panic!("{given:?}: {errors:?}"));
        let anew = read(&with_numbers(&document, &given));
        assert_same(&bound, &anew, &format!("{given:?}"));
        let [found, expected] = [&bound, &anew].map(|specification| {
            let solution = dvi::solve(specification, &Control::new());
            serde_json::to_value(&solution.trajectory).expect("a trajectory")
        });
        assert_eq!(found, expected, "{given:?}");
    }
}

#[test]
fn what_cannot_be_bound_says_which_parameter_changes_what() {
    let codes = |document: &Value, given: &[(&str, f64)]| -> Vec<(&'static str, String)> {
        let errors = read(document).with_parameters(given).expect_err("these values cannot be bound");
        errors.into_iter().map(|error| (error.code, error.detail)).collect()
    };
    let told = |document: &Value, given: &[(&str, f64)], code: &str, words: &str| {
        let errors = codes(document, given);
        assert!(errors.len() == 1 && errors[0].0 == code && errors[0].1.contains(words), "{given:?}: {errors:?}");
    };
    told(&everywhere(), &[("k", 0.0)], "structure_changes", "`k` = 0");
    told(&everywhere(), &[("m", 0.0)], "structure_changes", "`m` = 0");
    told(&everywhere(), &[("m", -1.0)], "empty_set", "`m` = -1");
    told(&everywhere(), &[("b", f64::NAN)], "not_finite", "`b` = NaN");
    told(&everywhere(), &[("c", 1.0)], "unknown_name", "`c` is not a parameter");
    told(&everywhere(), &[("mm", 1.0)], "unknown_name", "`mm`");
    told(&linear(), &[("e", 0.0)], "structure_changes", "`e` = 0");
    let at_zero = with_numbers(&linear(), &[("e", 0.0)]);
    told(&at_zero, &[("e", 1.0)], "structure_changes", "a coefficient that was zero");
    told(&with_numbers(&linear(), &[("l", -2.0), ("r", 2.0)]), &[("l", 1.0)], "structure_changes", "was zero");
    told(&block(), &[("mu", 0.0)], "structure_changes", "`mu` = 0");
    told(&block(), &[("e", 1.5)], "out_of_range", "restitution of `floor` is 1.5");
    told(&block(), &[("m", -1.0)], "mass_not_positive", "-1");
    told(&circuit(), &[("r", -1.0)], "out_of_range", "component number 2 is -1");
    // A Filippov system whose rates point away from the switching surface on both sides: solutions may leave the
    // surface at any time.
    let mut repelling = with_numbers(&regions(), &[("s", 0.0)]);
    repelling["problem"]["filippov"]["surface"] = json!("x");
    told(&repelling, &[("up", -1.0), ("down", 2.0)], "structure_changes", "repels");
    // A mass matrix whose entries equal those of the identity for one parameter value is not treated as an identity.
    let mut identity = linear();
    identity["problem"]["lcs"]["mass"] = json!([["2*l", 0], [0, 1]]);
    let bound = read(&identity).with_parameters(&[("l", 0.75)]).expect("another mass");
    assert_same(&bound, &read(&with_numbers(&identity, &[("l", 0.75)])), "a mass");
    let folded = json!({"problem": {"convolution": {
        "parameters": {"a": 1}, "variables": {"z": {"q": "-a*t"}}, "kernel": {"fractional": {"exponent": 0.5}},
        "set": [{"nonnegative": ["z"]}]}}, "time": {"end": 1}, "method": {"step": 0.1}});
    told(&folded, &[("a", 2.0)], "folded", "constants");
}

/// Returns derivatives with respect to the parameters: of the equations at a point, and of the initial states, the mass
/// matrix and constant bounds; each with a description, the index of the parameter, and the value.
fn slopes(specification: &Specification, t: f64, y: &[f64]) -> Vec<(String, usize, f64)> {
    let model = specification.model().dvi().expect("a problem");
    let mut slopes = model.slopes().expect("derivatives").expect("parameters");
    let mut values = vec![0.0; slopes.pattern().len()];
    slopes.evaluate(t, y, &mut values);
    let mut all: Vec<(String, usize, f64)> = Vec::new();
    all.extend(slopes.pattern().iter().zip(values).map(|(&(row, by), value)| (format!("row {row}"), by, value)));
    all.extend(slopes.initial().map(|(state, by, value)| (format!("start {state}"), by, value)));
    all.extend(slopes.mass().map(|(place, by, value)| (format!("mass {place:?}"), by, value)));
    all.extend(slopes.bounds().map(|(bound, by, value)| (format!("bound {bound:?}"), by, value)));
    all
}

#[test]
fn slopes_are_those_of_the_closed_form() {
    let specification = read(&everywhere());
    let (t, y) = (0.3_f64, [0.7_f64, -1.2, 0.5, 0.1, 0.2]);
    let (m, k, w): (f64, f64, f64) = (2.0, 3.0, 5.0);
    let found = slopes(&specification, t, &y);
    let find = |what: &str, by: usize| {
        found.iter().find(|(of, parameter, _)| of.starts_with(what) && *parameter == by).map_or(0.0, |found| found.2)
    };
    // The derivatives refer to the independent parameters m, k, a, w, b, sorted by name; the parameter c = k/m depends
    // on them.
    let names = specification.model().parameters().expect("parameters").names().to_vec();
    let place = |name: &str| names.iter().position(|known| known == name).expect("a parameter");
    let quadratic = y[1] * y[1].abs();
    for (what, by, expected) in [
        ("row 1", "k", -y[0] - quadratic / m),
        ("row 1", "m", k * quadratic / (m * m)),
        ("row 1", "w", t * (w * t).cos()),
        ("row 2", "m", -k / (m * m) * y[2]),
        ("row 3", "b", w * t),
        ("row 3", "w", t * 0.25),
        ("row 4", "b", -y[0]),
        ("row 5", "b", -y[0]),
        ("start 0", "a", 1.0),
        ("start 1", "a", -k / m),
        ("start 1", "k", -0.4 / m),
        ("start 1", "m", 0.4 * k / (m * m)),
        ("mass (1, 1)", "m", 1.0),
        ("bound MovingBound { variable: 0, side: Upper }", "k", 1.0 / m),
        ("bound MovingBound { variable: 1, side: Lower }", "b", -k),
        ("bound MovingBound { variable: 1, side: Upper }", "m", 1.0),
        ("bound MovingBound { variable: 2, side: Radius }", "a", m),
        ("row 0", "k", 0.0),
    ] {
        let slope = find(what, place(by));
        assert!((slope - expected).abs() <= 1e-14 * expected.abs(), "d({what})/d{by}: {slope} for {expected}");
    }
}

#[test]
fn slopes_are_those_of_differences() {
    for document in [linear(), regions(), circuit()] {
        let specification = read(&document);
        let parameters = specification.model().parameters().expect("parameters").clone();
        let structure = specification.model().dvi().expect("a problem").structure().clone();
        let y: Vec<f64> = (0..structure.unknowns()).map(|i| 0.4 - 0.3 * i as f64).collect();
        let found = slopes(&specification, 0.8, &y);
        for (k, name) in parameters.names().iter().enumerate() {
            let h = 1e-5;
            let [above, below] = [h, -h].map(|h| {
                let bound = specification.with_parameters(&[(name, parameters.values()[k] + h)]).expect("other values");
                let model = bound.model().dvi().expect("a problem");
                (told(&bound, 0.8, &y)[0].clone(), model.initial.clone())
            });
            let difference = |a: &[f64], b: &[f64], i: usize| (a[i] - b[i]) / (2.0 * h);
            let rows = (0..structure.rows()).map(|i| (format!("row {i}"), difference(&above.0, &below.0, i)));
            let start = (0..structure.states).map(|i| (format!("start {i}"), difference(&above.1, &below.1, i)));
            for (what, expected) in rows.chain(start) {
                let slope = found.iter().find(|(of, by, _)| *of == what && *by == k).map_or(0.0, |found| found.2);
                let off = (slope - expected).abs();
                assert!(off <= 1e-8 * expected.abs().max(1.0), "d({what})/d{name}: {slope} for {expected}");
            }
        }
    }
}
