//! Circuits controlled by voltages and currents: controlled sources, limiters, amplifiers, comparators, transformers,
//! and a converter in a closed loop.

use crate::systems::harness::{column, events, last, solve};
use crate::systems::reference::example;
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

fn circuit(components: Value, end: f64) -> Value {
    json!({
        "problem": {"circuit": {"components": components}}, "time": {"end": end}, "method": {"rtol": 1e-10, "atol": 1e-12},
        "output": {"times": {"count": 11}}
    })
}

#[track_caller]
fn assert_near(found: f64, exact: f64, tolerance: f64) {
    assert!(
        (found - exact).abs() <= tolerance * exact.abs().max(1.0),
        "{found} for {exact}: off by {:e}",
        found - exact
    );
}

/// Reference for the buck converter: matrix exponentials between switching times in 30 digits, with switching times
/// found by Anderson's iteration, in an independent program which assumes that the coil current never vanishes.
#[test]
fn a_buck_converter_in_a_closed_loop_is_exact_over_two_thousand_switches() {
    let mut specification = example("buck_closed_loop");
    specification["time"]["end"] = json!(0.01);
    specification["method"] = json!({"rtol": 1e-10});
    specification["output"]["times"] = json!("steps");
    let solution = solve(&specification);
    // Reference values of the buck converter: the number of a switching period, and the capacitor voltage and coil
    // current at its end, where a step ends.
    let exact = [
        (1, 0.580_423_786_860_029_6, 0.050_012_019_420_966_06),
        (10, 5.658_879_997_690_433, 2.692_800_285_106_91),
        (50, 2.655_742_165_648_802, 7.168_008_304_133_802),
        (100, 4.246_869_606_185_761, 10.148_101_877_334_505),
        (250, 5.613_068_195_343_417, 11.920_542_033_224_509),
        (500, 5.700_563_383_231_899, 11.998_768_165_084_334),
        (750, 5.699_929_091_213_549, 11.999_926_451_317_842),
        (1000, 5.699_937_048_679_78, 11.999_968_346_703_432),
    ];
    let times = &solution.trajectory.t;
    for (periods, i, v) in exact {
        let end = f64::from(periods) * 1e-5;
        let row = times.partition_point(|t| *t < end - 1e-15);
        assert_near(times[row], end, 1e-15);
        assert_near(column(&solution, "i(L1)")[row], i, 1e-8);
        assert_near(column(&solution, "v(out)")[row], v, 1e-8);
    }
    let switches: Vec<f64> =
        solution.trajectory.events.iter().filter(|event| event.of == "closed(S1)").map(|event| event.t).collect();
    // The switch closes at the beginning of each period of the sawtooth but the first, 999 times within the run, and
    // opens once per period.
    assert_eq!(switches.len(), 1999);
    assert_near(switches[0] * 1e6, 2.427_718_171_639_071, 1e-8);
    assert_near(switches.last().expect("a switch") * 1e3, 9.994_999_999_819_495, 1e-9);
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}

/// With a light load the converter is in discontinuous conduction: for part of each period the coil current `i` is
/// exactly zero, and it is never negative.
#[test]
fn a_converter_in_a_closed_loop_may_run_dry() {
    let mut specification = example("buck_closed_loop");
    specification["problem"]["circuit"]["components"][5]["resistor"]["ohms"] = json!(100);
    specification["problem"]["circuit"]["components"][4]["capacitor"]["volts"] = json!(11);
    let solution = solve(&specification);
    let current = column(&solution, "i(L1)");
    assert!(current.iter().all(|i| *i > -1e-9));
    assert!(current.iter().filter(|i| i.abs() < 1e-12).count() > 20);
}

/// The capacitor of an RC circuit with a hysteresis switch charges with `v' = (E - v)/(R C)` and discharges with `v' =
/// -v/(R C)`, between `2 - 0.1` and `2 + 0.1`.
#[test]
fn a_switch_with_hysteresis_keeps_a_voltage_within_its_band() {
    let mut specification = circuit(
        json!([
            {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": 5}},
            {"switch": {"name": "S1", "nodes": ["in", "a"], "closed": "2 - v(out)", "hysteresis": 0.1}},
            {"resistor": {"name": "R0", "nodes": ["a", "0"], "ohms": 1e3}},
            {"resistor": {"name": "R1", "nodes": ["a", "out"], "ohms": 1e3}},
            {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": 1e-3}}
        ]),
        5.0,
    );
    specification["output"] = json!({"times": {"count": 501}});
    let solution = solve(&specification);
    // Durations of the charging of the capacitor through R1 alone, and of its discharging through R1 and R0 in series.
    let on = |from: f64, to: f64| ((5.0 - from) / (5.0 - to)).ln();
    let off = |from: f64, to: f64| 2.0 * (from / to).ln();
    let (low, high) = (1.9, 2.1);
    let mut exact = vec![on(0.0, high)];
    for k in 0..8 {
        let last = exact[k];
        exact.push(last + if k % 2 == 0 { off(high, low) } else { on(low, high) });
    }
    let found: Vec<f64> =
        solution.trajectory.events.iter().filter(|event| event.of == "closed(S1)").map(|event| event.t).collect();
    for (found, exact) in found.iter().zip(&exact) {
        assert_near(*found, *exact, 1e-8);
    }
    assert!(found.len() > 8, "{found:?}");
    // If the voltage starts within the hysteresis band, the initial state of the switch decides whether it rises.
    for (initially, rises) in [(false, false), (true, true)] {
        specification["problem"]["circuit"]["components"][4]["capacitor"]["volts"] = json!(2.0);
        specification["problem"]["circuit"]["components"][1]["switch"]["initially"] = json!(initially);
        let v = column(&solve(&specification), "v(C1)").to_vec();
        assert_eq!(v[1] > v[0], rises, "{} {}", v[0], v[1]);
    }
}

/// The period of a relaxation oscillator is `2 R C ln((1 + b)/(1 - b))`, where `b` is the ratio of the voltage divider
/// at the comparator.
#[test]
fn a_comparator_with_hysteresis_makes_a_relaxation_oscillator() {
    let specification = circuit(
        json!([
            {"comparator": {"name": "K1", "inputs": ["0", "c"], "nodes": ["o", "0"], "low": -1, "high": 1, "hysteresis": 0.5}},
            {"resistor": {"name": "R1", "nodes": ["o", "c"], "ohms": 2}},
            {"capacitor": {"name": "C1", "nodes": ["c", "0"], "farads": 0.5}}
        ]),
        20.0,
    );
    let solution = solve(&specification);
    let found = events(&solution, "v(K1)");
    let half = 3.0_f64.ln();
    assert_near(found[0], 2.0_f64.ln(), 1e-9);
    for (k, pair) in found.windows(2).enumerate() {
        assert_near(pair[1] - pair[0], half, 1e-8 * (k + 1) as f64);
    }
    assert!(found.len() > 15);
}

/// A circuit without energy storage that contains all four controlled sources of SPICE: its voltages and currents are
/// found by hand.
#[test]
fn controlled_sources_follow_voltages_and_currents() {
    let specification = circuit(
        json!([
            {"voltage_source": {"name": "V1", "nodes": ["a", "0"], "volts": "2 + sin(t)"}},
            {"resistor": {"name": "R1", "nodes": ["a", "0"], "ohms": 2}},
            {"voltage_source": {"name": "E1", "nodes": ["b", "0"], "volts": "3*v(a)"}},
            {"resistor": {"name": "R2", "nodes": ["b", "0"], "ohms": 1}},
            {"current_source": {"name": "F1", "nodes": ["0", "c"], "amperes": "4*i(R1)"}},
            {"resistor": {"name": "R3", "nodes": ["c", "0"], "ohms": 5}},
            {"current_source": {"name": "G1", "nodes": ["0", "d"], "amperes": "0.5*v(c)"}},
            {"resistor": {"name": "R4", "nodes": ["d", "0"], "ohms": 1}},
            {"voltage_source": {"name": "H1", "nodes": ["e", "0"], "volts": "10*i(R4)", "limits": [-30, 150]}},
            {"resistor": {"name": "R5", "nodes": ["e", "0"], "ohms": 1}}
        ]),
        6.0,
    );
    let solution = solve(&specification);
    for (k, t) in solution.trajectory.t.iter().enumerate() {
        let a = 2.0 + t.sin();
        let c = 20.0 * a / 2.0;
        let d = 0.5 * c;
        let exact =
            [("v(a)", a), ("v(E1)", 3.0 * a), ("v(c)", c), ("v(d)", d), ("v(H1)", (10.0 * d).clamp(-30.0, 150.0))];
        for (name, exact) in exact {
            assert_near(column(&solution, name)[k], exact, 1e-9);
        }
    }
    // The limit of 150 V on a controlled source is reached at a maximum of 50 (2 + sin t), where rounding decides
    // whether there are events.
    assert!(events(&solution, "v(H1)").len() <= 2);
}

/// The four controlled sources of SPICE, given as lines of a netlist.
#[test]
fn controlled_sources_of_a_netlist_are_those_of_spice() {
    let netlist = "V1 a 0 SIN(2 1 0.5)\nR1 a 0 2\nE1 b 0 a 0 3\nR2 b 0 1\nVm r 0 0\nR3 b r 4\n\
                   F1 0 c Vm 2\nR4 c 0 5\nG1 0 d c b 0.5\nR5 d 0 1\nH1 e 0 Vm 10\nR6 e 0 1\n";
    let solution = solve(&json!({
        "problem": {"circuit": {"netlist": netlist}}, "time": {"end": 2}, "output": {"times": {"count": 11}}
    }));
    for (k, t) in solution.trajectory.t.iter().enumerate() {
        let a = 2.0 + (std::f64::consts::PI * t).sin();
        let (b, i) = (3.0 * a, 0.75 * a);
        let c = 10.0 * i;
        for (name, exact) in [("v(b)", b), ("v(c)", c), ("v(d)", 0.5 * (c - b)), ("v(e)", 10.0 * i)] {
            assert_near(column(&solution, name)[k], exact, 1e-9);
        }
    }
}

/// An inverting integrator with an operational amplifier: `v' = -u/(R C)` until the output saturates; from then on the
/// differential input voltage is nonzero.
#[test]
fn an_amplifier_integrates_until_it_saturates() {
    let specification = circuit(
        json!([
            {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": "cos(t)"}},
            {"resistor": {"name": "R1", "nodes": ["in", "n"], "ohms": 1000}},
            {"capacitor": {"name": "C1", "nodes": ["n", "out"], "farads": 1e-3}},
            {"op_amp": {"name": "A1", "inputs": ["0", "n"], "nodes": ["out", "0"], "limits": [-0.5, 0.5]}},
            {"resistor": {"name": "R2", "nodes": ["out", "0"], "ohms": 100}}
        ]),
        1.0,
    );
    let solution = solve(&specification);
    let meets = 0.5_f64.asin();
    let found = events(&solution, "v(A1)");
    assert_near(found[0], meets, 1e-9);
    let (t, out) = (&solution.trajectory.t, column(&solution, "v(A1)"));
    for (t, out) in t.iter().zip(out) {
        assert_near(*out, (-t.sin()).max(-0.5), 1e-9);
    }
    // After saturation the capacitor C1 charges through R1 while the output is at its limit: v_n' = cos t - v_n, from
    // v_n = 0.
    let exact = |t: f64| (t.cos() + t.sin()) / 2.0 - (meets.cos() + meets.sin()) / 2.0 * (meets - t).exp();
    assert_near(last(&solution, "v(n)"), exact(1.0), 1e-8);
}

/// Through an ideal transformer a load `R` appears as `ratio^2 R`, and input power equals output power.
#[test]
fn a_transformer_keeps_power_and_turns_a_load_by_the_square_of_its_ratio() {
    let specification = circuit(
        json!([
            {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": 10}},
            {"resistor": {"name": "R1", "nodes": ["in", "p"], "ohms": 20}},
            {"transformer": {"name": "T1", "primary": ["p", "0"], "secondary": ["s", "0"], "ratio": 2}},
            {"capacitor": {"name": "C1", "nodes": ["s", "0"], "farads": 0.1}},
            {"resistor": {"name": "R2", "nodes": ["s", "0"], "ohms": 5}}
        ]),
        1.0,
    );
    let solution = solve(&specification);
    // Equivalent circuit as seen from the secondary side of the transformer: a source of 5 V with 5 ohms, and 5 ohms
    // parallel to 0.1 F.
    let exact = 2.5 * (1.0 - (-1.0_f64 / (0.1 * 2.5)).exp());
    assert_near(last(&solution, "v(s)"), exact, 1e-8);
    let power = |i: &str, v: &str| last(&solution, i) * last(&solution, v);
    let (primary, secondary) = (power("i(T1.primary)", "v(p)"), power("i(T1.secondary)", "v(s)"));
    assert_near(primary, -secondary, 1e-9);
}

/// A boost converter whose switch is driven by a sawtooth that is written as an inverse tangent. Each output time is,
/// up to rounding, a multiple of a fifth of the period, so that some outputs lie on the other side of a jump than the
/// step that contains them. Reference: matrix exponentials from jump to jump; the current never vanishes.
#[test]
fn a_boost_converter_driven_by_a_sawtooth_is_right_at_every_output() {
    let (inductance, capacitance, load, closed, open) = (1e-4, 1e-3, 10.0, 1e-6, 1e7);
    let sawtooth = "atan2(sin(w*(t - 2.5e-06)), cos(w*(t - 2.5e-06)))/w + 2.5e-06".replace('w', "(628318.5307179586)");
    let specification = json!({
        "problem": {"circuit": {"components": [
            {"voltage_source": {"name": "Vin", "nodes": ["in", "0"], "volts": 12}},
            {"inductor": {"name": "L1", "nodes": ["in", "sw"], "henries": inductance, "amperes": 4.8}},
            {"resistor": {"name": "Ron", "nodes": ["sw", "on"], "ohms": closed}},
            {"resistor": {"name": "Roff", "nodes": ["sw", "0"], "ohms": open}},
            {"switch": {"name": "S1", "nodes": ["on", "0"], "closed": "v(g) - 0.5", "hysteresis": 0.1}},
            {"diode": {"name": "D1", "nodes": ["sw", "out"]}},
            {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": capacitance, "volts": 24}},
            {"resistor": {"name": "RL", "nodes": ["out", "0"], "ohms": load}},
            {"voltage_source": {"name": "Vg", "nodes": ["g", "0"],
                                "volts": format!("heaviside({sawtooth}) - heaviside({sawtooth} - 5e-6)")}}
        ]}},
        "time": {"end": 1e-3}, "method": {"rtol": 1e-10, "atol": 1e-13},
        "output": {"times": {"count": 1001}, "fields": ["v(C1)", "i(L1)"]}
    });
    let solution = solve(&specification);
    let shunt = 1.0 / (1.0 / closed + 1.0 / open);
    let over = |rates: [f64; 9]| (1e-6 * Matrix3::from_row_slice(&rates)).exp();
    let charging =
        over([-shunt / inductance, 0.0, 12.0 / inductance, 0.0, -1.0 / (load * capacitance), 0.0, 0.0, 0.0, 0.0]);
    let leaving = 1.0 / (load * capacitance) + 1.0 / (open * capacitance);
    let feeding = over([0.0, -1.0 / inductance, 12.0 / inductance, 1.0 / capacitance, -leaving, 0.0, 0.0, 0.0, 0.0]);
    let (mut exact, mut worst) = (Vector3::new(4.8, 24.0, 1.0), 0.0_f64);
    let (current, voltage) = (column(&solution, "i(L1)"), column(&solution, "v(C1)"));
    for row in 0..1001 {
        worst = worst.max((current[row] - exact[0]).abs()).max((voltage[row] - exact[1]).abs());
        exact = if row % 10 < 5 { charging } else { feeding } * exact;
    }
    assert!(worst < 1e-6, "off by {worst:e} at most");
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
}

fn switched_charge(volts: f64, ohms: f64, load: f64, start: f64, closed: &str, end: f64) -> Value {
    json!({
        "problem": {"circuit": {"components": [
            {"voltage_source": {"name": "V1", "nodes": ["i", "0"], "volts": volts}},
            {"resistor": {"name": "R1", "nodes": ["i", "a"], "ohms": ohms}},
            {"switch": {"name": "S1", "nodes": ["a", "c"], "closed": closed}},
            {"capacitor": {"name": "C1", "nodes": ["c", "0"], "farads": 1e-6, "volts": start}},
            {"resistor": {"name": "R2", "nodes": ["c", "0"], "ohms": load}}
        ]}},
        "time": {"end": end}, "method": {"rtol": 1e-8}, "output": {"times": {"count": 11}}
    })
}

/// A switch without hysteresis that the capacitor voltage keeps closed, and that opens where a ramp overtakes that
/// voltage. A spurious state between open and closed, in which the voltage follows the ramp, would supply energy.
/// Reference: exponentials between switching times.
#[test]
fn a_switch_that_a_ramp_opens_supplies_no_energy() {
    for (volts, ohms, load, start, scale, periods) in
        [(10.0, 1000.0, 1000.0, 3.0, 5.0, 10), (10.0, 100.0, 5000.0, 2.4, 11.38, 5)]
    {
        let period = 1e-3;
        let end = period * f64::from(periods);
        let closed = format!("v(c)/{scale} - sawtooth(t, {period})");
        let solution = solve(&switched_charge(volts, ohms, load, start, &closed, end));
        let (charging, discharging) = ((1.0 / ohms + 1.0 / load) / 1e-6, 1.0 / load / 1e-6);
        let level = volts / ohms / (charging * 1e-6);
        let mut exact: f64 = start;
        for _ in 0..periods {
            let at = |t: f64| level + (exact - level) * (-charging * t).exp();
            // The difference of the scaled voltage and the sawtooth ramp has one zero in the period, where it
            // decreases.
            let (mut before, mut after) = (0.0, period);
            for _ in 0..60 {
                let middle = 0.5 * (before + after);
                *if at(middle) / scale > middle / period { &mut before } else { &mut after } = middle;
            }
            exact = at(before) * (-discharging * (period - before)).exp();
        }
        assert_near(last(&solution, "v(c)"), exact, 1e-7);
        assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    }
}

/// An ideal thermostat: from the time at which the voltage reaches its set point, the switch slides between open and
/// closed, and acts as a resistance.
#[test]
fn a_switch_that_controls_a_voltage_keeps_it() {
    let mut specification = switched_charge(50.0, 1.0, 2.0, 15.0, "20 - v(c)", 4e-6);
    specification["output"]["times"] = json!([2.1e-7, 2.2e-7, 4e-6]);
    let solution = solve(&specification);
    // The closed switch charges the capacitor with v' = (50 - v)/1e-6 - v/2e-6 = 1.5e6 (100/3 - v) until v reaches
    // the set point 20.
    let level = 100.0 / 3.0;
    let before = level + (15.0 - level) * (-2.1e-7_f64 * 1.5e6).exp();
    let voltages = column(&solution, "v(c)");
    assert_near(voltages[0], before, 1e-7);
    assert_near(voltages[1], 20.0, 1e-9);
    assert_near(voltages[2], 20.0, 1e-9);
    // A current of 10 A flows to the load; the voltage across the switch is that of the source minus those of R1 and
    // the load.
    assert_near(last(&solution, "v(S1)"), 20.0, 1e-6);
}
