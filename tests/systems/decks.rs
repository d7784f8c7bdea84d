//! Netlists of forums and textbooks: rectifiers, clippers, clampers, multipliers, converters and oscillators, all of
//! ideal components, compared with closed forms.

use crate::systems::harness::{column, distance, events, last, solve};
use dvi::solution::Solution;
use dvi::specification::document_of;
use serde_json::{Value, json};
use std::f64::consts::TAU;

/// Solves a SPICE netlist with tight tolerances and 201 output times.
fn run(deck: &str) -> Solution {
    run_with(deck, json!({"count": 201}))
}

fn run_with(deck: &str, times: Value) -> Solution {
    let mut document: Value = serde_json::from_slice(&document_of(deck.as_bytes())).expect("a document");
    document["method"] = json!({"rtol": 1e-10, "atol": 1e-13});
    document["output"] = json!({"times": times});
    solve(&document)
}

/// Solves a SPICE netlist with output at the ends of steps, which coincide with the edges of pulses: at an edge the
/// value before or after it is right.
fn run_to_its_edges(deck: &str) -> Solution {
    let solution = run_with(deck, json!("steps"));
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    solution
}

/// Asserts that a field of the solution differs from its closed form `exact` by at most `most` at all output times.
#[track_caller]
fn assert_is(solution: &Solution, name: &str, most: f64, exact: impl Fn(f64) -> f64) {
    let error = distance(solution, name, exact);
    assert!(error < most, "`{name}` is off by {error:e}");
}

fn warned(solution: &Solution, part: &str) -> bool {
    solution.diagnostics.warnings.iter().any(|warning| warning.code == "netlist" && warning.message.contains(part))
}

#[test]
fn a_capacitor_charges_through_a_resistor() {
    let solution = run("RC charging, the first circuit of every course\n\
                        .param Vs=5 tau={R*C} R=1k C=1u\n\
                        V1 in 0 DC {Vs}\nR1 in out {R}\nC1 out 0 {C} IC=0\n\
                        .tran 10u {5*tau} UIC\n.print tran v(out)\n.end\nwhat stands here is not read\n");
    assert_is(&solution, "v(out)", 1e-8, |t| 5.0 * (1.0 - (-t / 1e-3).exp()));
    assert!((solution.trajectory.t.last().unwrap() - 5e-3).abs() < 1e-15);
    assert!(!warned(&solution, "no operating point"));
}

#[test]
fn a_half_wave_rectifier_passes_one_half() {
    let deck = "Half-wave rectifier\n* with the diode that everybody has\n\
                Vin in 0 SIN(0 10 50)\nD1 in out D1N4007\nRload out 0 1k\n\
                .model D1N4007 D(IS=7.02767n RS=0 N=1.80803 EG=1.05743 XTI=5 CJO=1e-11 VJ=0.7 M=0.5 FC=0.5 TT=1e-07 mfg=OnSemi)\n\
                .tran 0.1m 40m\n.backanno\n.end\n";
    // A circuit without energy storage has no states, so that the solver adds a state, the integral of its source.
    let solution = run(deck);
    assert_is(&solution, "v(out)", 1e-8, |t| (10.0 * (TAU * 50.0 * t).sin()).max(0.0));
    assert!(warned(&solution, "`d1n4007` are ideal without cjo, eg, fc, is"));
    assert!(warned(&solution, "no operating point"));
}

#[test]
fn a_bridge_gives_the_magnitude() {
    let solution =
        run("Full-wave bridge rectifier\nV1 a b SINE(0 170 60)\nD1 a p DI\nD2 b p DI\nD3 n a DI\nD4 n b DI\n\
                        Rref n 0 1\nRL p n 100\n.model DI D(VFWD=0)\n.tran 33m\n.end");
    assert_is(&solution, "i(RL)", 1e-8, |t| (170.0 * (TAU * 60.0 * t).sin()).abs() / 100.0);
    assert!(!warned(&solution, "ideal"));
}

#[test]
fn a_zener_clips_at_its_two_voltages() {
    let solution =
        run("Zener clipper\nVs in 0 SIN(0 10 1k)\nR1 in out 1k\nDz 0 out BZX\n.MODEL BZX D(BV=5.1 VF=0.7)\n\
                        C1 in 0 1n\n.TRAN 1U 2M\n.END");
    assert_is(&solution, "v(out)", 1e-8, |t| (10.0 * (TAU * 1e3 * t).sin()).clamp(-0.7, 5.1));
}

#[test]
fn a_biased_clipper_stops_at_its_battery() {
    let solution = run("Biased positive clipper\nVin 1 0 SIN(0 8 100)\nR1 1 2 10k\nD1 2 3 DX\nVb 3 0 3\nC9 1 0 1p\n\
                        .model DX D(VF=0.6)\n.tran 100u 20m\n.end");
    assert_is(&solution, "v(2)", 1e-8, |t| (8.0 * (TAU * 100.0 * t).sin()).min(3.6));
}

/// In a clamper, the capacitor charges through the diode while the square wave is high; while it is low the diode
/// blocks and the capacitor keeps its charge.
#[test]
fn a_clamper_holds_what_it_was_charged_to() {
    let solution =
        run("Negative clamper\nVin in 0 PULSE(5 -5 1m 0 0 1m 2m)\nR1 in a 100\nC1 a out 10u IC=0\nD1 out 0 DI\n\
                        R2 out 0 1T\n.model DI D(VFWD=0)\n.tran 1u 1.9m uic\n.end");
    let tau = 100.0 * 10e-6;
    let held = 5.0 * (1.0 - (-1.0_f64).exp());
    assert_is(&solution, "v(C1)", 1e-7, |t| if t <= 1e-3 { 5.0 * (1.0 - (-t / tau).exp()) } else { held });
    assert!((last(&solution, "v(out)") - (-5.0 - held)).abs() < 1e-7);
}

/// In a voltage doubler without a load, each period reduces the difference between the output and twice the peak
/// voltage by a fixed fraction.
#[test]
fn a_doubler_doubles() {
    let solution =
        run("Villard/Greinacher voltage doubler\nV1 in 0 SIN(0 10 1k)\nRs in a 1\nC1 a b 1u\nD1 0 b DI\nD2 b out DI\n\
                        C2 out 0 1u\n.model DI D(VFWD=0)\n.tran 10u 40m 0 10u UIC\n.end");
    let out = column(&solution, "v(out)");
    assert!((out.last().unwrap() - 20.0).abs() < 2e-3 && out.iter().all(|v| *v < 20.0 + 1e-6), "{:?}", out.last());
}

#[test]
fn a_multiplier_of_two_stages_goes_to_four_peaks() {
    let stage = ".subckt stage in low high out\nC1 in high 1u\nD1 low high DI\nD2 high out DI\nC2 low out 1u\n.ends\n";
    let deck = format!(
        "Cockcroft-Walton multiplier, two stages\n{stage}V1 in 0 SIN(0 10 10k)\nRs in a 0.1\nX1 a 0 h1 o1 stage\n\
         X2 h1 o1 h2 o2 stage\n.model DI D(VFWD=0)\n.tran 1u 20m uic\n.end"
    );
    let solution = run(&deck);
    assert!((last(&solution, "v(o2)") - 40.0).abs() < 0.02, "{}", last(&solution, "v(o2)"));
    assert!((last(&solution, "v(o1)") - 20.0).abs() < 0.02);
    assert!(solution.trajectory.field("v(X1.C1)").is_some());
}

/// A buck chopper with an inductive load: the current is exponential between switching times, and so has a closed
/// form.
#[test]
fn a_buck_chopper_follows_its_exponentials() {
    let solution = run_to_its_edges(
        "Buck chopper, 24 V, 20 kHz, duty 0.4\n\
                        V1 in 0 24\nS1 in sw g 0 MOS\nD1 0 sw DI\nL1 sw out 100u IC=0\nR1 out 0 2\n\
                        Vg g 0 PULSE(0 10 0 0 0 20u 50u)\n\
                        .model MOS SW(Ron=50m VT=5 VH=0)\n.model DI D(VFWD=0)\n.tran 0.5u 1m uic\n.end",
    );
    let (on, off, period) = (20e-6, 30e-6, 50e-6);
    let (r_on, r_off, l) = (2.05, 2.0, 100e-6);
    let exact = |t: f64| {
        let mut i = 0.0_f64;
        let mut left = t;
        loop {
            let step = left.min(on);
            i = 24.0 / r_on + (i - 24.0 / r_on) * (-r_on / l * step).exp();
            left -= step;
            if left <= 0.0 {
                return i;
            }
            let step = left.min(off);
            i *= (-r_off / l * step).exp();
            left -= step;
            if left <= period * 1e-12 {
                return i;
            }
        }
    };
    assert_is(&solution, "i(L1)", 1e-10, exact);
}

/// The mean output of a lossless boost converter is `V/(1 - D)` with the duty ratio `D`; its ripple is comparatively
/// small.
#[test]
fn a_boost_converter_raises_by_its_duty() {
    let solution = run_to_its_edges(
        "Boost converter 12 V to 24 V\nVin in 0 12\nL1 in sw 100u IC=4.8\nS1 sw 0 g 0 SX\nD1 sw out DX\n\
                        C1 out 0 1m IC=24\nRL out 0 10\nVg g 0 PULSE(0 1 0 0 0 5u 10u)\n\
                        .model SX VSWITCH(Ron=1m Roff=1Meg Von=0.6 Voff=0.4)\n.model DX D(Vfwd=0)\n.tran 1u 1m 0 1u uic\n.end",
    );
    let out = column(&solution, "v(out)");
    assert!(out.iter().all(|v| (v - 24.0).abs() < 0.1), "{out:?}");
}

#[test]
fn a_square_wave_through_an_rc_has_its_periodic_ends() {
    let solution =
        run("RC low pass\nV1 in 0 PULSE(0 1 0 0 0 0.5m 1m)\nR1 in out 1k\nC1 out 0 0.1u\n.tran 1u 20m uic\n.end");
    // After many periods T of the square wave, with the time constant tau of the low pass, the voltage at the end of
    // a period is 1/(1 + exp(T/(2 tau))), the minimum of the periodic solution.
    let low = 1.0 / (1.0 + 5.0_f64.exp());
    assert!((last(&solution, "v(out)") - low).abs() < 1e-8);
}

#[test]
fn a_ramp_into_a_coil_grows_as_a_parabola() {
    let solution = run("PWL into an inductor\nV1 a 0 PWL(0 0 1m 10 2m 10)\nL1 a 0 10mH\n.tran 1u 2m uic\n.end");
    assert_is(&solution, "i(L1)", 1e-9, |t| {
        if t < 1e-3 { 0.5 * 1e4 * t * t / 10e-3 } else { 0.5 + 10.0 * (t - 1e-3) / 10e-3 }
    });
}

#[test]
fn an_exponential_source_is_its_formula() {
    let solution = run("EXP source\nV1 a 0 EXP(1 5 1m 2m 4m 1m)\nR1 a 0 1k\nC1 a 0 1p\n.tran 10u 8m\n.end");
    let part = |t: f64, delay: f64, tau: f64| 1.0 - (-(t - delay).max(0.0) / tau).exp();
    assert_is(&solution, "v(a)", 1e-9, |t| 1.0 + 4.0 * (part(t, 1e-3, 2e-3) - part(t, 4e-3, 1e-3)));
}

#[test]
fn full_coupling_is_an_ideal_transformer() {
    let solution = run(
        "Transformer 10:1\nV1 p 0 SIN(0 325 50)\nL1 p 0 1\nL2 s 0 10m\nK1 L1 L2 1\nRL s 0 8\n.tran 1m 40m uic\n.end",
    );
    assert_is(&solution, "v(s)", 1e-7, |t| 32.5 * (TAU * 50.0 * t).sin());
    // The magnetising inductance of the transformer carries the current that the source would drive through the primary
    // coil alone.
    assert_is(&solution, "i(K1.m)", 1e-8, |t| 325.0 / (TAU * 50.0) * (1.0 - (TAU * 50.0 * t).cos()));
}

/// A transformer with two loosely coupled coils. Reference: a Runge-Kutta method for the equations of the two windings.
#[test]
fn loose_coupling_is_mutual_inductance() {
    let solution =
        run("Loosely coupled coils\nV1 in 0 DC 10\nR1 in p 5\nL1 p 0 10m\nL2 s 0 40m\nK12 L1 L2 {k}\nR2 s 0 20\n\
                        .param k = 0.6\n.tran 10u 10m uic\n.end");
    let (l1, l2) = (10e-3_f64, 40e-3);
    let m = 0.6 * (l1 * l2).sqrt();
    let determinant = l1 * l2 - m * m;
    let rates = |[i1, i2]: [f64; 2]| {
        let (u1, u2) = (10.0 - 5.0 * i1, -20.0 * i2);
        [(l2 * u1 - m * u2) / determinant, (l1 * u2 - m * u1) / determinant]
    };
    let times = &solution.trajectory.t;
    let (mut i, steps) = ([0.0; 2], 100);
    for (k, pair) in times.windows(2).enumerate() {
        let h = (pair[1] - pair[0]) / f64::from(steps);
        for _ in 0..steps {
            let go = |i: [f64; 2], d: [f64; 2], h: f64| [i[0] + h * d[0], i[1] + h * d[1]];
            let k1 = rates(i);
            let k2 = rates(go(i, k1, 0.5 * h));
            let k3 = rates(go(i, k2, 0.5 * h));
            let k4 = rates(go(i, k3, h));
            for j in 0..2 {
                i[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]);
            }
        }
        let found = column(&solution, "v(s)")[k + 1];
        assert!((found + 20.0 * i[1]).abs() < 1e-7, "{found} and {} at {}", -20.0 * i[1], pair[1]);
    }
    assert!((last(&solution, "i(L1)") - i[0]).abs() < 1e-8);
}

/// Three equally coupled coils on one core with the turns ratio 1 : 2 : 3 and matched resistors: the sum of the
/// referred currents and their differences decay with separate time constants.
#[test]
fn three_coils_on_one_core_have_two_time_constants() {
    let coils = "Three coils\nV1 in 0 DC 10\nR1 in p 1\nL1 p 0 1m\nL2 s 0 4m\nL3 u 0 9m\nR2 s 0 4\nR3 u 0 9\n";
    let end = ".tran 10u 6m uic\n.end";
    let at_once = run(&format!("{coils}K1 L1 L2 L3 0.9\n{end}"));
    let in_pairs = run(&format!("{coils}K12 L1 L2 0.9\nK13 L1 L3 0.9\nK23 L2 L3 0.9\n{end}"));
    let common = |t: f64| 1.0 - (-t / 2.8e-3).exp();
    let differential = |t: f64| 1.0 - (-t / 0.1e-3).exp();
    for solution in [at_once, in_pairs] {
        assert_is(&solution, "i(L1)", 1e-8, |t| 10.0 / 3.0 * (common(t) + 2.0 * differential(t)));
        assert_is(&solution, "i(L2)", 1e-8, |t| 10.0 / 6.0 * (common(t) - differential(t)));
        assert_is(&solution, "i(L3)", 1e-8, |t| 10.0 / 9.0 * (common(t) - differential(t)));
        assert!(solution.verdict.trusted);
    }
}

/// Three coils, of which the second and third are coupled less to each other than to the first. By symmetry they carry
/// the same current, and the two modes are those of a symmetric matrix of order 2.
#[test]
fn three_coils_may_be_coupled_unequally() {
    let solution = run("Three coils\nV1 in 0 DC 10\nR1 in p 1\nL1 p 0 1m\nL2 s 0 1m\nL3 u 0 1m\nR2 s 0 1\nR3 u 0 1\n\
         K12 L1 L2 0.9\nK13 L1 L3 0.9\nK23 L2 L3 0.7\n.tran 10u 6m uic\n.end");
    let side = 0.9 * 2.0_f64.sqrt();
    let root = (0.35_f64.powi(2) + side * side).sqrt();
    let currents = |t: f64| {
        [1.35 + root, 1.35 - root].iter().fold([0.0; 2], |[one, others], value| {
            let vector = [side, value - 1.0];
            let share = 10.0 * vector[0] / (vector[0] * vector[0] + vector[1] * vector[1]);
            let grown = share * (1.0 - (-t / (value * 1e-3)).exp());
            [one + grown * vector[0], others + grown * vector[1] / 2.0_f64.sqrt()]
        })
    };
    assert_is(&solution, "i(L1)", 1e-7, |t| currents(t)[0]);
    assert_is(&solution, "i(L2)", 1e-7, |t| currents(t)[1]);
    assert_is(&solution, "i(L3)", 1e-7, |t| currents(t)[1]);
}

/// Three coils without leakage: all turns have the same voltage, and the initial ampere-turns decay as in a single
/// coil.
#[test]
fn three_coils_without_leakage_share_their_ampere_turns() {
    let solution =
        run("A flyback winding with two outputs\nL1 p 0 1m\nL2 s 0 4m\nL3 u 0 9m\nR1 p 0 1\nR2 s 0 4\nR3 u 0 9\n\
                        K1 L1 L2 L3 1\n.ic I(L3)=2\n.tran 10u 6m uic\n.end");
    // Referred to the first winding, the six ampere-turns are 6 A in 1 mH, across three parallel resistors of 1 ohm
    // each.
    let v = |t: f64| -2.0 * (-t / 3e-3).exp();
    assert_is(&solution, "v(p)", 1e-8, v);
    assert_is(&solution, "v(s)", 1e-8, |t| 2.0 * v(t));
    assert_is(&solution, "v(u)", 1e-8, |t| 3.0 * v(t));
}

/// An initial current that the netlist sets by `.ic` in one of two coupled coils is the current of that coil alone.
#[test]
fn a_coupled_coil_starts_with_the_current_that_it_is_given() {
    for (given, at_start) in [("I(L1)=3", [3.0, 0.0]), ("I(L2)=3", [0.0, 3.0])] {
        let solution = run(&format!(
            "Two coils\nL1 p 0 1m\nL2 s 0 4m\nR1 p 0 1\nR2 s 0 4\nK1 L1 L2 0.6\n.ic {given}\n.tran 10u 1m uic\n.end"
        ));
        assert!((column(&solution, "v(p)")[0] + at_start[0]).abs() < 1e-9, "{given}");
        assert!((column(&solution, "v(s)")[0] + 4.0 * at_start[1]).abs() < 1e-9, "{given}");
    }
}

#[test]
fn the_four_controlled_sources_follow() {
    let solution = run("E F G H\nV1 in 0 SIN(0 1 100)\nR1 in x 1k\nVs x 0 0\nE1 e 0 in 0 -10\nRe e 0 1k\n\
                        G1 0 g in 0 2m\nRg g 0 1k\nF1 0 f Vs 50\nRf f 0 100\nH1 h 0 Vs 2k\nRh h 0 1\nCx in 0 1p\n.tran 0.1m 20m\n.end");
    let v = |t: f64| (TAU * 100.0 * t).sin();
    assert_is(&solution, "v(e)", 1e-8, |t| -10.0 * v(t));
    assert_is(&solution, "v(g)", 1e-8, |t| 2.0 * v(t));
    assert_is(&solution, "v(f)", 1e-8, |t| 5.0 * v(t));
    assert_is(&solution, "v(h)", 1e-8, |t| 2.0 * v(t));
}

#[test]
fn an_integrator_integrates() {
    let solution =
        run("Transconductor and capacitor\nV1 in 0 SIN(0 1 1k 0 0 90)\nR1 in 0 1k\nG1 0 out in 0 1m\nC1 out 0 1u\n\
                        .tran 1u 3m uic\n.end");
    assert_is(&solution, "v(out)", 1e-8, |t| 1e3 * (TAU * 1e3 * t).sin() / (TAU * 1e3));
}

/// A capacitor is charged through `R` and discharged through a switch with hysteresis: the times between the two
/// thresholds have closed forms.
#[test]
fn a_relaxation_oscillator_has_its_period() {
    let solution = run(
        "Relaxation oscillator (neon lamp)\nV1 in 0 10\nR1 in out 10k\nC1 out 0 1u IC=0\nS1 out 0 out 0 LAMP OFF\n\
                        .model LAMP SW(VT=5 VH=1 RON=100)\n.tran 10u 50m uic\n.end",
    );
    let closes = events(&solution, "closed(S1)");
    let r = 1.0 / (1.0 / 1e4 + 1.0 / 100.0);
    let floor: f64 = 10.0 * r / 1e4;
    let up = |from: f64, to: f64| 1e4 * 1e-6 * ((10.0 - from) / (10.0 - to)).ln();
    let down = r * 1e-6 * ((6.0 - floor) / (4.0 - floor)).ln();
    let first = up(0.0, 6.0);
    let near = |t: f64| closes.iter().map(|event| (event - t).abs()).fold(f64::INFINITY, f64::min);
    for t in [first, first + down, first + down + up(4.0, 6.0), first + 2.0 * down + up(4.0, 6.0)] {
        assert!(near(t) < 1e-8, "no switch at {t}: {closes:?}");
    }
}

#[test]
fn a_current_switch_closes_at_its_current() {
    let solution = run(
        "Overcurrent\nV1 a 0 PWL(0 0 1 10)\nVs a b 0\nR1 b 0 100\nV2 c 0 5\nRp c d 100\nW1 d 0 Vs RELAY\nC1 d 0 1p IC=5\n\
                        .model RELAY CSW(IT=51.3m IH=0 RON=1)\n.tran 1m 1\n.end",
    );
    // The voltage at `d` is 5 V until the ramp of 10 V/s reaches 5.13 V, where the current of 51.3 mA through 100
    // ohms closes the switch.
    assert_is(&solution, "v(d)", 1e-6, |t| if t < 0.513 { 5.0 } else { 5.0 / 101.0 });
}

#[test]
fn an_oscillation_begins_where_ic_says() {
    let solution = run("LC tank\nL1 a 0 10m\nC1 a 0 100u\n.ic V(a)=3 I(L1)=0.1\n.tran 10u 20m uic\n.end");
    let omega = 1e3;
    assert_is(&solution, "v(a)", 1e-7, |t| 3.0 * (omega * t).cos() - 0.1 / (100e-6 * omega) * (omega * t).sin());
}

#[test]
fn subcircuits_are_what_is_written_out_by_hand() {
    let by_hand = run(
        "Ladder\nV1 in 0 1\nR1 in a 1k\nC1 a 0 1u\nR2 a b 2k\nC2 b 0 0.5u\nR3 b c 1k\nC3 c 0 1u\n.tran 10u 5m uic\n.end",
    );
    let nested = run("Ladder of subcircuits\nV1 in 0 1\nX1 in a rc\nXrest a c two PARAMS: r=2k\n\
                      .subckt rc in out params: r=1k c={1m/r}\nR1 in out {r}\nC1 out 0 {c}\n.ends rc\n\
                      .subckt two in out r=5\n.param half={r/2}\nXa in mid rc r={r}\nXb mid out rc r={half}\n.ends\n.tran 10u 5m uic\n.end");
    for (hand, deep) in [("v(a)", "v(a)"), ("v(b)", "v(Xrest.mid)"), ("v(c)", "v(c)"), ("i(R3)", "i(Xrest.Xb.R1)")] {
        let (hand, deep) = (column(&by_hand, hand), column(&nested, deep));
        let off = hand.iter().zip(deep).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        assert!(off < 1e-9, "{off:e}");
    }
}

#[test]
fn a_suffix_that_is_likely_meant_otherwise_is_told() {
    let solution = run("Suffixes\nV1 a 0 1\nR1 a b 1M\nC1 b 0 1F\nR2 b 0 1MEG\n.tran 1 1\n.end");
    assert!(warned(&solution, "line 3: `1M`") && warned(&solution, "line 4: `1F`") && !warned(&solution, "1MEG"));
}
