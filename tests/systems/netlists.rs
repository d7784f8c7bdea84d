//! Circuits given by their components, each compared with an independent answer: matrices written by hand, closed
//! forms, or Kirchhoff's laws.

use crate::systems::harness::{column, distance, events, solve};
use crate::systems::reference::example;
use dvi::specification::Specification;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};

fn circuit(problem: Value, end: f64) -> Value {
    json!({
        "problem": {"circuit": problem}, "time": {"end": end},
        "method": {"rtol": 1e-10, "atol": 1e-13}, "output": {"times": {"count": 101}}
    })
}

fn netlist(text: &str, end: f64) -> Value {
    circuit(json!({"netlist": text}), end)
}

#[test]
fn the_bridge_from_its_netlist_is_the_one_written_by_hand() {
    let read = |name: &str| Specification::from_json(example(name).to_string().as_bytes()).expect("a right example");
    let (by_hand, assembled) = (read("diode_bridge"), read("diode_bridge_netlist"));
    let dvi = |specification: &Specification| specification.model().dvi().expect("an inequality").clone();
    let (by_hand, assembled) = (dvi(&by_hand), dvi(&assembled));
    assert_eq!(by_hand.initial, assembled.initial);
    assert_eq!(by_hand.structure().set, assembled.structure().set);
    assert_eq!(by_hand.structure().pattern, assembled.structure().pattern);
    let nonzeros = by_hand.structure().pattern.len();
    let (mut a, mut b) = (vec![0.0; nonzeros], vec![0.0; nonzeros]);
    by_hand.problem().jacobian(0.0, &[0.0; 6], &mut a);
    assembled.problem().jacobian(0.0, &[0.0; 6], &mut b);
    for (a, b) in a.iter().zip(&b) {
        assert!((a - b).abs() <= 1e-15 * a.abs(), "{a} {b}");
    }
    let (a, b) = (solve(&example("diode_bridge")), solve(&example("diode_bridge_netlist")));
    let pairs = [
        ("v", "v(C1)"),
        ("i", "i(L1)"),
        ("v_R1", "v_blocked(DR1)"),
        ("v_F2", "v_blocked(DF2)"),
        ("i_F1", "i(DF1)"),
        ("i_R2", "i(DR2)"),
    ];
    for (by_hand, assembled) in pairs {
        let (a, b) = (column(&a, by_hand), column(&b, assembled));
        let size = a.iter().fold(0.0, |size: f64, a| size.max(a.abs()));
        let difference = a.iter().zip(b).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
        assert!(difference <= 1e-12 * size, "`{by_hand}` and `{assembled}` differ by {difference:e}");
    }
    assert_eq!(
        a.diagnostics.analysis.expect("analysed").uniqueness,
        b.diagnostics.analysis.expect("analysed").uniqueness
    );
}

#[test]
fn the_rectifier_from_its_netlist_follows_its_closed_form() {
    let (v, r, l, omega) = (10.0_f64, 10.0_f64, 0.02_f64, 100.0 * PI);
    let (impedance, phi, t_off) = (r.hypot(omega * l), (omega * l).atan2(r), 0.011_790_323_194_208_857);
    let solution = solve(&netlist("V1 in 0 SIN(0 10 50)\nD1 in a\nR1 a b 10\nL1 b 0 20m", 0.04));
    let exact = |t: f64| {
        let t = t % 0.02;
        if t < t_off { v / impedance * ((omega * t - phi).sin() + phi.sin() * (-r / l * t).exp()) } else { 0.0 }
    };
    for current in ["i(L1)", "i(D1)", "i(R1)"] {
        let error = distance(&solution, current, exact);
        assert!(error < 1e-8, "`{current}` is off by {error:e}");
    }
    let blocked = events(&solution, "v_blocked(D1)");
    let nearest = blocked.iter().map(|t| (t - t_off).abs()).fold(f64::INFINITY, f64::min);
    assert!(nearest < 1e-9, "the diode blocks {nearest:e} off its time");
}

/// Kirchhoff's laws and the laws of the components, for a circuit with every kind of element both in the spanning
/// tree and in the cotree.
#[test]
fn outputs_obey_the_laws_that_were_eliminated() {
    let text = "V1 in 0 SIN(1 10 50 0 0 30)\nR1 in a 10\nR2 a b 22\nR3 b 0 33\nR4 a c 47\nC1 c 0 10u IC=1\nC2 c d 20u\n\
                C3 d 0 30u\nL1 b e 10m\nL2 e f 20m\nR5 f 0 5\nI1 0 f SIN(0 0.1 80)\nD1 a g\nR6 g 0 15\nD2 g h BV=3 VF=0.5\n\
                R7 h 0 7\nD3 0 c VF=0.7\nD4 0 k BV=2\nC4 k 0 1u\nR8 k in 100";
    let solution = solve(&netlist(text, 0.05));
    let value = |name: String, k: usize| column(&solution, &name)[k];
    for k in 0..solution.trajectory.t.len() {
        let volts = |node: &str| if node == "0" { 0.0 } else { value(format!("v({node})"), k) };
        let mut charge = std::collections::HashMap::new();
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            let i = value(format!("i({})", words[0]), k);
            *charge.entry(words[1]).or_insert(0.0) += i;
            *charge.entry(words[2]).or_insert(0.0) -= i;
            if let Some(ohms) = words[0].strip_prefix('R').map(|_| words[3].parse::<f64>().expect("ohms")) {
                let v = volts(words[1]) - volts(words[2]);
                assert!((v - ohms * i).abs() < 1e-9, "{}: {v} and {i}", words[0]);
            }
        }
        charge.into_iter().for_each(|(node, sum)| assert!(sum.abs() < 1e-9, "{sum:e} A stay at {node}"));
        assert_eq!(value("i(L1)".into(), k), value("i(L2)".into(), k), "two inductors in a row");
        let (v, i) = (volts("g") - volts("h"), value("i(D2)".into(), k));
        let knee = if i > 0.0 { 0.5 } else { -3.0 };
        assert!((-3.0 - 1e-9..=0.5 + 1e-9).contains(&v) && (i.abs() < 1e-9 || (v - knee).abs() < 1e-9), "{v} {i}");
    }
    let t = &solution.trajectory.t;
    let source =
        column(&solution, "v(in)").iter().zip(t).map(|(v, t)| v - 1.0 - 10.0 * (TAU * 50.0 * t + PI / 6.0).sin());
    assert!(source.fold(0.0, |most: f64, error| most.max(error.abs())) < 1e-12);
}

/// A current charges capacitors that ideal diodes connect in a ladder: it raises the lowest voltage to the next one,
/// then both of these, as water fills basins one after the other.
#[test]
fn a_ladder_of_a_thousand_diodes_fills_level_by_level() {
    let (rungs, current, end, step) = (1000, 1.0, 19.9, 1.0);
    let mut components = vec![json!({"current_source": {"name": "I1", "nodes": ["0", "n0"], "amperes": current}})];
    for k in 0..rungs {
        let (node, next) = (format!("n{k}"), format!("n{}", k + 1));
        let start = step * k as f64;
        components
            .push(json!({"capacitor": {"name": format!("C{k}"), "nodes": [&node, "0"], "farads": 1, "volts": start}}));
        components.push(json!({"diode": {"name": format!("D{k}"), "nodes": [&node, &next]}}));
    }
    let start = step * f64::from(rungs);
    let last_node = format!("n{rungs}");
    components.push(json!({"capacitor": {"name": "C", "nodes": [last_node, "0"], "farads": 1, "volts": start}}));
    let mut specification = circuit(json!({"components": components}), end);
    specification["output"]["fields"] = json!(["v(n0)", "v(n3)", "v(n4)", "v(n5)", "v(n6)", "i(D3)"]);
    let solution = solve(&specification);
    // The initial voltages are 0, 1, 2, .., so that the first m capacitors hold the charge m (m - 1)/2 in addition to
    // the charge t that the current has brought.
    let merged = |t: f64| (1..).find(|&m| f64::from(m * (m + 1)) / 2.0 > t).map_or(0.0, f64::from);
    let level = |t: f64| (t + merged(t) * (merged(t) - 1.0) / 2.0) / merged(t);
    for k in [0, 3, 4, 5, 6] {
        let error = distance(&solution, &format!("v(n{k})"), |t| level(t).max(f64::from(k)));
        assert!(error < 1e-9, "node {k} is off by {error:e}");
    }
    let error = distance(&solution, "i(D3)", |t| if merged(t) > 4.0 { 1.0 - 4.0 / merged(t) } else { 0.0 });
    assert!(error < 1e-9, "the fourth diode is off by {error:e}");
}

/// Value at the time `t` of a piecewise exponential relaxation from zero with the time constant `tau`. The pieces end
/// at `ends`; `rest` maps the time at which a piece begins to its limit.
fn relaxation(t: f64, tau: f64, ends: &[f64], rest: impl Fn(f64) -> f64) -> f64 {
    let (mut x, mut from) = (0.0, 0.0);
    for &end in ends {
        let to = t.min(end);
        x = rest(from) + (x - rest(from)) * (-(to - from) / tau).exp();
        from = end;
        if t <= end {
            break;
        }
    }
    x
}

#[test]
fn a_switched_coil_freewheels_through_its_diode() {
    // The switch is closed for the first 3/8 of every millisecond; without a diode, the open switch conducts at its
    // withstand voltage.
    let closed = "sin(2*pi*1000*t + pi/8) - sin(pi/8)";
    let (volts, ohms, henries) = (10.0, 5.0, 2e-3);
    let solution = solve(&circuit(
        json!({"components": [
            {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": volts}},
            {"switch": {"name": "S1", "nodes": ["in", "x"], "closed": closed, "withstand_volts": 500}},
            {"diode": {"name": "D1", "nodes": ["0", "x"]}},
            {"inductor": {"name": "L1", "nodes": ["x", "y"], "henries": henries}},
            {"resistor": {"name": "R1", "nodes": ["y", "0"], "ohms": ohms}}
        ]}),
        4.1e-3,
    ));
    let ends: Vec<f64> = (0..5).flat_map(|k| [1e-3 * (f64::from(k) + 0.375), 1e-3 * f64::from(k + 1)]).collect();
    let is_closed = |t: f64| (t * 1e3 + 1e-9).fract() < 0.375;
    let exact = |t: f64| relaxation(t, henries / ohms, &ends, |t| if is_closed(t) { volts / ohms } else { 0.0 });
    let error = distance(&solution, "i(L1)", exact);
    assert!(error < 1e-8, "off by {error:e}");
    let through = |t: f64| if is_closed(t) { 0.0 } else { exact(t) };
    // An output sample exactly at a switching time may have the value before or after the switch.
    let away = |t: f64| ends.iter().all(|end| (t - end).abs() > 1e-9) && t > 0.0;
    for (&t, &i) in solution.trajectory.t.iter().zip(column(&solution, "i(D1)")).filter(|(t, _)| away(**t)) {
        assert!((i - through(t)).abs() < 1e-8, "the diode carries {i} at {t}");
    }
}

#[test]
fn a_switch_that_breaks_a_current_arcs_until_it_is_gone() {
    let (volts, ohms, henries, withstand, opens) = (10.0, 5.0, 2e-3, 50.0, 1e-3_f64);
    let solution = solve(&circuit(
        json!({"parameters": {"opens": opens}, "components": [
            {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": volts}},
            {"switch": {"name": "S1", "nodes": ["in", "x"], "closed": "opens - t", "withstand_volts": withstand}},
            {"inductor": {"name": "L1", "nodes": ["x", "y"], "henries": henries}},
            {"resistor": {"name": "R1", "nodes": ["y", "0"], "ohms": ohms}}
        ]}),
        2e-3,
    ));
    let tau = henries / ohms;
    let broken = volts / ohms * (1.0 - (-opens / tau).exp());
    let arc = (volts - withstand) / ohms;
    let exact = |t: f64| match t {
        t if t <= opens => volts / ohms * (1.0 - (-t / tau).exp()),
        t => (arc + (broken - arc) * (-(t - opens) / tau).exp()).max(0.0),
    };
    let error = distance(&solution, "i(L1)", exact);
    assert!(error < 1e-8, "off by {error:e}");
    let across = column(&solution, "v(S1)");
    assert!(across.iter().any(|v| (v - withstand).abs() < 1e-9) && (across[100] - volts).abs() < 1e-9);
}

#[test]
fn sources_of_a_netlist_have_the_values_that_spice_gives_them() {
    let text = "VS s 0 DC 1 SIN(1 2 50 4m 30 45)\nVP p 0 PULSE(-1 3 2m 1m 2m 3m 10m)\nVW w 0 PWL(1m 2 3m 6 3m -1 5m\n+ 0)\n\
                VT q 0 PULSE 0 1 1m 1m\nR1 s p 1k\nR2 p w 1k\nC1 w o 1u\nR3 w 0 1k\nR4 o q 1";
    let solution = solve(&netlist(text, 0.0407));
    let between = |t: f64, from: f64, to: f64| ((t - from) / (to - from)).clamp(0.0, 1.0);
    let sine = |t: f64| {
        let s = (t - 4e-3).max(0.0);
        1.0 + 2.0 * (TAU * 50.0 * s + PI / 4.0).sin() * (-30.0 * s).exp()
    };
    let pulse = |t: f64| {
        let s = if t < 2e-3 { 0.0 } else { (t - 2e-3) % 0.01 };
        -1.0 + 4.0 * (between(s, 0.0, 1e-3) - between(s, 4e-3, 6e-3))
    };
    let lines = |t: f64| if t < 3e-3 { 2.0 + 4.0 * between(t, 1e-3, 3e-3) } else { -1.0 + between(t, 3e-3, 5e-3) };
    for (node, error) in [
        ("s", distance(&solution, "v(s)", sine)),
        ("p", distance(&solution, "v(p)", pulse)),
        ("w", distance(&solution, "v(w)", lines)),
        ("q", distance(&solution, "v(q)", |t| between(t, 1e-3, 2e-3))),
    ] {
        assert!(error < 1e-9, "`{node}` is off by {error:e}");
    }
}

#[test]
fn a_square_wave_charges_a_capacitor_as_its_closed_form_says() {
    let solution = solve(&netlist("V1 in 0 PULSE(0 5 0 0 0 0.2m 1m)\nR1 in out 1k\nC1 out 0 1u", 5.03e-3));
    let ends: Vec<f64> = (0..6).flat_map(|k| [1e-3 * (f64::from(k) + 0.2), 1e-3 * f64::from(k + 1)]).collect();
    let is_high = |t: f64| (t * 1e3 + 1e-9).fract() < 0.2;
    let error = distance(&solution, "v(out)", |t| relaxation(t, 1e-3, &ends, |t| if is_high(t) { 5.0 } else { 0.0 }));
    assert!(error < 1e-8, "off by {error:e}");
}

#[test]
fn a_circuit_that_stores_nothing_follows_its_sources() {
    // Two circuits: a half-wave rectifier, and a limiter between 0 and 5 volts.
    let rectified = solve(&netlist("V1 a 0 SIN(0 10 50)\nD1 a b\nR1 b 0 1k", 0.045));
    let wave = |t: f64| 10.0 * (100.0 * std::f64::consts::PI * t).sin();
    let error = distance(&rectified, "v(b)", |t| wave(t).max(0.0));
    assert!(error < 1e-11, "the rectified voltage is off by {error:e}");
    let times: Vec<f64> = rectified.trajectory.events.iter().map(|event| event.t).filter(|&t| t > 1e-9).collect();
    assert_eq!(times.len(), 4, "{times:?}");
    for (t, half) in times.iter().zip(1..) {
        assert!((t - 0.01 * f64::from(half)).abs() < 1e-11, "half wave {half} ends at {t}");
    }

    let limiter = json!({"components": [
        {"voltage_source": {"name": "V1", "nodes": ["a", "0"], "volts": "10*sin(t)"}},
        {"resistor": {"name": "R1", "nodes": ["a", "b"], "ohms": 100}},
        {"zener": {"name": "Z1", "nodes": ["0", "b"], "breakdown_volts": 5}},
    ]});
    let limited = solve(&circuit(limiter, 6.0));
    let error = distance(&limited, "v(b)", |t| (10.0 * t.sin()).clamp(0.0, 5.0));
    assert!(error < 1e-11, "the limited voltage is off by {error:e}");
    let sixth = std::f64::consts::FRAC_PI_6;
    for exact in [sixth, 5.0 * sixth, 6.0 * sixth] {
        let times = limited.trajectory.events.iter().map(|event| (event.t - exact).abs());
        assert!(times.fold(f64::INFINITY, f64::min) < 1e-9, "no event at {exact}");
    }
}

#[test]
fn a_capacitor_across_a_source_takes_the_current_of_its_slope() {
    let solution = solve(&netlist("V1 a 0 SIN(0 2 1)\nC1 a 0 3u", 2.0));
    let tau = 2.0 * std::f64::consts::PI;
    let error = distance(&solution, "i(C1)", |t| 3e-6 * 2.0 * tau * (tau * t).cos());
    assert!(error < 1e-15, "the current is off by {error:e}");
}

#[test]
fn a_voltage_multiplier_of_any_length_pumps_charge_up_its_ladder() {
    // Reference: voltages of the ladder after five periods for an amplitude of 100 V, from the least change of the
    // capacitor voltages, in the energy norm, that keeps every diode from conducting in reverse, over 64 parts of
    // each quarter period, in rational numbers. Every event is at the end of a part, so that the values are exact.
    let pumped = [120.58919270833333, 176.13932291666666, 201.513671875, 207.51953125, 208.349609375, 208.3984375];
    for (stages, volts, farads, hertz) in [(12, 100.0, 1e-6, 1000.0), (16, 4e-5, 3.3e-3, 0.5)] {
        let mut text = format!("V1 t 0 SIN(0 {volts:e} {hertz:e})\n");
        let mut last = ("t".to_owned(), "0".to_owned());
        for k in 0..stages {
            let (top, bottom) = (format!("t{k}"), format!("b{k}"));
            text += &format!("Ca{k} {} {top} {farads:e}\nDa{k} {} {top}\n", last.0, last.1);
            text += &format!("Cb{k} {} {bottom} {farads:e}\nDb{k} {top} {bottom}\n", last.1);
            last = (top, bottom);
        }
        let solution = solve(&json!({
            "problem": {"circuit": {"netlist": text}},
            "time": {"end": 5.0 / hertz},
            "method": {"rtol": 1e-8, "atol": 1e-10 * volts}
        }));
        for k in 0..stages {
            let exact = 0.01 * volts * pumped[k.min(pumped.len() - 1)];
            let found = *column(&solution, &format!("v(b{k})")).last().expect("a value");
            assert!((found - exact).abs() < 1e-7 * volts, "{stages} stages: v(b{k}) = {found:e}, not {exact:e}");
        }
        assert!(solution.verdict.trusted, "{stages} stages: {:?}", solution.verdict);
        // The solution has at most eight smooth pieces in a period, for any length of the ladder, so that few steps
        // suffice.
        let steps = solution.diagnostics.steps.accepted;
        assert!(steps < 100, "{stages} stages: {steps} steps");
    }
}
