//! Error messages for faulty circuits, by the names of their components.

use crate::documents::*;
use dvi::specification::Specification;
use serde_json::{Value, json};

const PLACE: &str = "/problem/circuit/components";
const NETLIST: &str = "/problem/circuit/netlist";

fn circuit() -> Value {
    json!({
        "problem": {"circuit": {"components": [
            {"voltage_source": {"name": "V1", "nodes": ["in", "0"], "volts": "sin(t)"}},
            {"resistor": {"name": "R1", "nodes": ["in", "out"], "ohms": 1000}},
            {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": 1e-6}}
        ]}},
        "time": {"end": 1}
    })
}

/// Returns the test circuit with an additional component.
fn and(kind: &str, component: Value) -> Value {
    let mut document = circuit();
    let components = document.pointer_mut(PLACE).and_then(Value::as_array_mut).expect("components");
    components.push(json!({kind: component}));
    document
}

fn netlist(text: &str) -> Value {
    json!({"problem": {"circuit": {"netlist": text}}, "time": {"end": 1}})
}

/// Asserts that a netlist is refused with exactly these errors, given as `(code, part of the detail)`.
#[track_caller]
fn assert_netlist(text: &str, expected: &[(&str, &str)]) {
    let expected: Vec<_> = expected.iter().map(|&(code, part)| (NETLIST, code, part)).collect();
    assert_errors(&netlist(text), &expected);
}

#[test]
fn the_circuits_to_break_are_right() {
    for document in
        [circuit(), netlist("V1 in 0 SIN(0 1 50)\nR1 in out 1k\nC1 out GND 1u"), netlist("L1 a 0 1\nR1 A 0 1")]
    {
        Specification::from_json(document.to_string().as_bytes()).unwrap();
    }
}

#[test]
fn a_circuit_has_components_or_a_netlist_and_not_both() {
    let place = "/problem/circuit";
    assert_errors(&without(circuit(), PLACE), &[(place, "components_or_netlist", "either")]);
    let both = with(circuit(), NETLIST, json!("R1 a 0 1"));
    assert_errors(&both, &[(place, "components_or_netlist", "either")]);
    assert_errors(&with(circuit(), PLACE, json!([])), &[(PLACE, "number_of_components", "0 components")]);
}

#[test]
fn parts_that_nothing_connects_to_ground_float() {
    let document = and("resistor", json!({"name": "R2", "nodes": ["x", "y"], "ohms": 1}));
    assert_errors(&document, &[(PLACE, "floating_node", "`x`, `y`")]);
    assert_netlist("R1 a b 1\nC1 a b 1u", &[("floating_node", "`a`, `b`")]);
}

#[test]
fn voltage_sources_form_no_loop() {
    let document = and("voltage_source", json!({"name": "V2", "nodes": ["0", "in"], "volts": 5}));
    assert_errors(&document, &[(&format!("{PLACE}/0/voltage_source"), "source_loop", "`V1`, `V2` form a loop")]);
    assert_netlist(
        "V1 a 0 1\nV2 b a 1\nV3 b 0 1\nR1 b 0 1\nC1 b 0 1u",
        &[("source_loop", "`V1`, `V2`, `V3` form a loop")],
    );
}

#[test]
fn current_sources_are_no_cut_set() {
    assert_netlist("C1 a 0 1u\nI1 a b 1\nI2 b 0 1", &[("source_cut_set", "`I1`, `I2` are current sources")]);
    let document = and("current_source", json!({"name": "I1", "nodes": ["0", "x"], "amperes": "sin(t)"}));
    assert_errors(&document, &[(&format!("{PLACE}/3/current_source"), "source_cut_set", "`I1`")]);
}

#[test]
fn a_switch_shorts_no_source() {
    let document = and("switch", json!({"name": "S1", "nodes": ["in", "0"], "closed": "t - 1", "withstand_volts": 10}));
    assert_errors(&document, &[(&format!("{PLACE}/0/voltage_source"), "switch_loop", "`V1`, `S1`")]);
    let document =
        and("switch", json!({"name": "S1", "nodes": ["out", "0"], "closed": "t - 1", "withstand_volts": 10}));
    assert_errors(&document, &[(&format!("{PLACE}/2/capacitor"), "switch_loop", "`C1`, `S1`")]);
}

#[test]
fn a_start_against_a_source_is_told_as_such_where_no_state_is_left() {
    assert_netlist("V1 a 0 5\nC1 a 0 1u IC=2", &[("inconsistent_start", "`C1` starts from 2, but")]);
    assert_netlist("I1 0 a 1\nL1 a 0 1 IC=0", &[("inconsistent_start", "`L1` starts from 0, but")]);
    assert_netlist("R1 a 0 1k\nD1 a 0", &[("dead_circuit", "no source")]);
}

#[test]
fn what_jumps_makes_no_impulse() {
    assert_netlist("V1 a 0 PULSE(0 1 1)\nC1 a 0 1u", &[("impulse", "`V1` jumps, and `C1`")]);
    assert_netlist(
        "V1 a 0 PULSE(0 1 1)\nC1 a b 1u\nC2 b 0 1u\nR1 b 0 1",
        &[("impulse", "`V1` jumps, and `C1`"), ("impulse", "`V1` jumps, and `C2`")],
    );
    assert_netlist("I1 0 a PULSE(0 1 1)\nL1 a b 1\nL2 b 0 1\nC1 b 0 1", &[("impulse", "`I1` jumps, and `L1`")]);
    Specification::from_json(netlist("V1 a 0 PULSE(0 1 1 1m)\nC1 a b 1u\nC2 b 0 1u\nR1 b 0 1").to_string().as_bytes())
        .unwrap();
}

#[test]
fn a_start_that_contradicts_itself_is_told_by_how_much() {
    assert_netlist(
        "C1 a 0 1u IC=5\nC2 a 0 1u IC=3\nR1 a 0 1k",
        &[("inconsistent_start", "`C2` starts from 3, but the other components leave only 5: off by -2e0")],
    );
    assert_netlist(
        "V1 a 0 2\nL1 a b 1 IC=1\nL2 b c 1 IC=4\nR1 c 0 1",
        &[("inconsistent_start", "`L1` starts from 1, but the other components leave only 4: off by -3e0")],
    );
    // Of two parallel capacitors, the given initial voltage of one determines that of the other.
    let text = netlist("C1 a 0 1u\nC2 a 0 1u IC=3\nR1 a 0 1k").to_string();
    assert_eq!(Specification::from_json(text.as_bytes()).unwrap().model().initial(), [3.0]);
}

#[test]
fn names_are_unique_and_can_stand_in_an_output() {
    let document = and("resistor", json!({"name": "R1", "nodes": ["in", "0"], "ohms": 1}));
    assert_errors(&document, &[(&format!("{PLACE}/3/resistor"), "duplicate_name", "components/1/resistor")]);
    let document = and("resistor", json!({"name": "in", "nodes": ["in", "0"], "ohms": 1}));
    assert_errors(&document, &[(&format!("{PLACE}/3/resistor"), "duplicate_name", "is a node as well")]);
    for name in ["", "R 2", "R(2)", "R\"2", &"R".repeat(61)] {
        let document = and("resistor", json!({"name": name, "nodes": ["in", "0"], "ohms": 1}));
        assert_errors(&document, &[(&format!("{PLACE}/3/resistor"), "malformed_name", "not the name")]);
    }
    let document = and("resistor", json!({"name": "R2", "nodes": ["in", "in"], "ohms": 1}));
    assert_errors(&document, &[(&format!("{PLACE}/3/resistor"), "shorted_component", "`R2`")]);
}

#[test]
fn values_are_above_zero_at_their_place() {
    for (k, kind, key) in [(1, "resistor", "ohms"), (2, "capacitor", "farads")] {
        let pointer = format!("{PLACE}/{k}/{kind}/{key}");
        for value in [json!(0), json!(-1), json!("1 - 2")] {
            assert_errors(&with(circuit(), &pointer, value), &[(&pointer, "out_of_range", key)]);
        }
        assert_errors(&with(circuit(), &pointer, json!("t")), &[(&pointer, "unknown_name", "t")]);
    }
    let diode = json!({"name": "D1", "nodes": ["in", "out"], "forward_volts": -0.7});
    let pointer = format!("{PLACE}/3/diode/forward_volts");
    assert_errors(&and("diode", diode), &[(&pointer, "out_of_range", "forward volts of `D1` are -0.7")]);
    let zener = json!({"name": "D1", "nodes": ["in", "out"], "breakdown_volts": 0});
    assert_errors(&and("zener", zener), &[(&format!("{PLACE}/3/zener/breakdown_volts"), "out_of_range", "")]);
    let source = format!("{PLACE}/0/voltage_source/volts");
    assert_errors(&with(circuit(), &source, json!("sin(x)")), &[(&source, "unknown_name", "x")]);
}

#[test]
fn an_error_in_a_netlist_has_its_line_and_column() {
    assert_netlist("R1 a 0 1\nQ1 a b c", &[("unknown_component", "line 2, column 1: `Q1`")]);
    assert_netlist(".step R 1 2", &[("unknown_component", "line 1, column 1: the command `.step`")]);
    assert_netlist("* one\n  R1 a 0 1k2", &[("malformed_number", "line 2, column 10: `1k2` is not a number")]);
    assert_netlist("R1 a", &[("incomplete_component", "line 1, column 4: something is missing after `a`")]);
    assert_netlist("C1 a 0 1u IC 5", &[("unexpected_word", "line 1, column 14: found `5` where `=` is expected")]);
    assert_netlist("D1 a 0 1N4148", &[("unknown_name", "line 1, column 8: there is no model `1N4148`")]);
    assert_netlist("V1 a 0 SFFM(0 1)", &[("unknown_source", "line 1, column 8: `SFFM`")]);
    assert_netlist("V1 a 0 EXP(0 1)", &[("malformed_source", "line 1, column 8: EXP has 2 values")]);
    assert_netlist(
        "V1 a 0 SIN(1)\nV2 b 0 PULSE(0 1\n+ 0 1 1 1 2)\nV3 c 0 PWL(1 2 0 3)\nV4 d 0 PWL(1 2 3)\nV5 e 0 PULSE(0 1 -1)",
        &[
            ("malformed_source", "line 1, column 8: SIN has 1 values"),
            ("malformed_source", "line 3, column 11: the period"),
            ("malformed_source", "line 4, column 16: the times of PWL decrease"),
            ("malformed_source", "line 5, column 8: PWL has 3 values"),
            ("malformed_source", "line 6, column 18: a time of PULSE is below zero"),
        ],
    );
    assert_netlist("R1 a 0 -5\nC1 a 0 1u", &[("out_of_range", "line 1: the ohms of `R1` are -5")]);
    assert_netlist("R1 a 0 1\nr1 A 0 2\nC1 a 0 1", &[("duplicate_name", "line 2: `R1`")]);
}

#[test]
fn an_error_in_a_deck_has_its_line_and_column() {
    let title = "A deck\n.tran 1u 1m\n";
    for (text, code, part) in [
        ("R1 a 0 {x}", "malformed_number", "line 3, column 8: `{x}`: there is no parameter `x`"),
        ("R1 a 0 {1+", "malformed_number", "line 3, column 8"),
        ("R1 a 0 {(1}", "malformed_number", "`)` is missing"),
        (".param a={b} b={a}\nR1 a 0 1", "malformed_number", "line 3, column 16: `{a}`: there is no parameter `a`"),
        (".model X NPN(BF=100)", "unknown_component", "line 3, column 10: models of `NPN`"),
        ("S1 a 0 c 0 X\n.model X D", "unknown_name", "line 3, column 12: the model `X` is one of another kind"),
        ("S1 a 0 c 0 X\n.model X SW(VH=-1)", "out_of_range", "smooth switch"),
        ("X1 a b nothing", "unknown_name", "line 3, column 8: there is no subcircuit `nothing`"),
        ("X1 a two\n.subckt two a b\nR1 a b 1\n.ends", "wrong_count", "has 2 nodes, and 1 are given"),
        (".subckt two a b\nR1 a b 1", "incomplete_component", "line 3, column 9: the subcircuit `two` has no end"),
        ("X1 a loop\n.subckt loop a\nX1 a loop\n.ends", "too_deep", "16 levels"),
        ("K1 L1 L2 0.5", "unknown_name", "line 3, column 1: `K1` must couple"),
        ("L1 a 0 1\nL2 b 0 1\nK1 L1 L2 1.5", "out_of_range", "the coupling coefficient is 1.5"),
        ("R1 a 0 1\n.ic V(a)=1", "inconsistent_start", ".ic of `a`"),
        ("R1 a 0 1\n.ic V(a)", "unexpected_word", "`V` is not an initial value"),
        (".lib diodes.lib", "unknown_component", "line 3, column 1: the command `.lib`"),
        (".tran 0", "malformed_source", "line 3, column 1: .tran has no end above zero"),
    ] {
        assert_netlist(&format!("{title}{text}\n.end"), &[(code, part)]);
    }
}

#[test]
fn subcircuits_that_multiply_are_answered() {
    let levels: String = (0..15).map(|k| format!(".subckt s{k} a\nX1 a s{0}\nX2 a s{0}\n.ends\n", k + 1)).collect();
    let text = format!("{levels}.subckt s15 a\nR1 a 0 1\n.ends\nX1 a s0\nC1 a 0 1");
    let errors = Specification::from_json(netlist(&text).to_string().as_bytes()).unwrap_err();
    assert!(
        errors.iter().all(|error| ["number_of_components", "too_deep", "too_many_unknowns"].contains(&error.code)),
        "{errors:?}"
    );
}

/// A fault that concerns several components of a netlist is reported at the line of the first of them, and an unknown
/// name in the law of a component at the line of the law.
#[test]
fn faults_of_a_netlist_have_the_line_of_a_component() {
    for (text, code, part) in [
        ("R1 a 0 1\nV1 a 0 1\nV2 a 0 2", "source_loop", "form a loop"),
        ("C1 a 0 1u\nI1 a b 1\nI2 b 0 1", "source_cut_set", "line 2: `I1`, `I2`"),
        ("R1 a b 1\nV1 a 0 5\nC1 a 0 1u IC=2\nR2 b 0 1", "inconsistent_start", "line 3: `C1` starts"),
        ("V1 a 0 5\nR1 a 0 1\nC1 a 0 1u\nH1 k 0 V9 10\nR2 k 0 1", "unknown_name", "line 4: there is no `i(V9)`"),
    ] {
        let errors = errors_of(netlist(text).to_string());
        let (error, others) = errors.split_first().expect("an error");
        assert!(others.is_empty() && error.pointer == NETLIST && error.code == code, "{errors:#?}");
        assert!(error.detail.starts_with("line ") && error.detail.contains(part), "{errors:#?}");
    }
}

#[test]
fn couplings_that_no_inductors_have_are_refused() {
    let coils = "V1 a 0 1\nR1 a p 1\nL1 p 0 1m\nL2 s 0 1m\nL3 u 0 1m\nR2 s 0 1\nR3 u 0 1\n";
    for (couplings, code, part) in [
        ("K12 L1 L2 .9\nK13 L1 L3 .9\nK23 L2 L3 .1", "out_of_range", "line 8, column 1: no inductors can have"),
        (
            "K1 L1 L2 1\nK2 L2 L3 1\nK3 L1 L3 0.5",
            "out_of_range",
            "no inductors can have the coupling coefficients of `L1`",
        ),
        ("K1 L1 L2 .5\nK2 L2 L1 .5", "out_of_range", "line 9, column 1: `K2` couples two inductors that are"),
        ("K1 L1 L2 L1 .5", "out_of_range", "`K1` couples two inductors that are"),
        ("K1 L1 L2 L4 .5", "unknown_name", "`K1` must couple inductors"),
        ("K1 L1 R2 .5", "unknown_name", "`K1` must couple inductors"),
        ("K1 L1 L2 L3", "malformed_number", "`L3`"),
        ("K1 L1 L2 L3 1.1", "out_of_range", "1.1"),
    ] {
        assert_netlist(&format!("{coils}{couplings}"), &[(code, part)]);
    }
    let many: Vec<String> = (1..200).map(|k| format!("L{k} n{k} 0 1\nR{k} n{k} 0 1")).collect();
    let names: Vec<String> = (1..200).map(|k| format!("L{k}")).collect();
    let text = format!("V1 a 0 1\nR0 a n1 1\n{}\nK1 {} 0.5", many.join("\n"), names.join(" "));
    assert_netlist(&text, &[("number_of_components", "199 inductors that are coupled")]);
}

#[test]
fn large_and_hostile_netlists_are_answered() {
    assert_netlist(&"*".repeat(65_537), &[("too_long", "65537 bytes")]);
    assert_netlist("", &[("number_of_components", "0 components")]);
    assert_netlist("\u{0}\u{e9}(((=,,;\n+\n+ +", &[("unknown_component", "line 1, column 1")]);
    let many: Vec<Value> =
        (0..10_001).map(|k| json!({"resistor": {"name": format!("R{k}"), "nodes": ["a", "0"], "ohms": 1}})).collect();
    assert_errors(&with(circuit(), PLACE, json!(many)), &[(PLACE, "number_of_components", "10001")]);
    let chain: String = (0..2500).map(|k| format!("R{k} n{k} n{} 1\nD{k} n{k} 0\n", k + 1)).collect();
    assert_netlist(&chain, &[("too_long", "bytes")]);
}

#[test]
fn what_a_law_names_and_the_circuit_does_not_have_is_told_with_what_it_has() {
    let document = json!({
        "problem": {"circuit": {"components": [
            {"voltage_source": {"name": "V1", "nodes": ["a", "0"], "volts": "2*v(outt) + i(R7)"}},
            {"resistor": {"name": "R1", "nodes": ["a", "out"], "ohms": 1}},
            {"capacitor": {"name": "C1", "nodes": ["out", "0"], "farads": 1}}
        ]}},
        "time": {"end": 1}
    });
    let errors = errors_of(document.to_string());
    assert_eq!(errors[0].pointer, "/problem/circuit/components/0/voltage_source/volts");
    assert!(errors[0].detail.starts_with("there is no `v(outt)`"), "{}", errors[0].detail);
    assert_eq!(errors[0].did_you_mean.as_deref(), Some("v(out)"));
}

/// SPICE netlists ("decks") with words and lines deleted, duplicated, swapped, and inserted from other netlists.
#[test]
fn mangled_decks_are_answered_at_a_line_they_have() {
    let decks = [
        "Buck\nV1 in 0 24\nS1 in sw g 0 MOS\nD1 0 sw DI\nL1 sw out 100u IC=0\nR1 out 0 2\nC1 out 0 {2*c}\n\
         Vg g 0 PULSE(0 10 0 0 0 20u 50u)\n.param c=10u\n.model MOS SW(Ron=50m VT=5 VH=0)\n.model DI D(VFWD=0)\n.tran 1u 1m uic\n.end",
        "Ladder\nV1 in 0 SIN(0 1 50)\nX1 in a rc\nX2 a b rc r=2k\n.subckt rc i o r=1k\nR1 i o {r}\nC1 o 0 1u\n.ends\n\
         .ic V(a)=1 V(b)='1/2'\nE1 e 0 a b 2\nRe e 0 1k\nW1 e 0 V1 CS\n.model CS CSW(IT=1m)\n.tran 1m 10m\n.end",
        "Coils\nI1 0 p EXP(0 1 1m 1m)\nL1 p 0 1\nL2 s 0 1m\nK1 L1 L2 0.9\nR1 s 0 1Meg\nF1 0 q V9 3\nV9 q r 0\nRq r 0 1\n\
         .control\nrun\n.endc\n.options reltol=1e-4\n.tran 1 2\n.end",
    ];
    let words: Vec<&str> = decks.iter().flat_map(|deck| deck.split_inclusive([' ', '\n', '=', '(', ')'])).collect();
    let mut random = fastrand::Rng::with_seed(7);
    let mut refused = 0;
    for _ in 0..2000 {
        let mut text: Vec<&str> =
            random.choice(decks).unwrap_or_default().split_inclusive([' ', '\n', '=', '(', ')']).collect();
        for _ in 0..random.usize(1..6) {
            let (at, other) = (random.usize(0..text.len()), random.usize(0..text.len()));
            match random.u8(0..4) {
                0 if text.len() > 1 => drop(text.remove(at)),
                1 => text.insert(at, text[other]),
                2 => text.swap(at, other),
                _ => text.insert(at, words[random.usize(0..words.len())]),
            }
        }
        let text = text.concat();
        let Err(errors) = Specification::from_json(netlist(&text).to_string().as_bytes()) else { continue };
        refused += 1;
        for error in errors {
            assert_eq!(error.pointer, NETLIST, "{error:?} of\n{text}");
            if let Some(line) = error.detail.strip_prefix("line ") {
                let number: usize = line.split([',', ':']).next().and_then(|line| line.parse().ok()).expect("a number");
                assert!((1..=text.lines().count()).contains(&number), "{error:?} of\n{text}");
            }
        }
    }
    assert!((500..2000).contains(&refused), "{refused}");
}
