//! Sweeps compared with closed forms: accumulation times of a bouncing ball, the mode map of a belt, means over
//! random and low-discrepancy points, and reducers along the dense output. The output bytes are identical for any
//! distribution of the work.

use crate::systems::harness::solve;
use dvi::problem::Control;
use dvi::solution::encodings::MembersForm;
use dvi::solution::{Solution, Status, Table, Values, encodings};
use dvi::specification::{Specification, edited};
use serde_json::{Value, json};
use std::f64::consts::{FRAC_PI_2, PI};
use std::num::NonZeroUsize;

fn read(specification: &Value) -> Specification {
    Specification::from_json(specification.to_string().as_bytes())
        .unwrap_or_else(|errors| panic!("the specification has errors: {errors:#?}"))
}

fn table(specification: &Value) -> Table {
    let solution = dvi::solve_on(NonZeroUsize::new(2).unwrap(), &read(specification), &Control::new());
    assert_eq!(solution.status, Status::Completed, "{:?}", solution.error);
    solution.table.expect("a table")
}

fn numbers(table: &Table, name: &str) -> Vec<f64> {
    let values = table.column(name).unwrap_or_else(|| panic!("there is no column `{name}`"));
    (0..values.len()).map(|row| values.number(row).unwrap_or(f64::NAN)).collect()
}

fn words(table: &Table, name: &str) -> Vec<String> {
    let values = table.column(name).unwrap_or_else(|| panic!("there is no column `{name}`"));
    (0..values.len()).map(|row| values.word(row).unwrap_or_default().to_owned()).collect()
}

#[test]
fn a_ball_rests_when_its_bounces_sum_up_over_restitution_and_height() {
    let table = table(&json!({
        "problem": {"mechanical": {"parameters": {"g": 9.81, "e": 0.5}, "coordinates": {"y": {"initial": 1}}, "mass": [[1]],
            "potential": "g*y", "contacts": [{"name": "floor", "gap": "y", "restitution": "e"}]}},
        "time": {"end": 12}, "method": {"rtol": 1e-9, "atol": 1e-12},
        "sweep": {"over": {"e": {"linspace": [0.1, 0.8, 5]}, "y.initial": [0.1, 1, 2]},
            "collect": {"rest": {"time_of_last": {"kind": "impact", "of": "floor"}}, "first": {"time_of_first": "impact"},
                "speed": {"max": "abs(y_dot)"}, "bounces": {"count": "impact"}, "mean": {"mean": "y"}}}}));
    let (e, h) = (numbers(&table, "e"), numbers(&table, "y.initial"));
    let (rest, first, speed) = (numbers(&table, "rest"), numbers(&table, "first"), numbers(&table, "speed"));
    assert_eq!((table.rows(), table.failed), (15, 0));
    let g = 9.81_f64;
    for row in 0..table.rows() {
        let fall = (2.0 * h[row] / g).sqrt();
        // Each bounce lasts e times as long as the previous one: the ball rests at t = fall (1 + 2 e + 2 e^2 + ..).
        let exact = fall * (1.0 + e[row]) / (1.0 - e[row]);
        assert!((first[row] - fall).abs() <= 1e-9 * fall, "row {row}: {} for {fall}", first[row]);
        assert!((rest[row] - exact).abs() <= 1e-5 * exact, "row {row}: {} for {exact}", rest[row]);
        // The largest speed of the ball is that before the first impact, where the velocity jumps.
        let impact = (2.0 * g * h[row]).sqrt();
        assert!((speed[row] - impact).abs() <= 1e-7 * impact, "row {row}: {} for {impact}", speed[row]);
        // The integral of the height over the first fall, of the duration T from the height h, is 2/3 h T, and over
        // the k-th bounce it is 4/3 e^2k h e^k T.
        let (e, h) = (e[row], h[row]);
        let area = h * fall * (2.0 / 3.0 + 4.0 / 3.0 * e.powi(3) / (1.0 - e.powi(3)));
        let mean = numbers(&table, "mean")[row];
        assert!((mean - area / 12.0).abs() <= 1e-6 * area, "row {row}: {mean} for {}", area / 12.0);
    }
}

/// A mass released on a belt slides back as `x = f + (x_0 - f) cos t`, and reaches the belt's speed at `x = f -
/// sqrt((x_0 - f)^2 - v^2)` unless it stays slower; there it sticks if `|x| <= f`.
#[test]
fn the_map_of_modes_of_a_belt_has_the_known_borders() {
    let x_0 = 3.0_f64;
    let table = table(&json!({
        "problem": {"dvi": {"parameters": {"f": 1, "v_belt": 0.5},
            "states": {"x": {"initial": x_0, "rate": "v"}, "v": {"initial": 0, "rate": "-x - F"}},
            "variables": {"F": {"inequality": "-(v - v_belt)"}}, "set": [{"box": {"of": ["F"], "lower": "-f", "upper": "f"}}]}},
        "time": {"end": 6}, "method": {"rtol": 1e-8},
        "sweep": {"over": {"v_belt": {"linspace": [0.11, 2.93, 17]}, "f": {"linspace": [0.07, 1.37, 13]}},
            "collect": {"modes": "mode_word", "sticks_at": {"time_of_first": {"kind": "activated", "of": "F"}}, "low": {"min": "v"}}}}));
    let (v, f, modes) = (numbers(&table, "v_belt"), numbers(&table, "f"), words(&table, "modes"));
    let (sticks_at, low) = (numbers(&table, "sticks_at"), numbers(&table, "low"));
    let mut met = [0; 3];
    for row in 0..table.rows() {
        let amplitude = x_0 - f[row];
        let reaches = v[row] < amplitude;
        let sticks = reaches && (amplitude.powi(2) - v[row].powi(2)).sqrt() <= 2.0 * f[row];
        let mode = &modes[row];
        assert!(mode.starts_with("F.lower"), "{mode}");
        match (reaches, sticks) {
            (false, _) => assert_eq!(mode, "F.lower", "v {} f {}", v[row], f[row]),
            (true, true) => assert!(mode.starts_with("F.lower>free"), "v {} f {}: {mode}", v[row], f[row]),
            (true, false) => assert!(mode.starts_with("F.lower>F.upper"), "v {} f {}: {mode}", v[row], f[row]),
        }
        met[usize::from(reaches) + usize::from(sticks)] += 1;
        if sticks {
            let exact = PI + (v[row] / amplitude).asin();
            assert!((sticks_at[row] - exact).abs() < 1e-7, "{} for {exact}", sticks_at[row]);
        }
        assert!((low[row] + amplitude).abs() < 1e-6, "{} for {}", low[row], -amplitude);
    }
    assert!(met.iter().all(|count| *count > 10), "{met:?}");
}

#[test]
fn reducers_are_those_of_the_solution_and_not_of_output_times() {
    // The solution of the oscillator is x = cos t, v = -sin t, up to t = 5 pi/2.
    let end = 5.0 * FRAC_PI_2;
    let row = table(&json!({
        "problem": {"dvi": {"parameters": {"w": 1}, "definitions": {"energy": "(x^2 + v^2)/2"}, "integrals": {"E": "x^2"},
            "states": {"x": {"initial": 1, "rate": "v"}, "v": {"initial": 0, "rate": "-w*x"}}}},
        "time": {"end": end}, "method": {"rtol": 1e-11, "atol": 1e-13}, "output": {"times": [0.3]},
        "stop": [{"when": "x", "label": "zero", "record": true}],
        "sensitivities": {"to": ["w"]},
        "sweep": {"over": {"w": [1]}, "collect": {
            "initial": {"initial": "x + 1"}, "final": {"final": "v"}, "min": {"min": "x*v"}, "max": {"max": "abs(v)"},
            "ripple": {"ripple": "x"}, "mean": {"mean": "x"}, "rms": {"rms": "v"}, "integral": {"integral": "x^2"},
            "E": {"final": "E"}, "at": {"at": {"t": 1.25, "of": "x - v"}}, "energy": {"max": "energy"},
            "zeros": {"count": {"kind": "crossed", "of": "zero"}}, "second": {"time_of_last": "crossed"},
            "slope": {"final": "dx/dw"}}}}));
    // Each quantity that the sweep collects, with its exact value; the derivative dx/dw of cos(sqrt(w) t) at w = 1 is
    // -t/2 sin t.
    let told = [
        ("initial", 2.0),
        ("final", -1.0),
        ("min", -0.5),
        ("max", 1.0),
        ("ripple", 2.0),
        ("mean", 1.0 / end),
        ("rms", 0.5_f64.sqrt()),
        ("integral", end / 2.0),
        ("E", end / 2.0),
        ("at", 1.25_f64.cos() + 1.25_f64.sin()),
        ("energy", 0.5),
        ("slope", -end / 2.0),
    ];
    for (name, exact) in told {
        let found = numbers(&row, name)[0];
        assert!((found - exact).abs() < 2e-9, "{name}: {found} for {exact}");
    }
    // The third zero of x is at the end of the run, and may be detected or not.
    assert!([2.0, 3.0].contains(&numbers(&row, "zeros")[0]));
    let third = numbers(&row, "second")[0] / FRAC_PI_2;
    assert!((third - third.round()).abs() < 1e-9, "{third}");
}

/// Means over time of integrands with a peak or a pulse that is narrow compared with a step.
#[test]
fn means_of_narrow_features_are_exact() {
    for (name, over, expression, exact) in [
        ("m", "mean", "exp(-((x - 47.1)/0.1)^2)", 1e-3 * PI.sqrt()),
        ("m", "rms", "3*pulse(t, 33.3777, 0.001)", 3.0 * 1e-5_f64.sqrt()),
        ("m", "integral", "x*pulse(t, 33.3777, 0.001)", 1e-3 * 33.3782),
    ] {
        let row = table(&json!({
            "problem": {"dvi": {"parameters": {"w": 1}, "states": {"x": {"initial": 0, "rate": "w"}}}},
            "time": {"end": 100}, "method": {"rtol": 1e-9}, "output": {"times": [100]},
            "sweep": {"over": {"w": [1]}, "collect": {name: {over: expression}}}}));
        let found = numbers(&row, name)[0];
        assert!((found - exact).abs() < 1e-8 * exact, "{over}: {found} for {exact}");
    }
}

#[test]
fn integrals_and_means_take_the_impulses_of_jumps() {
    // The lower bound of x rises from 0 to 1 at t = 1 and lifts x by an impulse of z/2 of size 1; from then on z = 2
    // holds x until t = 3.
    let swept = |collect: Value| {
        table(
            &json!({"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 0, "rate": "-x + k*z/2"}},
                "variables": {"z": {"inequality": "x - heaviside(t - 1)"}}, "set": [{"nonnegative": ["z"]}]}},
            "time": {"end": 3}, "sweep": {"over": {"k": [1]}, "collect": collect}}),
        )
    };
    let row = swept(json!({"I": {"integral": "z"}, "m": {"mean": "z + x"}, "rms_of_x": {"rms": "x"}}));
    for (name, exact) in [("I", 6.0), ("m", 8.0 / 3.0), ("rms_of_x", (2.0_f64 / 3.0).sqrt())] {
        let found = numbers(&row, name)[0];
        assert!((found - exact).abs() < 1e-6, "{name}: {found} for {exact}");
    }
    let trusted = |collect| swept(collect).column("trusted").cloned();
    assert_eq!(trusted(json!({"I": {"integral": "z"}})), Some(Values::Flags(vec![true])));
    assert_eq!(trusted(json!({"I": {"rms": "z"}})), Some(Values::Flags(vec![false])));
}

#[test]
fn extremes_between_the_times_that_are_examined_are_found() {
    // The state is x = t, and every peak of the collected expression has the height 1.
    for peak in
        ["pulse(t, 0.6, 0.01)", "pulse(t, 0.6, 1e-7)", "max(0, 1 - abs(t - 0.618)/0.01)", "exp(-((x - 0.618)/1e-4)^2)"]
    {
        for (over, expression) in [("max", peak.to_owned()), ("min", format!("-({peak})"))] {
            let row = table(
                &json!({"problem": {"dvi": {"parameters": {"p": 1}, "states": {"x": {"initial": 0, "rate": "p"}}}},
                "time": {"end": 1}, "sweep": {"over": {"p": [1]}, "collect": {"m": {over: expression}}}}),
            );
            let found = numbers(&row, "m")[0].abs();
            assert!((found - 1.0).abs() < 1e-9, "{over} of {peak}: {found}");
            assert_eq!(row.column("trusted"), Some(&Values::Flags(vec![true])), "{peak}");
        }
    }
}

#[test]
fn extremes_are_found_where_a_run_begins_at_a_jump() {
    // The sawtooth comes to 1 in each of its periods, while the state rises from 1 to 1.15 and returns: the exact value
    // is the maximum of the expression.
    for (expression, exact) in
        [("sawtooth(t, 0.1)^4*p", 1.0), ("sawtooth(t, 0.1)^2/x", 1.0), ("mod(t, 0.05)/0.05/x", 1.0)]
    {
        let row = table(&json!({"problem": {"dvi": {"parameters": {"p": 1},
                "states": {"x": {"initial": "1", "rate": "0.3*p*(2*pwm(t, 1, 0.5) - 1)"}}}},
            "time": {"end": 2}, "sweep": {"over": {"p": [1]}, "collect": {"m": {"max": expression}}}}));
        let found = numbers(&row, "m")[0];
        assert!((found - exact).abs() < 1e-6, "{expression}: {found}");
    }
}

#[test]
fn what_has_no_finite_value_is_not_trusted() {
    for collect in
        [json!({"max": "1/(t - 0.5)"}), json!({"final": "ln(x - p)"}), json!({"at": {"t": 0.5, "of": "1/(t - 0.5)"}})]
    {
        let row =
            table(&json!({"problem": {"dvi": {"parameters": {"p": 1}, "states": {"x": {"initial": 0, "rate": "p"}}}},
            "time": {"end": 1}, "sweep": {"over": {"p": [1]}, "collect": {"m": collect}}}));
        assert_eq!(row.column("trusted"), Some(&Values::Flags(vec![false])), "{collect}");
    }
}

#[test]
fn a_value_at_a_time_after_an_event_that_ends_the_run_is_missing_and_no_fault() {
    let row =
        table(&json!({"problem": {"dvi": {"parameters": {"p": 1}, "states": {"x": {"initial": 0, "rate": "p"}}}},
        "time": {"end": 2}, "stop": [{"when": "x - 1"}],
        "sweep": {"over": {"p": [1]}, "collect": {"late": {"at": {"t": 1.5, "of": "x"}}, "end": {"final": "x"}}}}));
    assert!(numbers(&row, "late")[0].is_nan() && (numbers(&row, "end")[0] - 1.0).abs() < 1e-9);
    assert_eq!(row.column("trusted"), Some(&Values::Flags(vec![true])));
}

#[test]
fn jumps_of_a_state_are_counted_by_its_name() {
    let row = table(
        &json!({"problem": {"dvi": {"parameters": {"p": 1}, "states": {"x": {"initial": 0, "rate": "p*z"}},
            "variables": {"z": {"inequality": "x - floor(t)"}}, "set": [{"nonnegative": ["z"]}]}},
        "time": {"end": 2.5}, "sweep": {"over": {"p": [1]}, "collect": {
            "jumps": {"count": {"kind": "jumped", "of": "x"}}, "last": {"time_of_last": {"kind": "jumped", "of": "x"}}}}}),
    );
    assert_eq!((numbers(&row, "jumps")[0], numbers(&row, "last")[0]), (2.0, 2.0));
}

#[test]
fn means_have_the_order_of_their_points() {
    // The mean of a e^-k over a in (1, 2) and k in (0, 1) is 3/2 (1 - 1/e).
    let exact = 1.5 * (1.0 - (-1.0_f64).exp());
    let error = |design: &str, count: u64, seed: u64| {
        let specification = json!({
            "problem": {"dvi": {"parameters": {"k": 0.5}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}},
            "time": {"end": 1}, "method": {"rtol": 1e-9, "atol": 1e-12},
            "sweep": {"over": {"k": {"uniform": [0, 1]}, "x.initial": {"uniform": [1, 2]}}, "design": design, "count": count, "seed": seed}});
        let solution = dvi::solve_on(NonZeroUsize::new(2).unwrap(), &read(&specification), &Control::new());
        solution.summary.expect("a summary")["x"].mean - exact
    };
    let spread = |design, count| {
        let squares: f64 = (0..12).map(|seed| error(design, count, seed).powi(2)).sum();
        (squares / 12.0).sqrt()
    };
    for (design, least, most) in [("random", 0.25, 0.75), ("sobol", 0.95, 2.0), ("latin_hypercube", 0.5, 1.6)] {
        let (few, many) = (spread(design, 16), spread(design, 512));
        let order = (few / many).ln() / 32.0_f64.ln();
        assert!((least..most).contains(&order), "{design}: {few:e} and {many:e}, order {order}");
    }
}

/// Specification of a sweep in which the equations of some members have another structure (`k = 0`, an exponent `p`),
/// and in which some members fail.
fn mixed() -> Value {
    json!({
        "problem": {"dvi": {"parameters": {"k": 1, "f": 1, "p": 1},
            "states": {"x": {"initial": 3, "rate": "v"}, "v": {"initial": 0, "rate": "-k*x - F - 0.01*abs(x)^p"}},
            "variables": {"F": {"inequality": "-(v - 0.5)"}}, "set": [{"box": {"of": ["F"], "lower": "-f", "upper": "f"}}]}},
        "time": {"end": 4},
        "sweep": {"over": {"k": [0, 0.5, 1], "f": [-1, 0, 0.5, 1], "p": [1, 2], "x.initial": {"linspace": [1, 3, 5]}},
            "collect": {"x": {"final": "x"}, "top": {"max": "v"}, "modes": "mode_word", "n": {"count": "activated"}}}})
}

fn json_of(solution: &Solution) -> String {
    let mut out = Vec::new();
    encodings::write_json(solution, &mut out).unwrap();
    String::from_utf8(out).unwrap()
}

#[test]
fn the_bytes_are_the_same_however_the_work_is_shared() {
    let specification = read(&mixed());
    let control = Control::new();
    let members = specification.sweep().unwrap().members();
    let by = |threads| json_of(&dvi::solve_on(NonZeroUsize::new(threads).unwrap(), &specification, &control));
    let whole = by(1);
    assert_eq!(by(2), whole);
    assert_eq!(by(16), whole);
    let cuts = [0, 7, 7, 60, members];
    let part = |cut: &[usize]| dvi::study::sweep(&specification, cut[0]..cut[1], NonZeroUsize::MIN, &control);
    let mut parts: Vec<Solution> = cuts.windows(2).map(part).collect();
    parts.reverse();
    // Merges the results of the parts of the sweep after writing each as JSON and reading it back, as the program does.
    let read_back = |part: &Solution| encodings::read_json(json_of(part).as_bytes()).unwrap().table.unwrap();
    assert_eq!(json_of(&dvi::study::merge(parts.iter().map(read_back)).unwrap()), whole);
    let missing = dvi::study::merge(parts[1..].iter().map(read_back)).unwrap();
    assert_eq!(missing.error.unwrap().code, "members_missing");
    let other =
        read(&json!({"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 3, "rate": "-k*x"}}}},
        "time": {"end": 1}, "sweep": {"over": {"k": [1]}}}));
    let other = dvi::solve(&other, &control).table.unwrap();
    assert!(dvi::study::merge([read_back(&parts[0]), other]).is_err());
}

#[test]
fn a_member_is_the_solve_of_its_values_alone() {
    let specification = mixed();
    let table = table(&specification);
    let mut alone = specification.clone();
    alone.as_object_mut().unwrap().remove("sweep");
    let names = ["k", "f", "p", "x.initial"];
    let (status, x) = (words(&table, "status"), numbers(&table, "x"));
    assert_eq!(table.failed, 30);
    for row in (0..table.rows()).step_by(7) {
        let values = names.map(|name| (name.to_owned(), numbers(&table, name)[row].to_string()));
        let text = edited(alone.to_string().as_bytes(), &values).unwrap();
        match Specification::from_json(&text) {
            Err(_) => assert_eq!((status[row].as_str(), x[row].is_nan()), ("failed", true), "row {row}"),
            Ok(member) => {
                let solution = dvi::solve(&member, &Control::new());
                let end = *solution.trajectory.field("x").unwrap().last().unwrap();
                assert_eq!(status[row], "completed");
                assert!((end - x[row]).abs() <= 1e-6 * (1.0 + end.abs()), "row {row}: {end} and {}", x[row]);
            }
        }
    }
}

#[test]
fn trajectories_that_are_kept_are_those_of_the_solves_alone() {
    let mut specification = json!({
        "problem": {"dvi": {"parameters": {"k": 1, "f": 1},
            "states": {"x": {"initial": 2, "rate": "v"}, "v": {"initial": 0, "rate": "-k*x - s"}},
            "variables": {"s": {"inequality": "-v"}}, "set": [{"box": {"of": ["s"], "lower": "-f", "upper": "f"}}]}},
        "time": {"end": 3}, "output": {"times": [0, 0.5, 1, 3], "fields": ["v", "s"]},
        "sweep": {"over": {"k": [1, 2, 3], "f": [-1, 0.1, 0.5]}, "keep": "trajectories"}});
    let whole = json_of(&dvi::solve(&read(&specification), &Control::new()));
    let json: Value = serde_json::from_str(&whole).unwrap();
    let columns = &json["table"]["columns"];
    assert_eq!(json["table"]["times"], json!([0.0, 0.5, 1.0, 3.0]));
    let swept = specification.clone();
    specification.as_object_mut().unwrap().remove("sweep");
    // Names in a JSON object are sorted alphabetically, so that the parameter `f` varies more slowly than `k` from
    // row to row.
    for (row, (f, k)) in [-1.0, 0.1, 0.5].iter().flat_map(|f| [1, 2, 3].map(|k| (*f, k))).enumerate() {
        if f < 0.0 {
            assert!(columns["trajectory.v"][row].is_null() && columns["status"][row] == "failed");
            continue;
        }
        let parameters = &mut specification["problem"]["dvi"]["parameters"];
        (parameters["k"], parameters["f"]) = (json!(k), json!(f));
        let alone = dvi::solve(&read(&specification), &Control::new());
        for name in ["v", "s"] {
            let told = &columns[format!("trajectory.{name}")][row];
            assert_eq!(told, &json!(alone.trajectory.field(name).unwrap()), "{name} of row {row}");
        }
        assert_eq!(columns["x"][row].as_f64().map(f64::to_bits), Some(x_at_the_end(&specification).to_bits()));
    }
    let read_back = encodings::read_json(whole.as_bytes()).unwrap().table.unwrap();
    assert_eq!(serde_json::to_value(&read_back).unwrap(), json["table"]);
    for (form, told) in [(MembersForm::Csv, ",\"[0.0,-"), (MembersForm::Lines, "\"trajectory.v\":[0.0,-")] {
        let (mut bytes, solution) = (Vec::new(), Solution { table: Some(read_back.clone()), ..Solution::default() });
        encodings::write_members(&solution, form, &mut bytes).unwrap();
        assert_eq!(String::from_utf8(bytes).unwrap().matches(told).count(), 6, "{form:?}");
    }
    let parts = [0..2, 2..4, 4..9].map(|members| {
        let part = dvi::study::sweep(&read(&swept), members, NonZeroUsize::MIN, &Control::new());
        encodings::read_json(json_of(&part).as_bytes()).unwrap().table.unwrap()
    });
    assert_eq!(json_of(&dvi::study::merge(parts).unwrap()), whole);
}

/// Solves a specification with the output field `x` alone, and returns its final value.
fn x_at_the_end(specification: &Value) -> f64 {
    let mut specification = specification.clone();
    specification["output"]["fields"] = json!(["x"]);
    *dvi::solve(&read(&specification), &Control::new()).trajectory.field("x").unwrap().last().unwrap()
}

#[test]
fn members_that_fail_are_rows_and_what_is_missing_is_null() {
    let solution = dvi::solve(&read(&mixed()), &Control::new());
    let table = solution.table.as_ref().unwrap();
    let (status, errors) = (words(table, "status"), words(table, "error"));
    let f = numbers(table, "f");
    for row in 0..table.rows() {
        assert_eq!(status[row] == "failed", f[row] < 0.0);
        assert_eq!(errors[row].starts_with("empty_set: "), f[row] < 0.0, "{}", errors[row]);
    }
    assert_eq!(solution.verdict.caveats[0].code, "failed_members");
    assert_eq!(solution.summary.as_ref().unwrap()["x"].count, 90);
    let text = json_of(&solution);
    let json: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["table"]["columns"]["x"][0], Value::Null);
    assert!(!text.contains("NaN"));
}

#[test]
fn a_sweep_that_is_cancelled_keeps_its_rows() {
    let control = Control::new();
    control.cancel();
    let solution = dvi::solve(&read(&mixed()), &control);
    assert_eq!((solution.status, solution.error.unwrap().code.as_ref()), (Status::Stopped, "cancelled"));
    assert_eq!(solution.table.unwrap().rows(), 0);
}

#[test]
fn ripple_over_duty_is_that_of_the_orbits() {
    let text = include_str!("../../api/examples/buck_orbit.json");
    let mut specification: Value = serde_json::from_str(text).unwrap();
    let field = {
        let orbit = solve(&specification).orbit.expect("an orbit");
        orbit.over_period.into_iter().find(|(_, over)| over.ripple > 0.0).expect("a field that varies")
    };
    let (_, problem) = specification["problem"].as_object().unwrap().iter().next().unwrap();
    let (name, value) = problem["parameters"].as_object().unwrap().iter().find(|(_, value)| value.is_number()).unwrap();
    let (name, value) = (name.clone(), value.as_f64().unwrap());
    specification["sweep"] = json!({"over": {(name): [value]}, "collect": {"ripple": {"ripple": field.0}}});
    let table = table(&specification);
    let found = numbers(&table, "ripple")[0];
    assert!((found - field.1.ripple).abs() <= 1e-9 * field.1.ripple, "{found} for {}", field.1.ripple);
    assert!(numbers(&table, "period")[0] > 0.0);
}

#[test]
fn components_and_elements_of_vectors_are_swept_by_name() {
    // An RC circuit with the voltage v = 1 - e^(-t/(R C)).
    let circuit = table(&json!({
        "problem": {"circuit": {"components": [
            {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": 1}},
            {"resistor": {"name": "R1", "nodes": ["in", "out"], "ohms": 10}},
            {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": 0.1}}]}},
        "time": {"end": 1}, "method": {"rtol": 1e-9, "atol": 1e-12},
        "sweep": {"over": {"R1": [1, 5, 20], "C1": [0.1, 0.2]}, "collect": {"v": {"final": "v(C1)"}}}}));
    for row in 0..6 {
        let rc = numbers(&circuit, "R1")[row] * numbers(&circuit, "C1")[row];
        assert!((numbers(&circuit, "v")[row] - (1.0 - (-1.0 / rc).exp())).abs() < 1e-7, "row {row}");
    }
    let chain = table(&json!({
        "problem": {"dvi": {"parameters": {"n": 3}, "states": {"x[1..n]": {"initial": "i", "rate": "-i*x[i]"}}}},
        "time": {"end": 1}, "method": {"rtol": 1e-9, "atol": 1e-12},
        "sweep": {"over": {"x[2].initial": [1, 4]}, "collect": {"x": {"final": "x[2]"}, "sum": {"final": "sum(x)"}}}}));
    for (row, start) in [1.0, 4.0].into_iter().enumerate() {
        assert!((numbers(&chain, "x")[row] - start * (-2.0_f64).exp()).abs() < 1e-7);
    }
    let sizes = table(&json!({
        "problem": {"dvi": {"parameters": {"n": 2}, "states": {"x[1..n]": {"initial": 1, "rate": "-x[i]"}}}},
        "time": {"end": 1}, "sweep": {"over": {"n": [1, 2, 5]}, "collect": {"sum": {"final": "sum(x)"}}}}));
    for (row, n) in [1.0, 2.0, 5.0].into_iter().enumerate() {
        assert!(
            (numbers(&sizes, "sum")[row] - n * (-1.0_f64).exp()).abs() < 1e-5,
            "row {row}: {:?}",
            words(&sizes, "error")
        );
    }
}

#[test]
fn states_of_rest_are_swept() {
    // For x' = a - x - z with 0 <= z and x <= 1, the steady state is x = min(a, 1).
    let table = table(&json!({
        "problem": {"dvi": {"parameters": {"a": 0.5}, "states": {"x": {"initial": 0, "rate": "a - x"}}}},
        "steady_state": {}, "sweep": {"over": {"a": [0.5, 2]}}}));
    assert!(numbers(&table, "x").iter().zip([0.5, 2.0]).all(|(x, a)| (x - a).abs() < 1e-6));
    assert_eq!(words(&table, "stable"), ["yes", "yes"]);
}

#[test]
fn a_period_that_depends_on_what_is_varied_is_that_of_each_member() {
    // For x' = cos(wt) - x, the integral of x^2 over the period is pi/(w (1 + w^2)).
    let speeds = [0.5, 1.0, 2.0, 4.0];
    let table = table(
        &json!({"problem": {"dvi": {"parameters": {"w": 1}, "states": {"x": {"initial": 0, "rate": "cos(w*t) - x"}}}},
        "periodic": {"period": "2*pi/w"}, "method": {"rtol": 1e-9},
        "sweep": {"over": {"w": speeds}, "collect": {"power": {"integral": "x^2"}}}}),
    );
    for (w, found) in speeds.into_iter().zip(numbers(&table, "power")) {
        let exact = PI / (w * (1.0 + w * w));
        assert!((found / exact - 1.0).abs() < 1e-7, "{w}: {found}, not {exact}");
    }
}

#[test]
fn a_member_without_an_orbit_collects_nothing() {
    // For x' = 1 + cos t - b x, the state drifts if b = 0; otherwise its orbit has the mean 1/b.
    let table = table(
        &json!({"problem": {"dvi": {"parameters": {"b": 1}, "states": {"x": {"initial": 0, "rate": "1 + cos(t) - b*x"}}}},
        "periodic": {"period": "2*pi"}, "method": {"rtol": 1e-9},
        "sweep": {"over": {"b": [0, 1, 2]}, "collect": {"mean": {"mean": "x"}, "end": {"final": "x"}, "begin": {"initial": "x"}}}}),
    );
    assert_eq!(words(&table, "status"), ["failed", "completed", "completed"]);
    let mean = numbers(&table, "mean");
    assert!((mean[1] - 1.0).abs() < 1e-7 && (mean[2] - 0.5).abs() < 1e-7, "{mean:?}");
    for column in ["mean", "end", "begin"] {
        let found = numbers(&table, column);
        assert!(found[0].is_nan() && found[1].is_finite(), "{column}: {found:?}");
    }
}
