//! Static variational inequalities, compared with published solutions and closed forms; certificates of uniqueness;
//! and problems with many solutions or none.

use crate::systems::harness::solve;
use dvi::problem::Control;
use dvi::solution::{Solution, StaticSolution, Status};
use dvi::specification::Specification;
use serde_json::{Map, Value, json};

fn problem(variables: &[(&str, &str, f64)], set: Value) -> Value {
    let variables: Map<String, Value> = variables
        .iter()
        .map(|(name, inequality, initial)| ((*name).to_owned(), json!({"inequality": inequality, "initial": initial})))
        .collect();
    json!({"problem": {"vi": {"variables": variables, "set": set}}})
}

/// Specification of a nonlinear complementarity problem with nonnegative variables `x1`, `x2`, .., given the rows of
/// its function and a starting point.
fn complementarity(rows: &[&str], start: &[f64]) -> Value {
    let names: Vec<String> = (1..=rows.len()).map(|i| format!("x{i}")).collect();
    let variables: Vec<(&str, &str, f64)> =
        names.iter().zip(rows).zip(start).map(|((name, row), start)| (name.as_str(), *row, *start)).collect();
    problem(&variables, json!([{"nonnegative": names}]))
}

fn solved(specification: &Value) -> (Solution, StaticSolution) {
    let mut solution = solve(specification);
    assert!(solution.verdict.trusted, "{:?}", solution.verdict);
    let found = solution.solution.take().expect("a solution");
    (solution, found)
}

fn failed(specification: &Value) -> (String, String) {
    let specification = Specification::from_json(specification.to_string().as_bytes()).expect("a specification");
    let solution = dvi::solve(&specification, &Control::new());
    assert!(solution.status == Status::Failed && !solution.verdict.trusted && solution.solution.is_none());
    let error = solution.error.expect("an error");
    (error.code.into_owned(), error.message)
}

fn is_told(solution: &Solution, code: &str) -> bool {
    solution.verdict.caveats.iter().any(|caveat| caveat.code == code)
}

#[track_caller]
fn assert_point(found: &StaticSolution, exact: &[f64], tolerance: f64) {
    for (i, exact) in exact.iter().enumerate() {
        let value = found.z[&format!("x{}", i + 1)];
        assert!((value - exact).abs() <= tolerance * exact.abs().max(1.0), "x{}: {value} for {exact}", i + 1);
    }
}

/// Specification of the Cournot-Nash equilibrium of firms that sell at the price `p(Q) = (5000/Q)^(1/g)`, with the
/// marginal costs `c + (q/L)^(1/b)`.
fn cournot(costs: &[f64], capacity: f64, elasticities: &[f64], demand: f64, start: f64) -> Value {
    let firms = costs.len();
    let total = (1..=firms).map(|i| format!("x{i}")).collect::<Vec<_>>().join(" + ");
    let rows: Vec<String> = costs
        .iter()
        .zip(elasticities)
        .enumerate()
        .map(|(i, (c, b))| format!("{c} + (x{k}/{capacity})^(1/{b}) - price*(1 - x{k}/({demand}*total))", k = i + 1))
        .collect();
    let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
    let mut specification = complementarity(&rows, &vec![start; firms]);
    specification["problem"]["vi"]["definitions"] =
        json!({"total": total, "price": format!("(5000/total)^(1/{demand})")});
    specification["output"] = json!({"fields": ["*", "total"]});
    specification
}

#[test]
fn firms_in_a_market_come_to_their_published_equilibrium() {
    // Reference for the Cournot equilibrium: Murphy, Sherali and Soyster 1982, with the figures of Harker 1984; further
    // digits by Newton's method in an independent program.
    let specification = cournot(&[10.0, 8.0, 6.0, 4.0, 2.0], 5.0, &[1.2, 1.1, 1.0, 0.9, 0.8], 1.1, 10.0);
    let (solution, found) = solved(&specification);
    let exact = [
        36.932_510_815_735_77,
        41.818_141_660_437_62,
        43.706_578_522_274_21,
        42.659_239_743_305_12,
        39.178_952_516_625_02,
    ];
    assert_point(&found, &exact, 1e-10);
    assert!(found.certificate.starts_with("locally unique"), "{}", found.certificate);
    assert!((solution.trajectory.field("total").unwrap()[0] - exact.iter().sum::<f64>()).abs() < 1e-8);
    assert_eq!(solution.trajectory.t, [0.0]);
    // The market of ten firms in the collection MCPLIB (Dirkse and Ferris 1995).
    let elasticities = [1.2, 1.0, 0.9, 0.6, 1.5, 1.0, 0.7, 1.1, 0.95, 0.75];
    let costs = [5.0, 3.0, 8.0, 5.0, 1.0, 3.0, 7.0, 4.0, 6.0, 3.0];
    let (_, found) = solved(&cournot(&costs, 10.0, &elasticities, 1.2, 1.0));
    assert_point(
        &found,
        &[35.352_785_782_468_914, 46.561_140_974_408_27, 4.712_421_097_006_069, 19.910_456_562_854_602],
        1e-10,
    );
}

#[test]
fn the_problems_of_josephy_and_of_kojima_and_shindoh_are_solved_from_their_starts() {
    let root = 6.0_f64.sqrt() / 2.0;
    let first = "3*x1^2 + 2*x1*x2 + 2*x2^2 + x3 + 3*x4 - 6";
    let last = "x1^2 + 3*x2^2 + 2*x3 + 3*x4 - 3";
    let josephy = [first, "2*x1^2 + x1 + x2^2 + 3*x3 + 2*x4 - 2", "3*x1^2 + x1*x2 + 2*x2^2 + 2*x3 + 3*x4 - 1", last];
    for start in [[0.0; 4], [1.0, 1.0, 1.0, 1.0], [100.0; 4], [1.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0]] {
        let (_, found) = solved(&complementarity(&josephy, &start));
        assert_point(&found, &[root, 0.0, 0.0, 0.5], 1e-9);
    }
    // The problem of Kojima and Shindoh has two solutions, one of them degenerate (Facchinei and Pang 2003, page 42).
    let kojima = [first, "2*x1^2 + x1 + x2^2 + 10*x3 + 2*x4 - 2", "3*x1^2 + x1*x2 + 2*x2^2 + 2*x3 + 9*x4 - 9", last];
    let mut met = [false; 2];
    for start in [[0.0; 4], [1.0, 1.0, 1.0, 1.0], [100.0; 4], [1.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0]] {
        let (solution, found) = solved(&complementarity(&kojima, &start));
        let at = |exact: [f64; 4]| (1..=4).all(|i| (found.z[&format!("x{i}")] - exact[i - 1]).abs() < 1e-5);
        let which = [at([root, 0.0, 0.0, 0.5]), at([1.0, 0.0, 3.0, 0.0])];
        assert!(which[0] != which[1], "{found:?}");
        (0..2).for_each(|k| met[k] |= which[k]);
        assert!(is_told(&solution, "many_solutions"), "{:?} {}", solution.verdict, found.certificate);
    }
    assert!(met[0] || met[1]);
}

#[test]
fn billups_problem_is_solved_past_its_local_minimum() {
    // Billups' problem (1995): merit functions have a local minimum near zero that is not a solution.
    let (_, found) = solved(&complementarity(&["(x1 - 1)^2 - 1.01"], &[0.0]));
    assert_point(&found, &[1.0 + 1.01_f64.sqrt()], 1e-9);
}

#[test]
fn murtys_exponential_problem_is_solved() {
    // Murty's problem (1978), on which some pivoting methods visit exponentially many bases: w = M z - e, where M has
    // ones on the diagonal and twos left of it.
    let m = 16;
    let rows: Vec<String> = (1..=m)
        .map(|i| {
            let twos: Vec<String> = (1..i).map(|j| format!("2*x{j}")).collect();
            format!("x{i} + {} - 1", if twos.is_empty() { "0".to_owned() } else { twos.join(" + ") })
        })
        .collect();
    let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
    let (_, found) = solved(&complementarity(&rows, &vec![0.0; m]));
    let mut exact = vec![0.0; m];
    exact[0] = 1.0;
    assert_point(&found, &exact, 1e-12);
}

#[test]
fn mathiesens_market_has_prices_up_to_a_factor() {
    // Mathiesen's market (1987) with endowments 1 and 1/2 has the solutions (1/2, 3 s, s, 2 s) for every s.
    let rows = ["-x2 + x3 + x4", "x1 - 0.75*(x3 + 0.5*x4)/x2", "1 - x1 - 0.25*(x3 + 0.5*x4)/x3", "0.5 - x1"];
    let (_, found) = solved(&complementarity(&rows, &[1.0, 1.0, 1.0, 1.0]));
    let s = found.z["x3"];
    assert!((found.z["x1"] - 0.5).abs() < 1e-8 && s > 0.0);
    assert!((found.z["x2"] / s - 3.0).abs() < 1e-6 && (found.z["x4"] / s - 2.0).abs() < 1e-6, "{found:?}");
    let is_said_to_be_unique = ["the only", "locally unique"].iter().any(|words| found.certificate.starts_with(words));
    assert!(!is_said_to_be_unique, "{}", found.certificate);
}

#[test]
fn colvilles_first_problem_has_its_published_prices_and_quantities() {
    // Problems 86 and 117 of Hock and Schittkowski 1981 as joint optimality conditions: `y` are the variables of one,
    // and `u` those of the other.
    let e = [-15.0, -27.0, -36.0, -18.0, -12.0];
    let c = [
        [30.0, -20.0, -10.0, 32.0, -10.0],
        [-20.0, 39.0, -6.0, -31.0, 32.0],
        [-10.0, -6.0, 10.0, -6.0, -10.0],
        [32.0, -31.0, -6.0, 39.0, -20.0],
        [-10.0, 32.0, -10.0, -20.0, 30.0],
    ];
    let d = [4.0, 8.0, 10.0, 6.0, 2.0];
    let b = [-40.0, -2.0, -0.25, -4.0, -4.0, -1.0, -40.0, -60.0, 5.0, 1.0];
    let a = [
        [-16.0, 2.0, 0.0, 1.0, 0.0],
        [0.0, -2.0, 0.0, 0.4, 2.0],
        [-3.5, 0.0, 2.0, 0.0, 0.0],
        [0.0, -2.0, 0.0, -4.0, -1.0],
        [0.0, -9.0, -2.0, 1.0, -2.8],
        [2.0, 0.0, -4.0, 0.0, 0.0],
        [-1.0, -1.0, -1.0, -1.0, -1.0],
        [-1.0, -2.0, -3.0, -2.0, -1.0],
        [1.0, 2.0, 3.0, 4.0, 5.0],
        [1.0, 1.0, 1.0, 1.0, 1.0],
    ];
    let mut rows: Vec<String> = (0..5)
        .map(|j| {
            let of_y: String = (0..5).map(|k| format!(" + ({})*x{}", 2.0 * c[k][j], k + 1)).collect();
            let of_u: String = (0..10).map(|i| format!(" - ({})*x{}", a[i][j], i + 6)).collect();
            format!("{}{of_y} + {}*x{}^2{of_u}", e[j], 3.0 * d[j], j + 1)
        })
        .collect();
    rows.extend((0..10).map(|i| {
        let of_y: String = (0..5).map(|j| format!(" + ({})*x{}", a[i][j], j + 1)).collect();
        format!("-({}){of_y}", b[i])
    }));
    let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
    let (_, found) = solved(&complementarity(&rows, &[0.0; 15]));
    assert_point(&found, &[0.3, 0.333_467_61, 0.4, 0.428_310_10, 0.223_964_87], 1e-8);
    assert_point(
        &found,
        &[0.3, 0.3335, 0.4, 0.4283, 0.224, 0.0, 0.0, 5.1741, 0.0, 3.0611, 11.8395, 0.0, 0.0, 0.1039, 0.0],
        6e-5,
    );
}

#[test]
fn dantzigs_transport_has_its_published_cost_and_several_plans() {
    // The transport problem of Dantzig 1963, section 3.3: two plants, three markets, and a least cost of 153.675
    // thousand dollars.
    let cost = [[0.225, 0.153, 0.162], [0.225, 0.162, 0.126]];
    let mut variables = Vec::new();
    for (i, row) in cost.iter().enumerate() {
        for (j, cost) in row.iter().enumerate() {
            variables.push((format!("x{i}{j}"), format!("s{i} + {cost} - p{j}")));
        }
    }
    variables.extend([
        ("s0".to_owned(), "350 - x00 - x01 - x02".to_owned()),
        ("s1".to_owned(), "600 - x10 - x11 - x12".to_owned()),
    ]);
    variables.extend(
        [325, 300, 275].iter().enumerate().map(|(j, demand)| (format!("p{j}"), format!("x0{j} + x1{j} - {demand}"))),
    );
    let names: Vec<&String> = variables.iter().map(|(name, _)| name).collect();
    let rows: Vec<(&str, &str, f64)> = variables.iter().map(|(name, row)| (name.as_str(), row.as_str(), 0.0)).collect();
    let mut specification = problem(&rows, json!([{"nonnegative": names}]));
    specification["problem"]["vi"]["definitions"] =
        json!({"cost": "0.225*x00 + 0.153*x01 + 0.162*x02 + 0.225*x10 + 0.162*x11 + 0.126*x12"});
    specification["output"] = json!({"fields": ["cost"]});
    let (solution, _) = solved(&specification);
    assert!((solution.trajectory.field("cost").unwrap()[0] - 153.675).abs() < 1e-9);
    assert!(is_told(&solution, "many_solutions"), "{:?}", solution.verdict);
}

/// Specification of the traffic equilibrium in Braess' network: three routes with the travel demand 6; `u` is the
/// common travel time.
fn braess(bridge: bool) -> Value {
    let mut variables = vec![("h1", "10*(h1 + h3) + 50 + h1 - u", 0.0), ("h2", "50 + h2 + 10*(h2 + h3) - u", 0.0)];
    variables.push(("h3", if bridge { "10*(h1 + h3) + 10 + h3 + 10*(h2 + h3) - u" } else { "h3 + 1000" }, 0.0));
    variables.push(("u", "h1 + h2 + h3 - 6", 0.0));
    problem(&variables, json!([{"nonnegative": ["h1", "h2", "h3"]}, {"free": ["u"]}]))
}

#[test]
fn braess_bridge_makes_everyone_slower() {
    let (_, with) = solved(&braess(true));
    for (name, exact) in [("h1", 2.0), ("h2", 2.0), ("h3", 2.0), ("u", 92.0)] {
        assert!((with.z[name] - exact).abs() < 1e-9, "{with:?}");
    }
    assert!(with.certificate.starts_with("the only solution: "), "{}", with.certificate);
    let (_, without) = solved(&braess(false));
    assert!((without.z["u"] - 83.0).abs() < 1e-9 && (without.z["h1"] - 3.0).abs() < 1e-9);
}

#[test]
fn a_simplex_a_ball_and_a_cone_hold_their_solutions() {
    // The projection of (0.9, 0.4, -1) onto the unit simplex is (0.75, 0.25, 0).
    let rows = [("a", "a - 0.9", 0.0), ("b", "b - 0.4", 0.0), ("c", "c + 1", 0.0)];
    let (_, found) = solved(&problem(&rows, json!([{"simplex": ["a", "b", "c"]}])));
    for (name, exact) in [("a", 0.75), ("b", 0.25), ("c", 0.0)] {
        assert!((found.z[name] - exact).abs() < 1e-9, "{found:?}");
    }
    assert!(found.certificate.starts_with("the only solution: "));
    let rows = [("a", "a - 3", 0.0), ("b", "b - 4", 0.0)];
    let (_, found) = solved(&problem(&rows, json!([{"ball": {"of": ["a", "b"], "radius": 2}}])));
    assert!((found.z["a"] - 1.2).abs() < 1e-9 && (found.z["b"] - 1.6).abs() < 1e-9, "{found:?}");
}

#[test]
fn a_string_on_a_floor_is_solved_at_its_nodes() {
    // An obstacle problem, -u'' + 1 >= 0 with u >= 0 on [-1, 1] and u(+-1) = 1/8: u = (|x| - 1/2)^2/2 where there is
    // no contact, which central differences reproduce.
    let n = 399;
    let h = 2.0 / f64::from(n + 1);
    let specification = json!({"problem": {"vi": {"parameters": {"n": n, "h": h},
        "definitions": {"u[0]": 0.125, "u[n+1]": 0.125},
        "variables": {"u[1..n]": {"inequality": "(2*u[i] - u[i-1] - u[i+1])/h^2 + 1"}},
        "set": [{"nonnegative": ["u[1..n]"]}]}}});
    let (_, found) = solved(&specification);
    for i in 1..=n {
        let x = -1.0 + f64::from(i) * h;
        let exact = 0.5 * (x.abs() - 0.5).max(0.0).powi(2);
        let value = found.z[&format!("u[{i}]")];
        assert!((value - exact).abs() < 1e-11, "{i}: {value} for {exact}");
    }
    assert!(found.certificate.starts_with("the only solution: "), "{}", found.certificate);
}

#[test]
fn a_continuum_of_solutions_is_told() {
    let (solution, found) = solved(&complementarity(&["x1 + x2 - 2", "x1 + x2 - 2"], &[0.5, 0.1]));
    assert!((found.z["x1"] + found.z["x2"] - 2.0).abs() < 1e-10);
    assert!(is_told(&solution, "many_solutions"), "{:?}", solution.verdict);
}

#[test]
fn a_problem_without_solution_says_why_there_is_none() {
    // Infeasible problems: a row that is negative everywhere, a row that is negative within the bounds of the other
    // variables, and rows that contradict each other.
    for (rows, part) in [
        (vec!["-1 - exp(x1)"], "the inequality of `x1` is negative"),
        (vec!["x1 + x2", "-x1 - 1"], "the inequality of `x2`"),
        (vec!["x1 - x2 - 1", "x2 - x1 - 1"], "contradict each other"),
    ] {
        let (code, message) = failed(&complementarity(&rows, &vec![1.0; rows.len()]));
        assert_eq!(code, "no_solution", "{message}");
        assert!(message.contains(part), "{message}");
    }
    // For a free x, x^2 + 1 = 0 is infeasible, which interval arithmetic proves; (x - 1)^2 + 0.01 = 0 is infeasible
    // without a proof.
    let free = |row: &str| problem(&[("x1", row, 0.3)], json!([{"free": ["x1"]}]));
    assert_eq!(failed(&free("x1^2 + 1")).0, "no_solution");
    let (code, message) = failed(&free("x1^2 - 2*x1 + 1.01"));
    assert_eq!(code, "vi_unsolved");
    assert!(message.contains("nor a proof that there is none"), "{message}");
}

#[test]
fn the_traffic_of_sioux_falls_comes_to_its_published_flows() {
    // Flows are in thousands of vehicles, by link and destination; the unknowns also include the travel time from
    // each node to each destination.
    let data: Value = serde_json::from_str(include_str!("../reference/sioux_falls.json")).unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    let links: Vec<Vec<f64>> = data["links"]
        .as_array()
        .unwrap()
        .iter()
        .map(|link| link.as_array().unwrap().iter().map(number).collect())
        .collect();
    let (mut definitions, mut variables) = (Map::new(), Map::new());
    for a in 0..links.len() {
        let all: Vec<String> = (1..=24).map(|d| format!("x{a}_{d}")).collect();
        definitions.insert(format!("v{a}"), json!(all.join(" + ")));
    }
    for d in 1..=24_usize {
        let time = |node: f64| if node == d as f64 { "0".to_owned() } else { format!("p{node}_{d}") };
        for (a, link) in links.iter().enumerate() {
            let row =
                format!("{}*(1 + 0.15*(v{a}/{})^4) + {} - {}", link[3], link[2] / 1000.0, time(link[1]), time(link[0]));
            variables.insert(format!("x{a}_{d}"), json!({"inequality": row}));
        }
        for node in (1..=24_usize).filter(|node| *node != d) {
            let sum = |end: usize, sign: &str| -> String {
                let at = links.iter().enumerate().filter(|(_, link)| link[end] == node as f64);
                at.map(|(a, _)| format!(" {sign} x{a}_{d}")).collect()
            };
            let trips = number(&data["trips"][node - 1][d - 1]) / 1000.0;
            let row = format!("0{}{} - {trips}", sum(0, "+"), sum(1, "-"));
            variables.insert(format!("p{node}_{d}"), json!({"inequality": row}));
        }
    }
    let names: Vec<String> = variables.keys().cloned().collect();
    let (solution, found) = solved(&json!({"problem": {"vi": {"definitions": definitions, "variables": variables,
        "set": [{"nonnegative": names}]}},
        "output": {"fields": (0..links.len()).map(|a| format!("v{a}")).collect::<Vec<_>>()}}));
    let (mut total, mut shortest) = (0.0, 0.0);
    for (a, link) in links.iter().enumerate() {
        let flow = 1000.0 * solution.trajectory.field(&format!("v{a}")).unwrap()[0];
        assert!((flow - link[4]).abs() <= 1e-6 * link[4], "link {a}: {flow} for {}", link[4]);
        total += flow * link[3] * (1.0 + 0.15 * (flow / link[2]).powi(4));
    }
    for d in 1..=24_usize {
        for node in (1..=24_usize).filter(|node| *node != d) {
            shortest += number(&data["trips"][node - 1][d - 1]) * found.z[&format!("p{node}_{d}")];
        }
    }
    let gap = (total - shortest) / total;
    assert!(gap.abs() <= 1e-10, "relative gap {gap:e}");
}

#[test]
fn what_vanishes_at_infinity_only_is_no_solution() {
    let free = json!([{"free": ["x1"]}]);
    let nonnegative = json!([{"nonnegative": ["x1"]}]);
    for (row, set) in [
        ("-exp(-x1)", &nonnegative),
        ("exp(-2*x1)", &free),
        ("atan(x1) - pi/2", &free),
        ("tanh(x1) - 1", &free),
        ("sqrt(x1^2 + 1) - x1", &free),
        ("x1/(1 + x1) - 1", &nonnegative),
    ] {
        let (code, message) = failed(&problem(&[("x1", row, 1.0)], set.clone()));
        assert!(code == "vi_unsolved" || code == "no_solution", "{row}: {code}: {message}");
    }
    let (code, _) = failed(&problem(
        &[("x1", "-exp(-x1)*(1 + x2)", 0.0), ("x2", "x2 - 1", 0.0)],
        json!([{"nonnegative": ["x1", "x2"]}]),
    ));
    assert_eq!(code, "vi_unsolved");
    // Multiple roots of the equation, also of functions that are flat around them, are accepted as solutions.
    for (row, start, exact, tolerance) in [
        ("1 - cos(x1)", 0.0, 0.0, 1e-12),
        ("1 - cos(x1)", 1.0, 0.0, 1e-4),
        ("x1^3", 1.0, 0.0, 1e-3),
        ("exp(x1) - 1 - x1", 1.0, 0.0, 1e-4),
        ("max(0, x1 - 1)", 0.5, 0.5, 1e-12),
        ("(x1 - 1e-9)*(x1 + 1)", 0.5, 1e-9, 1e-10),
    ] {
        let (_, found) = solved(&problem(&[("x1", row, start)], free.clone()));
        assert_point(&found, &[exact], tolerance);
    }
}

#[test]
fn a_membrane_of_many_nodes_over_an_obstacle_is_solved_by_active_sets() {
    // A string with -u'' = -8 on [0, 1] above the obstacle -1/2: its free parts are known, u = 4 (x - a)^2 - 1/2 with
    // a = 1/sqrt 8 on the left.
    let n = 1999;
    let h = 1.0 / f64::from(n + 1);
    let specification = json!({"problem": {"vi": {"parameters": {"n": n, "h": h},
        "variables": {"u[1..n]": {"inequality": "(2*u[i] - u[i-1] - u[i+1])/h^2 + 8"}},
        "definitions": {"u[0]": 0, "u[n+1]": 0}, "set": [{"box": {"of": ["u[1..n]"], "lower": -0.5}}]}}});
    let (solution, found) = solved(&specification);
    assert_eq!(solution.diagnostics.method, "active_set");
    let exact = |x: f64| if x < 0.125_f64.sqrt() { 4.0 * (x - 0.125_f64.sqrt()).powi(2) - 0.5 } else { -0.5 };
    for i in 1..=n {
        let x = f64::from(i) * h;
        let value = found.z[&format!("u[{i}]")];
        assert!((value - exact(x.min(1.0 - x))).abs() < 10.0 * h * h, "{value} at {x}");
    }
}

#[test]
fn a_membrane_on_a_grid_is_solved_from_coarse_to_fine() {
    // A membrane under a uniform load over a flat obstacle: the solution has the symmetries of the square.
    let specification = json!({"problem": {"vi": {"parameters": {"n": 40, "h": 0.1},
        "variables": {"z[i in 1..n, j in 1..n]": {"inequality": "4*z[i,j] - z[i-1,j] - z[i+1,j] - z[i,j-1] - z[i,j+1] + h^2"}},
        "definitions": {"z[0, 1..n]": 0, "z[n+1, 1..n]": 0, "z[1..n, 0]": 0, "z[1..n, n+1]": 0},
        "set": [{"box": {"of": ["z[1..n, 1..n]"], "lower": -0.5}}]}}});
    let (solution, found) = solved(&specification);
    assert_eq!(solution.diagnostics.method, "active_set");
    let at = |i: usize, j: usize| found.z[&format!("z[{i},{j}]")];
    let held = (1..=40).flat_map(|i| (1..=40).map(move |j| (i, j))).filter(|&(i, j)| at(i, j) == -0.5).count();
    assert!(held > 100 && held < 1500, "{held} nodes");
    for i in 1..=40 {
        for j in 1..=40 {
            assert!((at(i, j) - at(j, i)).abs() < 1e-9 && (at(i, j) - at(41 - i, j)).abs() < 1e-9);
        }
    }
    assert!(solution.diagnostics.newton_iterations < 10, "{}", solution.diagnostics.newton_iterations);
}

#[test]
fn what_is_a_solution_does_not_depend_on_units() {
    // For G = g (z/u - c) over sets of the size u, the solution is u times c, or u times the point of the set nearest
    // to c; an added cubic part is monotone. The units of z and of G differ by ten decades and more.
    let of = |u: f64, g: f64, [a, b]: [f64; 2], cubic: f64| {
        let row = |name: &str, c: f64| format!("{g:e}*(({name}/{u:e} - {c}) + {cubic}*(({name}/{u:e})^3 - {c}^3))");
        let (first, second) = (row("x1", a), row("x2", b));
        (first, second)
    };
    let sets = |u: f64| {
        [
            json!([{"ball": {"of": ["x1", "x2"], "radius": u}}]),
            json!([{"polyhedron": {"of": ["x1", "x2"], "A": [[1, 1], [-1, 0], [0, -1]], "b": [u, 0, 0]}}]),
            json!([{"box": {"of": ["x1", "x2"], "lower": -u, "upper": u}}]),
        ]
    };
    for (u, g) in
        [(1.0, 1.0), (1e-6, 1e6), (1e-4, 1e8), (1e-8, 1e10), (1e6, 1e-6), (1e5, 1e-3), (1e-6, 1.0), (1e6, 1e6)]
    {
        for cubic in [0.0, 1.0] {
            for set in sets(u) {
                let c = [0.3, 0.1];
                let (first, second) = of(u, g, c, cubic);
                let (solution, found) = solved(&problem(&[("x1", &first, 0.0), ("x2", &second, 0.0)], set.clone()));
                for (k, c) in c.into_iter().enumerate() {
                    let value = found.z[&format!("x{}", k + 1)] / u;
                    assert!((value - c).abs() < 1e-9, "{u:e} {g:e} {cubic} {set}: {value} for {c}");
                }
                assert!(!is_told(&solution, "many_solutions"), "{u:e} {g:e} {set}");
            }
        }
        // The point c is outside the ball and the triangle; the solutions (0.6, 0.8) and (0, 1) are on their
        // boundaries.
        let (first, second) = of(u, g, [3.0, 4.0], 0.0);
        for (set, exact) in sets(u).into_iter().zip([[0.6, 0.8], [0.0, 1.0], [1.0, 1.0]]) {
            let (_, found) = solved(&problem(&[("x1", &first, 0.0), ("x2", &second, 0.0)], set.clone()));
            for (k, exact) in exact.into_iter().enumerate() {
                let value = found.z[&format!("x{}", k + 1)] / u;
                assert!((value - exact).abs() < 1e-9, "{u:e} {g:e} {set}: {value} for {exact}");
            }
        }
    }
    // Two routes whose costs are in nanoseconds: the flow a on the first satisfies a^2 + a = 1.5.
    let routes =
        problem(&[("x1", "1e10*(1 + x1^2)", 0.0), ("x2", "1e10*(1.5 + x2)", 0.0)], json!([{"simplex": ["x1", "x2"]}]));
    let (_, found) = solved(&routes);
    assert_point(&found, &[(7.0_f64.sqrt() - 1.0) / 2.0], 1e-9);
}

#[test]
fn rows_of_any_size_are_solved_alike() {
    // Routes with the costs c (1 + a_i f_i/N) share N vehicles at a common cost, c times the lambda with sum
    // (lambda - 1)/a_i = 1.
    let slopes = [1.0, 2.0, 4.0];
    let lambda = 1.0 + 1.0 / slopes.iter().map(|a| 1.0 / a).sum::<f64>();
    for (vehicles, cost) in [(1.0, 1.0), (1.0, 1e-9), (1e6, 1e-9), (1e9, 1e-3), (1e-6, 1e6), (1e6, 1e6), (1e-3, 1e-9)] {
        for power in ["", "^4"] {
            let root = |x: f64| if power.is_empty() { x } else { x.powf(0.25) };
            // If the costs depend on fourth powers of the flows, lambda satisfies sum ((lambda - 1)/a_i)^(1/4) = 1.
            let of_powers = slopes.iter().map(|a: &f64| a.powf(-0.25)).sum::<f64>().powi(-4);
            let lambda = if power.is_empty() { lambda } else { 1.0 + of_powers };
            let row = |i: usize, a: f64| format!("{cost:e}*(1 + {a}*(f{i}/{vehicles:e}){power}) - p");
            let rows: Vec<String> = slopes.iter().enumerate().map(|(i, a)| row(i, *a)).collect();
            let balance = format!("{vehicles:e} - f0 - f1 - f2");
            let variables =
                [("f0", rows[0].as_str(), 0.0), ("f1", &rows[1], 0.0), ("f2", &rows[2], 0.0), ("p", &balance, 0.0)];
            let set = json!([{"nonnegative": ["f0", "f1", "f2"]}, {"free": ["p"]}]);
            let (solution, found) = solved(&problem(&variables, set));
            let at = format!("{vehicles:e} vehicles, costs of {cost:e}{power}");
            for (i, a) in slopes.iter().enumerate() {
                let (value, exact) = (found.z[&format!("f{i}")] / vehicles, root((lambda - 1.0) / a));
                assert!((value - exact).abs() < 1e-9, "{at}: {value} for {exact}");
            }
            assert!((found.z["p"] / cost / lambda - 1.0).abs() < 1e-9, "{at}: {:e}", found.z["p"]);
            assert!(!is_told(&solution, "many_solutions"), "{at}");
            let is_known =
                ["locally unique", "the only solution"].iter().any(|word| found.certificate.starts_with(word));
            assert!(is_known, "{at}: {}", found.certificate);
        }
    }
}
