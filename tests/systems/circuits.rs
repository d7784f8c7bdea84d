//! Circuits with ideal diodes: bridges of four diodes, and a rectifier with one diode.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::reference::{digits, example, switching};
use serde_json::json;

/// Asserts that no complementarity variable of a circuit and no inequality is ever negative.
fn assert_complementary(solution: &dvi::solution::Solution, variables: &[&str]) {
    for name in variables {
        let least = column(solution, name).iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least >= 0.0, "`{name}` falls to {least}");
    }
}

#[test]
fn the_diode_bridge_reaches_its_reference() {
    let reference = switching("diode_bridge");
    for name in ["diode_bridge", "diode_bridge_dvi"] {
        let solution = solve(&example(name));
        for (state, field) in ["v", "i"].iter().enumerate() {
            let exact = digits(&reference["x_T"][state]);
            let error = (last(&solution, field) / exact - 1.0).abs();
            assert!(error < 1e-8, "{name}: `{field}` is off by {error:e} relative");
        }
        assert_complementary(&solution, &["v_R1", "v_F2", "i_F1", "i_R2"]);
        let switches = reference["switches"].as_u64();
        assert!(solution.diagnostics.switches >= switches.expect("a count"), "{}", solution.diagnostics.switches);
        // The two diodes of each branch of the bridge conduct alternately: one of their currents is always zero, and
        // their sum is the absolute load current.
        let (forward, backward) = (column(&solution, "i_F1"), column(&solution, "i_R2"));
        assert!(forward.iter().chain(backward).any(|&current| current > 1e-3));
    }
}

#[test]
fn a_bridge_charges_an_empty_capacitor_from_the_zero_of_its_source() {
    // At the start the voltage and current of every diode are zero. The reference value of the capacitor voltage joins
    // closed forms of the charging and discharging phases, in 30 digits.
    let (voltage, times) = (5.725_303_018_916_766, [0.008_663_621_010_819_184, 0.011_309_363_758_714_332]);
    for (rtol, unit) in [(1e-3, 1.0), (1e-6, 1.0), (1e-9, 1.0), (1e-6, 1e-6), (1e-6, 1e6)] {
        // The resistances and the capacitance are scaled so that the voltages do not change, and the currents are the
        // same numbers in another unit of current.
        let (ohms, farads) = (10.0 / unit, 1e-3 * unit);
        let solution = solve(&json!({"problem": {"circuit": {"components": [
                {"voltage_source": {"name": "V", "nodes": ["a", "b"], "volts": "10*sin(314*t)"}},
                {"resistor": {"name": "Rs", "nodes": ["a", "c"], "ohms": ohms}},
                {"diode": {"name": "D1", "nodes": ["c", "p"]}}, {"diode": {"name": "D2", "nodes": ["b", "p"]}},
                {"diode": {"name": "D3", "nodes": ["0", "c"]}}, {"diode": {"name": "D4", "nodes": ["0", "b"]}},
                {"capacitor": {"name": "C", "nodes": ["p", "0"], "farads": farads}},
                {"resistor": {"name": "R", "nodes": ["p", "0"], "ohms": 10.0 * ohms}}]}},
            "time": {"end": 0.02}, "method": {"rtol": rtol}}));
        assert!(solution.verdict.trusted, "{rtol:e} {unit:e}: {:?}", solution.verdict);
        let error = (last(&solution, "v(C)") / voltage - 1.0).abs();
        assert!(error < 10.0 * rtol, "{rtol:e} {unit:e}: off by {error:e}");
        for time in times {
            let off = |event: &dvi::solution::Event| (event.t - time).abs();
            let nearest = solution.trajectory.events.iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(nearest < rtol * 0.02, "{rtol:e} {unit:e}: no event within {nearest:e} of {time}");
        }
    }
}

#[test]
fn the_filtered_bridge_reaches_its_reference() {
    let reference = switching("diode_bridge_filter");
    let mut specification = example("diode_bridge_filter");
    specification["method"]["rtol"] = json!(1e-10);
    let solution = solve(&specification);
    let names: Vec<String> = solution.trajectory.fields.iter().map(|field| field.name.clone()).collect();
    for (state, name) in names.iter().take(3).enumerate() {
        let exact = digits(&reference["x_T"][state]);
        let error = (last(&solution, name) / exact - 1.0).abs();
        assert!(error < 1e-7, "`{name}` is off by {error:e} relative");
    }
    // Each pair of diodes starts or stops conducting at the switch times of the reference table.
    let times: Vec<f64> = solution.trajectory.events.iter().map(|event| event.t).collect();
    for mode in reference["modes"].as_array().expect("modes").iter().skip(1) {
        let exact = digits(&mode[0]);
        let nearest = times.iter().map(|t| (t - exact).abs()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-11, "no event within {nearest:e} of {exact}");
    }
}

#[test]
fn the_filtered_bridge_jumps_from_an_inconsistent_start() {
    let reference = switching("diode_bridge_filter");
    let mut specification = example("diode_bridge_filter");
    specification["method"]["rtol"] = json!(1e-10);
    specification["problem"]["lcs"]["initial"] = reference["x0_inconsistent"].clone();
    let solution = solve(&specification);
    assert!(solution.diagnostics.warnings.iter().any(|warning| warning.code == "initial_jump"));
    for (state, field) in solution.trajectory.fields.iter().take(3).enumerate() {
        let after = digits(&reference["x0"][state]);
        assert!((field.values[0] - after).abs() < 1e-9, "`{}` starts from {}", field.name, field.values[0]);
        let error = (field.values.last().expect("values") / digits(&reference["x_T"][state]) - 1.0).abs();
        assert!(error < 1e-7, "`{}` is off by {error:e} relative", field.name);
    }
}

#[test]
fn the_rectifier_follows_its_closed_form() {
    let (v, r, l, omega) = (10.0_f64, 10.0_f64, 0.02_f64, 100.0 * std::f64::consts::PI);
    let impedance = r.hypot(omega * l);
    let phi = (omega * l).atan2(r);
    let t_off = 0.011_790_323_194_208_857;
    let period = 0.02;
    let solution = solve(&example("rectifier"));
    let exact = |t: f64| {
        let t = t % period;
        if t < t_off { v / impedance * ((omega * t - phi).sin() + phi.sin() * (-r / l * t).exp()) } else { 0.0 }
    };
    let error = distance(&solution, "i", exact);
    assert!(error < 1e-7, "the current is off by {error:e}");
    let blocked = events(&solution, "v_diode");
    let nearest = blocked.iter().map(|t| (t - t_off).abs()).fold(f64::INFINITY, f64::min);
    assert!(nearest < 1e-9, "the diode blocks {nearest:e} off its time");
    assert_complementary(&solution, &["v_diode"]);
}
