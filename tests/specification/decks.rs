//! SPICE netlists ("decks") with random changes: each is read or refused, and a fault of a line has the line number.

use dvi::specification::{Specification, document_of};

/// A netlist with every kind of line that a netlist may have.
const DECK: &str = "Everything at once
.param vin=24 duty={0.4*1} period = 50u
V1 in 0 DC {vin}
V2 s 0 SIN(0 10 1k 0 5 30)
V3 p 0 PULSE(0 5 0 1n 1n 20u 50u)
V4 w 0 PWL(0 0 1m 5 2m 0)
I1 0 e EXP(1 5 1m 2m 4m 1m)
R1 in out 4.7k
R2 s a 1Meg
R3 p 0 1m
R4 w 0 {vin/2}
R5 e 0 100 ; a comment
C1 out 0 100u IC=0
C2 a b 1n
D1 out b DX
D2 0 b DZ
L1 in x 1m IC=0.5
L2 y 0 4m
L3 z 0 2m
R6 x 0 1
R7 y 0 10
R8 z 0 5
K12 L1 L2 0.9
K13 L1 L3 0.8
K23 L2 L3 0.7
S1 in q p 0 SX
W1 q 0 V4 WX
E1 f 0 out 0 2
R9 f 0 1k
F1 0 g V4 50
R10 g 0 1k
G1 0 h out 0 1m
R11 h 0 1k
H1 k 0 V4 10
R12 k 0 1k
X1 out m filter r=2k
R13 m 0 1k
.subckt filter i o r=1k
Rf i o {r}
Cf o 0 1u
.ends filter
.model DX D(IS=1n N=1.8 VF=0.7)
.model DZ D(BV=5.1 VF=0.7)
.model SX SW(VT=2.5 VH=0.5 RON=1m)
.model WX CSW(IT=1m)
.ic V(out)=1
.tran 1u 5m 0 1u
+ uic
.end
";

/// Codes of faults that concern the whole netlist and have no line number; `missing_key` is one of them, since a
/// `.tran` within a subcircuit sets no end time.
const OF_THE_DECK: [&str; 8] = [
    "dead_circuit",
    "floating_node",
    "missing_key",
    "more_errors",
    "number_of_components",
    "singular_circuit",
    "too_intertwined",
    "too_many_unknowns",
];

/// Returns the test netlist with random changes of words and lines.
fn changed(random: &mut fastrand::Rng) -> String {
    const PIECES: [&str; 24] = [
        "\n",
        "+",
        "(",
        ")",
        "=",
        "{",
        "}",
        "'",
        "*",
        ";",
        "-1",
        "0",
        "1e999",
        "nan",
        "1e-320",
        "{1/0}",
        "K1",
        "X1",
        "filter",
        ".ends",
        ".param",
        ".subckt",
        "\u{e9}",
        "\u{1f600}",
    ];
    let mut words: Vec<&str> = DECK.split_inclusive([' ', '\n']).collect();
    for _ in 0..=random.usize(0..4) {
        let at = random.usize(0..words.len());
        match random.u8(0..6) {
            0 => drop(words.drain(at..(at + random.usize(0..12)).min(words.len()))),
            1 => words.insert(at, PIECES[random.usize(0..PIECES.len())]),
            2 => words[at] = PIECES[random.usize(0..PIECES.len())],
            3 => {
                let other = random.usize(0..words.len());
                words.swap(at, other);
            }
            4 => {
                let copy = words[at..(at + random.usize(0..12)).min(words.len())].to_vec();
                let to = random.usize(0..=words.len());
                drop(words.splice(to..to, copy));
            }
            _ => {
                // Keeps only the first characters of a word of the netlist.
                let length = words[at].char_indices().map(|(place, _)| place).nth(random.usize(0..3)).unwrap_or(0);
                words[at] = &words[at][..length];
            }
        }
        if words.is_empty() {
            break;
        }
    }
    words.concat()
}

#[test]
fn every_kind_of_line_is_read() {
    let read = Specification::from_json(&document_of(DECK.as_bytes()));
    assert!(read.is_ok(), "{:#?}", read.err());
}

#[test]
fn whatever_is_written_in_a_deck_is_read_or_refused() {
    let count = std::env::var("DVI_DECKS").ok().and_then(|text| text.parse().ok()).unwrap_or(3_000);
    let mut random = fastrand::Rng::with_seed(11);
    let (mut correct, mut refused) = (0, 0);
    for _ in 0..count {
        let deck = changed(&mut random);
        let document = document_of(deck.as_bytes());
        let Err(errors) = Specification::from_json(&document) else {
            correct += 1;
            continue;
        };
        refused += 1;
        for error in &errors {
            // A text without the directive `.tran` is not recognised as a netlist, and is refused as faulty JSON.
            let has_place = error.detail.starts_with("line ")
                || OF_THE_DECK.contains(&error.code)
                || error.code == "syntax" && document == deck.as_bytes();
            assert!(has_place, "{error:#?} of\n{deck}");
        }
    }
    // Both outcomes of the reading, a correct and a refused netlist, occur often; most random changes of this netlist
    // are faults.
    assert!(correct > count / 100 && refused > count / 4, "{correct} correct, {refused} refused");
}
