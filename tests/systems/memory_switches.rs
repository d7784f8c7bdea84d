//! Problems with memory (Volterra convolutions) and known switches, which are located at the order of the method; a
//! new mesh begins after each switch.

use crate::systems::harness::{column, distance, events, last, solve};
use crate::systems::memory::{abel, gamma};
use dvi::solution::{EventKind, Solution};
use serde_json::{Value, json};
use std::f64::consts::PI;

/// Specification of a problem with memory: one variable between 0 and 1 and the fractional kernel of the exponent
/// `alpha`.
fn relaxation(alpha: f64, q: &str, end: f64, method: Value, times: usize) -> Value {
    json!({
        "problem": {"convolution": {
            "variables": {"u": {"q": q}},
            "kernel": {"fractional": {"exponent": alpha}},
            "set": [{"box": {"of": ["u"], "lower": 0, "upper": 1}}]
        }},
        "time": {"end": end},
        "method": method,
        "output": {"times": {"count": times}}
    })
}

fn assert_located(solution: &Solution, at_most: u64) {
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    assert_proven(solution, at_most);
}

fn assert_proven(solution: &Solution, at_most: u64) {
    assert!(solution.diagnostics.built.contains(&"located switches"), "{:?}", solution.diagnostics.left_out);
    let steps = solution.diagnostics.steps.accepted;
    assert!(steps <= at_most, "{steps} steps");
    let screening = solution.diagnostics.screening.expect("elements are screened");
    assert_eq!((screening.proven, screening.undecided, screening.missed), (steps, 0, 0));
}

/// A variable `u` that rises in ramps from 0 to 1, rests, falls in ramps to 0 and rests, `cycles` times; the residual
/// `w` follows parabolas while `u` rests. Returns the data `q` of this solution, the times of its switches, and the
/// end.
fn ramps(alpha: f64, cycles: usize) -> (String, Vec<f64>, f64) {
    let factor = gamma(alpha + 2.0);
    let (mut q, mut switches, mut t) = (String::from("max(0.3 - t, 0)"), Vec::new(), 0.3);
    for i in 0..cycles {
        let i = i as f64;
        let lengths = [
            0.4 + 0.1 * (3.0 * i + 1.0).sin(),
            0.5 + 0.2 * (5.0 * i).sin(),
            0.3 + 0.1 * (2.0 * i).cos(),
            0.4 + 0.2 * (7.0 * i + 2.0).cos(),
        ];
        let mut knots = vec![t];
        lengths.iter().for_each(|length| knots.push(knots[knots.len() - 1] + length));
        for (knot, slope) in
            knots.iter().zip([1.0 / lengths[0], -1.0 / lengths[0], -1.0 / lengths[2], 1.0 / lengths[2]])
        {
            q += &format!(" - ({:e})*max(t - {knot}, 0)^{}", slope / factor, 1.0 + alpha);
        }
        for (from, to, sign) in [(knots[1], knots[2], -1.0), (knots[3], knots[4], 1.0)] {
            let length = to - from;
            q += &format!(
                " + ({sign})*({length}*(max(t - {from}, 0) + max(t - {to}, 0)) - max(t - {from}, 0)^2 + max(t - {to}, 0)^2)"
            );
        }
        switches.extend(&knots[..4]);
        t = knots[4];
    }
    (q, switches, t)
}

#[test]
fn fifty_two_known_switches_are_located() {
    for alpha in [0.3, 0.5, 0.8] {
        let (q, switches, end) = ramps(alpha, 13);
        let u = |t: f64| {
            let next = switches.partition_point(|switch| *switch < t);
            let Some(last) = next.checked_sub(1) else { return 0.0 };
            let part = || (t - switches[last]) / (switches[next] - switches[last]);
            match last % 4 {
                0 => part(),
                1 => 1.0,
                2 => 1.0 - part(),
                _ => 0.0,
            }
        };
        let solution = solve(&relaxation(alpha, &q, end, json!({"rtol": 1e-8}), 1001));
        assert_located(&solution, 5_000);
        let found = events(&solution, "u");
        assert_eq!(found.len(), switches.len(), "alpha = {alpha}: {found:?}");
        let apart = found.iter().zip(&switches).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "alpha = {alpha}: {apart:e}");
        let kinds = solution.trajectory.events.iter().map(|event| event.kind);
        let in_turn = [EventKind::Activated, EventKind::Deactivated].into_iter().cycle();
        assert!(kinds.eq(in_turn.take(switches.len())), "{:?}", solution.trajectory.events);
        assert_eq!(solution.diagnostics.switches, switches.len() as u64);
        let error = distance(&solution, "u", u);
        assert!(error < 1e-8, "alpha = {alpha}: {error:e}");
    }
}

#[test]
fn a_relaxation_between_bounds_switches_fifty_times() {
    // The variable u stays at zero until q = 0, its first switch. The other switches are compared between runs with
    // different meshes and tolerances.
    for alpha in [0.3, 0.5, 0.8, 0.9] {
        let q = "1.2 - cos(3*t) - 1.4*sin(t)^2";
        let run =
            |rtol: f64, stages: u32| solve(&relaxation(alpha, q, 70.0, json!({"rtol": rtol, "stages": stages}), 4501));
        let (first, second) = (run(1e-7, 5), run(1e-9, 7));
        let (a, b) = (events(&first, "u"), events(&second, "u"));
        assert_located(&first, 5_000);
        assert_located(&second, 5_000);
        assert!(a.len() >= 50 && a.len() == b.len(), "alpha = {alpha}: {} and {} switches", a.len(), b.len());
        let apart = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "alpha = {alpha}: switches differ by {apart:e}");
        let q_at_first = 1.2 - (3.0 * a[0]).cos() - 1.4 * a[0].sin().powi(2);
        assert!(q_at_first.abs() < 1e-13, "alpha = {alpha}: q = {q_at_first:e} at the first switch");
        // Runs on a uniform grid, which do not locate switches, converge slowly to the same solution.
        let uniform = solve(&relaxation(alpha, q, 70.0, json!({"step": 70.0 / 65536.0}), 4501));
        let pairs = column(&first, "u").iter().zip(column(&uniform, "u"));
        let mean = pairs.map(|(a, b)| (a - b).abs()).sum::<f64>() / 4501.0;
        assert!(mean < 2e-4, "alpha = {alpha}: {mean:e} from the uniform grid");
    }
}

#[test]
fn of_order_one_the_switches_are_those_of_an_integral() {
    // With a kernel exponent of one the problem is w' = u + q', which has no memory and which Radau IIA solves with an
    // inequality at every stage. It has hundreds of switches, some of them from pulses narrower than any mesh.
    let forces = [
        ("0.1 - 0.5*t - 0.25*sin(3*t)", 70.0, 130),
        ("1 - 3*exp(-((t - 7.3)/1e-3)^2)", 10.0, 2),
        ("-0.3*t - 0.01*exp(-((t - 7.3)/1e-3)^2)", 10.0, 3),
        ("-1e-5 + (t - 3)^2", 10.0, 2),
        ("0.2 - sin(t) - 0.1*max(sin(7*t), 0)", 10.0, 5),
    ];
    for (q, end, at_least) in forces {
        let solution = solve(&relaxation(1.0, q, end, json!({"rtol": 1e-9}), 1001));
        assert_located(&solution, 5_000);
        let system = solve(&json!({
            "problem": {"dvi": {
                "states": {"w": {"initial": 0, "rate": "u"}},
                "variables": {"u": {"inequality": format!("w + {q}")}},
                "set": [{"box": {"of": ["u"], "lower": 0, "upper": 1}}]
            }},
            "time": {"end": end}, "method": {"rtol": 1e-10, "max_step": 0.01}, "output": {"times": {"count": 1001}}
        }));
        let (found, exact) = (events(&solution, "u"), events(&system, "u"));
        assert!(found.len() >= at_least && found.len() == exact.len(), "q = {q}: {} and {}", found.len(), exact.len());
        let apart = found.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "q = {q}: {apart:e}");
        let pairs = column(&solution, "integral_u").iter().zip(column(&system, "w"));
        let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-8, "q = {q}: {apart:e}");
    }
}

#[test]
fn pulses_between_the_nodes_are_not_missed() {
    // The variable is at its bound until q = 0: the first switch is a root of q, however short the pulse.
    for alpha in [0.3, 0.5, 0.8, 1.0, 1.5] {
        for width in [1e-2, 1e-3, 1e-5] {
            let q = format!("1 - 3*exp(-((t - 7.3)/{width:e})^2)");
            let solution = solve(&relaxation(alpha, &q, 10.0, json!({"rtol": 1e-6}), 11));
            assert_proven(&solution, 500);
            // For kernel exponents above one, the active set after a switch is not verified, so that the verdict does
            // not trust the solution.
            assert_eq!(solution.verdict.trusted, alpha <= 1.0, "{:?}", solution.verdict);
            let first = *events(&solution, "u").first().expect("the pulse");
            let exact = 7.3 - width * 3.0_f64.ln().sqrt();
            assert!((first - exact).abs() < 1e-9, "alpha = {alpha}, width {width:e}: {first}, not {exact}");
        }
    }
}

#[test]
fn a_bound_that_moves_for_a_moment_is_followed() {
    // The variable u is at its upper bound, a pulse whose convolution with exp(-t) is sqrt(pi) width exp(7.313 - t)
    // after the pulse.
    for width in [0.5, 5e-3, 1e-4] {
        let solution = solve(&json!({"problem": {"convolution": {"variables": {"u": {"q": -10}},
            "set": [{"box": {"of": ["u"], "lower": 0, "upper": format!("exp(-((t - 7.313)/{width:e})^2)")}}],
            "kernel": {"entries": [["exp(-t)"]]}}}, "time": {"end": 20},
            "output": {"times": [0, 7.313 - width, 7.313, 20]}, "method": {"rtol": 1e-6}}));
        assert_located(&solution, 400);
        let u = &solution.trajectory.fields[0].values;
        let e = (-1.0_f64).exp();
        let off = u.iter().zip([0.0, e, 1.0, 0.0]).map(|(u, told)| (u - told).abs()).fold(0.0, f64::max);
        assert!(off < 1e-6, "{width:e}: {u:?}");
        let area = last(&solution, "integral_u") / width;
        assert!((area - PI.sqrt()).abs() < 1e-5, "{width:e}: {area}");
    }
}

#[test]
fn one_switch_has_a_closed_form_behind_it() {
    // For q = (1 - t)(1 + t), u solves I^a u = 2 s + s^2 with s = t - 1 and the fractional integral I^a, and leaves
    // zero as s^(1-a).
    for alpha in [0.2, 0.5, 0.9] {
        let exact = |t: f64| {
            let s = (t - 1.0).max(0.0);
            2.0 * s.powf(1.0 - alpha) / gamma(2.0 - alpha) + 2.0 * s.powf(2.0 - alpha) / gamma(3.0 - alpha)
        };
        for rtol in [1e-4, 1e-6, 1e-8] {
            let mut document = abel(alpha, "(1 - t)*(1 + t)", 3.0, json!({"rtol": rtol}));
            document["output"] = json!({"times": {"count": 301}});
            let solution = solve(&document);
            assert_located(&solution, 200);
            let found = distance(&solution, "u", exact);
            assert!(found < 10.0 * rtol, "alpha = {alpha}, rtol = {rtol:e}: {found:e}");
            let starts = events(&solution, "u");
            assert!(starts.len() == 1 && (starts[0] - 1.0).abs() < 1e-12, "alpha = {alpha}: {starts:?}");
        }
    }
}

/// Exponent of a fractional kernel, the switching times of the solution, and values of the variable between them as
/// `(t, u)`.
type Reference = (f64, &'static [f64], &'static [(f64, f64)]);

/// References for `q = 1.2 - cos(3t) - 1.4 sin(t)^2`, by another method in 30 digits: after a switch, the inverse of
/// Abel's integral is applied to each term of the series of `q` and of the contribution of the past; switches are
/// roots of that series, and of `w` by quadrature.
const REFERENCES: [Reference; 3] = [
    (
        0.3,
        &[
            1.505691743240325,
            1.710820613464987,
            2.055920284704898,
            2.278785394183998,
            3.902865940839273,
            4.09718134123187,
        ],
        &[
            (1.55697396079649, 0.4235104516361165),
            (1.608256178352656, 0.6706102170678642),
            (1.659538395908821, 0.8585388165244415),
            (2.111636562074673, 0.7527321583751937),
            (2.167352839444448, 0.5242515735308274),
            (2.223069116814223, 0.2728349429758291),
            (3.951444790937422, 0.4677971391753215),
            (4.000023641035572, 0.7163017323951388),
            (4.048602491133721, 0.8872044785311692),
        ],
    ),
    (
        0.5,
        &[
            1.505691743240325,
            1.592333763309253,
            2.097001639674331,
            2.206328865456579,
            3.93560321016249,
            4.015755978935239,
            4.340670661057666,
            4.506566005584832,
        ],
        &[
            (1.527352248257556, 0.5158881220435863),
            (1.549012753274789, 0.7236824350848411),
            (1.570673258292021, 0.877150189625996),
            (2.124333446119893, 0.5955695205856711),
            (2.151665252565455, 0.382122656326165),
            (2.178997059011017, 0.1879909382447063),
            (3.955641402355678, 0.5481619097115176),
            (3.975679594548865, 0.7535601613991036),
            (3.995717786742052, 0.8950900226244193),
            (4.382144497189457, 0.6576695650639689),
            (4.423618333321249, 0.4381366260970722),
            (4.46509216945304, 0.2204639520251917),
        ],
    ),
    (
        0.8,
        &[
            1.505691743240325,
            1.507889042509664,
            2.154261716602965,
            2.158114838711207,
            4.010708511153839,
            4.013723079699698,
            4.346004560902229,
            4.384674007376464,
        ],
        &[
            (1.506241068057659, 0.7582127651784144),
            (1.506790392874994, 0.8708237597980035),
            (1.507339717692329, 0.9442365888737575),
            (2.155224997130026, 0.2484491415188027),
            (2.156188277657086, 0.1342775467101834),
            (2.157151558184147, 0.05852931351417706),
            (4.011462153290303, 0.7618866124795565),
            (4.012215795426768, 0.8736378973947977),
            (4.012969437563234, 0.9457628975132256),
            (4.355671922520788, 0.3390935970568861),
            (4.365339284139347, 0.203407457720918),
            (4.375006645757906, 0.09584886559193166),
        ],
    ),
];

#[test]
fn the_order_holds_over_switches() {
    for (alpha, switches, values) in REFERENCES {
        let end = switches[switches.len() - 1] + 0.1;
        let run = |rtol: f64| {
            let q = "1.2 - cos(3*t) - 1.4*sin(t)^2";
            let mut document = relaxation(alpha, q, end, json!({"rtol": rtol}), 2);
            let times: Vec<f64> = std::iter::once(0.0).chain(values.iter().map(|(t, _)| *t)).collect();
            document["output"] = json!({"times": times});
            let solution = solve(&document);
            assert_located(&solution, 5_000);
            let found = events(&solution, "u");
            assert_eq!(found.len(), switches.len(), "alpha = {alpha}: {found:?}");
            let apart = found.iter().zip(switches).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < rtol.min(1e-8), "alpha = {alpha}, rtol = {rtol:e}: switches are off by {apart:e}");
            let pairs = column(&solution, "u")[1..].iter().zip(values);
            let error = pairs.map(|(u, (_, exact))| (u - exact).abs()).sum::<f64>() / values.len() as f64;
            assert!(error < rtol, "alpha = {alpha}, rtol = {rtol:e}: {error:e}");
            (error, solution.diagnostics.steps.accepted as f64)
        };
        let ((coarse, few), (fine, many)) = (run(1e-6), run(1e-9));
        let order = (coarse / fine).ln() / (many / few).ln();
        // For the exponent 0.8 each segment between switches is a single element of the mesh even at the coarsest
        // tolerance, and only rounding errors remain.
        assert!(order >= 3.0 || coarse < 1e-10, "order {order}: {coarse:e} in {few}, {fine:e} in {many}");
    }
}

#[test]
fn kernels_of_time_and_of_higher_index_have_segments_too() {
    // The solution of (t^0.9 / Gamma(1.9)) * u = t^2 is u = 2 t^0.1 / Gamma(1.1), where * is the convolution.
    let solution = solve(&json!({
        "problem": {"convolution": {
            "variables": {"u": {"q": "-t^2"}},
            "kernel": {"fractional": {"exponent": 1.9}},
            "set": [{"free": ["u"]}]
        }},
        "time": {"end": 2}, "output": {"times": {"count": 41}}
    }));
    assert_located(&solution, 500);
    let found = distance(&solution, "u", |t| 2.0 * t.powf(0.1) / gamma(1.1));
    assert!(found < 1e-6, "{found:e}");
}

#[test]
fn a_relay_with_memory_of_high_order_is_not_trusted() {
    // A kernel of exponent two gives `w'' = u`, where u in [-1, 1] opposes w, which oscillates between -0.3 and 0.3
    // for ever; the run mistakes a switch for rest.
    let document = json!({
        "problem": {"convolution": {
            "kernel": {"fractional": {"exponent": 2}},
            "variables": {"u": {"q": "-0.3"}},
            "set": [{"box": {"of": ["u"], "lower": -1, "upper": 1}}]
        }},
        "time": {"end": 10}
    });
    assert!(!solve(&document).verdict.trusted);
}
