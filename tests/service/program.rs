//! The program `dvi`: exit codes, streams, signals.

use crate::harness::DECAY;
use crate::process::{RESPONSE_TIMEOUT, send};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdin, Command, Output, Stdio};
use std::time::{Duration, Instant};

const DVI: &str = env!("CARGO_BIN_EXE_dvi");

fn dvi(arguments: &[&str]) -> Command {
    let mut command = Command::new(DVI);
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Runs the program to its end with `input` on its standard input.
fn run(arguments: &[&str], input: &str) -> Output {
    let mut child = dvi(arguments).spawn().unwrap();
    give(child.stdin.take().unwrap(), input);
    child.wait_with_output().unwrap()
}

fn give(mut stdin: ChildStdin, input: &str) {
    // Writing fails if the program has closed its standard input.
    let _ = stdin.write_all(input.as_bytes());
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args(["-s", name, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

#[test]
fn a_solve_writes_its_result_and_nothing_else() {
    let output = run(&["solve", "-"], DECAY);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(output.stderr.is_empty(), "{output:?}");
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(result["status"], "completed");
}

/// Specification of a harmonic oscillator with implicit steps of half a time unit, which dissipate all but a
/// hundredth of its energy; the exact solution conserves it.
const COARSE: &str = r#"{"problem":{"mechanical":{"coordinates":{"q":{"initial":1}},"mass":[[1]],"potential":"q^2/2"}},
"time":{"end":10},"method":{"step":0.5}}"#;

#[test]
fn an_answer_that_is_not_trusted_is_written_and_has_its_own_exit_code() {
    let output = run(&["solve", "-"], COARSE);
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(
        (result["status"].as_str(), &result["verdict"]["trusted"]),
        (Some("completed"), &false.into()),
        "{told}"
    );
    assert_eq!(result["verdict"]["because"][0]["code"], "energy_balance");
    let measured = &result["diagnostics"]["checks"]["energy_balance"];
    assert!(measured["value"].as_f64().unwrap() > measured["allowed"].as_f64().unwrap(), "{measured}");
    assert!(told.starts_with("dvi: not trusted: energy balance ") && told.contains(", allowed "), "{told}");
    assert_eq!(output.status.code(), Some(7));
    let table = run(&["solve", "--format", "csv", "-"], COARSE);
    assert_eq!((table.status.code(), String::from_utf8(table.stderr).unwrap()), (Some(7), told));
    assert!(String::from_utf8(table.stdout).unwrap().starts_with("t,q,q_dot,"));
}

#[test]
fn the_end_that_was_not_reached_goes_before_the_answer_that_is_not_trusted() {
    let output = run(&["solve", "-"], &COARSE.replace("\"step\":0.5", "\"step\":0.5}, \"limits\": {\"steps\":3"));
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&result["status"], &result["verdict"]["trusted"]), (&"stopped".into(), &false.into()));
}

#[test]
fn what_a_method_does_not_have_is_not_among_its_figures() {
    let output = run(&["solve", "-"], COARSE);
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let diagnostics = result["diagnostics"].as_object().unwrap();
    for absent in ["stages", "newton_iterations", "newton_contraction"] {
        assert!(!diagnostics.contains_key(absent), "time stepping has no {absent}");
    }
    assert_eq!(diagnostics["evaluations"]["rates"], 20);
    let output = run(&["solve", "-"], DECAY);
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(result["diagnostics"]["stages"].as_u64().unwrap() >= 3, "{result}");
}

#[test]
fn a_solve_writes_a_table_on_request() {
    let output = run(&["solve", "--format", "csv", "-"], DECAY);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.lines().next(), Some("t,x"));
}

#[test]
fn a_solve_draws_a_picture_on_request() {
    let output = run(&["solve", "--format", "svg", "-"], DECAY);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        roxmltree::Document::parse(&text).is_ok_and(|picture| picture.root_element().has_tag_name("svg")),
        "{text}"
    );
}

#[test]
fn the_picture_of_the_documents_is_what_the_program_draws() {
    let example = concat!(env!("CARGO_MANIFEST_DIR"), "/api/examples/friction_belt.json");
    let drawn = dvi(&["solve", "--format", "svg", example]).output().unwrap();
    let shown = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/api/pictures/friction_belt.svg"));
    assert!(
        drawn.stdout == shown.as_bytes(),
        "draw it anew: dvi solve --format svg api/examples/friction_belt.json > api/pictures/friction_belt.svg"
    );
}

#[test]
fn errors_of_a_specification_are_told_with_their_places() {
    let wrong = r#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-y"}}}},"time":{"end":1}}"#;
    for command in ["solve", "check"] {
        let output = run(&[command, "-"], wrong);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        assert!(output.stdout.is_empty());
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(told.starts_with("-: 1 error\n") && told.contains("/problem/dvi/states/x/rate: "), "{told}");
    }
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let output = run(&["check", "no/such/file.json"], "");
    assert_eq!(output.status.code(), Some(3));
    assert!(String::from_utf8(output.stderr).unwrap().contains("no/such/file.json"));
}

#[test]
fn a_correct_specification_is_said_to_be() {
    let output = run(&["check", "-"], DECAY);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(told.starts_with("-: correct\n") && told.contains("  states          1\n"), "{told}");
    let kink = DECAY.replace("-x", "-abs(x)");
    let told = String::from_utf8(run(&["check", "-"], &kink).stdout).unwrap();
    assert!(told.contains("\n  warning: ") && told.contains("abs"), "{told}");
}

#[test]
fn the_methods_are_told_with_a_row_for_every_number_of_stages() {
    let output = run(&["methods"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let told = String::from_utf8(output.stdout).unwrap();
    let (_, table) = told.split_once("|R(infinity)|\n").unwrap();
    for (s, row) in (1..=9).zip(table.lines()) {
        let words: Vec<&str> = row.split_whitespace().take(4).collect();
        let step = if s % 2 == 1 { "any" } else { "fixed" };
        assert_eq!(words, [&s.to_string(), step, &(2 * s - 1).to_string(), &s.to_string()]);
    }
    assert!(told.contains("  second_order_cone   "), "{told}");
    let json = run(&["methods", "--format", "json"], "").stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    assert!((json["tableaux"][1]["A"][1][0].as_f64().unwrap() - 0.75).abs() < 1e-15);
}

#[test]
fn a_command_line_without_sense_has_its_own_exit_code() {
    assert_eq!(run(&["sovle"], "").status.code(), Some(64));
    assert_eq!(run(&["serve", "--workers", "0"], "").status.code(), Some(64));
    assert_eq!(run(&["--help"], "").status.code(), Some(0));
}

#[test]
fn a_flag_without_sense_is_told_with_what_to_write_instead() {
    for (arguments, tip) in [
        (["--workers", "0"], "the least value is 1"),
        (["--listen", "9000"], "as in '--listen 127.0.0.1:9000'"),
        (["--listen", ":9000"], "as in '--listen 127.0.0.1:9000'"),
        (["--port", "9000"], "'--listen 127.0.0.1:9000'"),
    ] {
        let output = run(&["serve", arguments[0], arguments[1]], "");
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(64), "{told}");
        assert!(told.contains(tip), "{told}");
        assert!(!told.contains("environment"), "{told}");
    }
    for (variable, value) in [("DVI_ASK_TOKENS", "perhaps"), ("DVI_QUEUE", "0"), ("DVI_WORKERS", "two")] {
        let told = String::from_utf8(dvi(&["serve"]).env(variable, value).output().unwrap().stderr).unwrap();
        assert!(told.contains(&format!("environment variable {variable}")), "{told}");
    }
    // The value 1 of an environment variable switches a command-line flag on.
    let asks = dvi(&["serve", "--ephemeral", "--listen", "no address"]).env("DVI_ASK_TOKENS", "1").output().unwrap();
    let told = String::from_utf8(asks.stderr).unwrap();
    assert!(told.contains("--listen") && !told.contains("ask-tokens"), "{told}");
}

#[test]
fn tokens_that_are_not_there_are_told() {
    let folder = crate::process::Folder::new();
    let path = folder.path().to_str().unwrap();
    let output = run(&["token", "list", "--data", path], "");
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    assert!(String::from_utf8(output.stderr).unwrap().contains(path));
    std::fs::create_dir(folder.path()).unwrap();
    let output = run(&["token", "list", "--data", path], "");
    assert_eq!((output.status.code(), output.stdout.len()), (Some(0), 0));
    assert!(String::from_utf8(output.stderr).unwrap().contains("dvi token create"));
}

#[test]
fn help_shows_every_bound_with_its_default_and_its_variable() {
    let help = String::from_utf8(run(&["serve", "--help"], "").stdout).unwrap();
    for (flag, variable, default) in [
        ("--listen", "DVI_LISTEN", "127.0.0.1:8080"),
        ("--workers", "DVI_WORKERS", ""),
        ("--queue", "DVI_QUEUE", "1000"),
        ("--client-share", "DVI_CLIENT_SHARE", "750"),
        ("--wall-seconds", "DVI_WALL_SECONDS", "300"),
        ("--steps", "DVI_STEPS", "10000000"),
        ("--body-mib", "DVI_BODY_MIB", "8"),
        ("--result-mib", "DVI_RESULT_MIB", "256"),
        ("--kept-jobs", "DVI_KEPT_JOBS", "10000"),
        ("--kept-mib", "DVI_KEPT_MIB", "1024"),
        ("--kept-days", "DVI_KEPT_DAYS", "30"),
        ("--read-seconds", "DVI_READ_SECONDS", "30"),
        ("--connections", "DVI_CONNECTIONS", "16384"),
        ("--streams", "DVI_STREAMS", "1000"),
        ("--grace-seconds", "DVI_GRACE_SECONDS", "30"),
        ("--log-format", "DVI_LOG_FORMAT", "text"),
    ] {
        let (_, after) = help.split_once(flag).unwrap_or_else(|| panic!("no {flag} in {help}"));
        let entry = after.split("\n      --").next().unwrap();
        assert!(entry.contains(variable) && entry.contains(&format!("[default: {default}")), "{flag}: {entry}");
    }
}

#[test]
fn a_reader_that_has_seen_enough_is_no_failure() {
    let mut child = dvi(&["solve", "-"]).spawn().unwrap();
    drop(child.stdout.take());
    give(child.stdin.take().unwrap(), DECAY);
    let mut told = String::new();
    child.stderr.take().unwrap().read_to_string(&mut told).unwrap();
    assert_eq!((child.wait().unwrap().code(), told.as_str()), (Some(0), ""));
}

#[test]
fn a_service_says_where_it_listens_and_a_signal_ends_it_in_order() {
    for name in ["TERM", "INT"] {
        let mut child =
            dvi(&["serve", "--ephemeral", "--listen", "127.0.0.1:0", "--log-format", "json"]).spawn().unwrap();
        let mut log = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        log.read_line(&mut line).unwrap();
        let entry: serde_json::Value = serde_json::from_str(&line).unwrap();
        let mut stream = TcpStream::connect(entry["fields"]["address"].as_str().unwrap()).unwrap();
        write!(
            stream,
            "POST /solve HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/x-www-form-urlencoded\r\n\
             content-length: {}\r\nconnection: close\r\n\r\n{DECAY}",
            DECAY.len()
        )
        .unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("\"status\":\"completed\""), "{answer}");
        signal(&child, name);
        assert_eq!(child.wait().unwrap().code(), Some(0), "after SIG{name}");
        let mut rest = String::new();
        log.read_to_string(&mut rest).unwrap();
        for line in rest.lines() {
            assert!(serde_json::from_str::<serde_json::Value>(line).is_ok(), "{line}");
        }
    }
}

#[test]
fn a_log_that_nobody_reads_holds_up_no_request() {
    let mut child = dvi(&["serve", "--ephemeral", "--listen", "127.0.0.1:0", "--log-format", "json"])
        .env("RUST_LOG", "info,hyper=trace,tokio=trace")
        .spawn()
        .unwrap();
    let mut log = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    let address = loop {
        line.clear();
        log.read_line(&mut line).unwrap();
        let entry: serde_json::Value = serde_json::from_str(&line).unwrap();
        if let Some(address) = entry["fields"]["address"].as_str() {
            break address.to_owned();
        }
    };
    // Request ids of the greatest permitted length make long log lines, so that the pipe of the log and the buffer
    // behind it hold only some thousand of them.
    let id = "x".repeat(128);
    let get = |path: &str| send(&address, "GET", path, &format!("x-request-id: {id}\r\n"), "").expect("an answer");
    let lost = || {
        let text = get("/metrics").body;
        let line = text.lines().find_map(|line| line.strip_prefix("dvi_log_lines_lost_total "));
        line.unwrap().parse::<u64>().unwrap()
    };
    let start = Instant::now();
    while lost() == 0 {
        assert!(start.elapsed() < RESPONSE_TIMEOUT, "the log is read by somebody");
        (0..200).for_each(|_| assert_eq!(get("/methods").status, 200));
    }
    let before = lost();
    let start = Instant::now();
    (0..100).for_each(|_| assert_eq!(get("/methods").status, 200));
    println!("{before} lines were lost; 100 more requests took {:?}", start.elapsed());
    signal(&child, "TERM");
    let start = Instant::now();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    // The remaining content of the pipe of the log begins with whole lines.
    let mut rest = Vec::new();
    log.read_to_end(&mut rest).unwrap();
    let rest = String::from_utf8_lossy(&rest);
    assert!(rest.lines().count() > 10);
    for line in rest.lines().take(10) {
        assert!(serde_json::from_str::<serde_json::Value>(line).is_ok(), "{line}");
    }
}

#[test]
fn an_address_that_is_taken_is_named() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let output = run(&["serve", "--ephemeral", "--listen", &address], "");
    assert_eq!(output.status.code(), Some(5));
    assert!(String::from_utf8(output.stderr).unwrap().contains(&address));
}

/// Specification of a harmonic oscillator over more than ten million periods, whose trajectory takes some hundred
/// MiB.
const LONG: &str = r#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"v"},"v":{"initial":0,"rate":"-x"}}}},
"time":{"end":100000000},"label":"long"}"#;

#[test]
fn a_solve_within_its_memory_is_the_same_in_every_form() {
    let labelled = DECAY.replacen('{', "{\"label\":\"a decay\",", 1);
    for format in ["json", "csv", "ndjson", "arrow", "svg"] {
        let plain = run(&["solve", "--format", format, "-"], &labelled);
        let confined = run(&["solve", "--format", format, "--memory-mib", "64", "-"], &labelled);
        assert_eq!((confined.status.code(), confined.stderr.len()), (Some(0), 0), "{confined:?}");
        if format == "json" {
            let [plain, confined] = [plain, confined].map(|output| {
                let mut result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
                // The diagnostics contain run times, which differ between solves.
                result.as_object_mut().unwrap().remove("diagnostics");
                result
            });
            assert_eq!(plain, confined);
        } else {
            assert!(plain.stdout == confined.stdout, "{format}");
        }
    }
    let output = run(&["solve", "--memory-mib", "64", "-"], COARSE);
    assert_eq!((output.status.code(), output.stderr), (Some(7), run(&["solve", "-"], COARSE).stderr));
    let output = run(&["solve", "--memory-mib", "64", "-"], &DECAY.replace("\"-x\"", "\"-y\""));
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8(output.stderr).unwrap().starts_with("-: 1 error\n"));
}

#[test]
fn a_solve_that_takes_too_much_memory_says_so() {
    let output = run(&["solve", "--memory-mib", "1", "-"], LONG);
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), output.stdout.len()), (Some(8), 0), "{told}");
    assert!(told.starts_with("dvi: too_much_memory: the solve took more than the 1 MiB of --memory-mib, "), "{told}");
    assert_eq!(told.lines().count(), 1, "{told}");
}

/// A sweep of exponential decays over several rates and initial values.
const SWEEP: &str = r#"{"label": "decays", "problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}},
"time": {"end": 1}, "sweep": {"over": {"k": {"linspace": [0, 2, 5]}, "x.initial": [1, 2, 3]}}}"#;

#[test]
fn a_sweep_in_parts_is_the_sweep_and_mixtures_are_refused() {
    let folder = std::env::temp_dir().join(format!("dvi-sweep-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (specification, whole, merged) = (path("sweep.json"), path("whole.json"), path("merged.json"));
    std::fs::write(&specification, SWEEP).unwrap();
    let succeeds = |arguments: &[&str]| {
        let output = run(arguments, "");
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {output:?}");
        assert!(output.stderr.is_empty(), "{output:?}");
        output
    };
    succeeds(&["sweep", &specification, "-o", &whole, "--threads", "1"]);
    let parts: Vec<String> = (1..=4).map(|k| path(&format!("part{k}.json"))).collect();
    for (k, part) in parts.iter().enumerate() {
        succeeds(&["sweep", &specification, "--shard", &format!("{}/4", k + 1), "-o", part]);
    }
    succeeds(&["merge", &parts[2], &parts[0], &parts[3], &parts[1], "-o", &merged]);
    assert_eq!(std::fs::read(&merged).unwrap(), std::fs::read(&whole).unwrap());
    let missing = run(&["merge", &parts[0], &parts[1], "--format", "csv"], "");
    assert_eq!(missing.status.code(), Some(1), "{missing:?}");
    assert!(String::from_utf8(missing.stderr).unwrap().starts_with("dvi: members_missing: "));
    let twice = run(&["merge", &parts[0], &parts[0]], "");
    assert_eq!(twice.status.code(), Some(2), "{twice:?}");
    let other = path("other.json");
    succeeds(&["sweep", &specification, "--set", "/time/end=2", "--shard", "2/4", "-o", &other]);
    let mixed = run(&["merge", &parts[0], &other], "");
    assert_eq!(mixed.status.code(), Some(2), "{mixed:?}");
    assert!(String::from_utf8(mixed.stderr).unwrap().contains("specification"));
    let csv = succeeds(&["sweep", &specification, "--format", "csv"]);
    assert_eq!(String::from_utf8(csv.stdout).unwrap().lines().count(), 16);
    for (name, begin) in [("t.csv", "member,k"), ("t.ndjson", "{\"member\":0"), ("t.svg", "<svg")] {
        succeeds(&["sweep", &specification, "-o", &path(name)]);
        assert!(std::fs::read_to_string(path(name)).unwrap().starts_with(begin), "{name}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn numbers_are_set_on_the_command_line_and_results_go_to_files() {
    let output = run(&["solve", "-", "--set", "x.initial=3", "--set", "/time/end=2", "--format", "csv"], SWEEP_LESS);
    let table = String::from_utf8(output.stdout).unwrap();
    assert!(table.starts_with("t,x\n0.0,3.0\n") && table.lines().last().unwrap().starts_with("2.0,"), "{table}");
    let unknown = run(&["solve", "-", "--set", "kk=3"], SWEEP_LESS);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8(unknown.stderr).unwrap().contains("did you mean k?"));
    assert_eq!(run(&["solve", "-", "--set", "k"], SWEEP_LESS).status.code(), Some(64));
    let file = std::env::temp_dir().join(format!("dvi-result-{}.csv", std::process::id()));
    let output = run(&["solve", "-", "-o", file.to_str().unwrap()], SWEEP_LESS);
    assert!(output.status.success() && output.stdout.is_empty(), "{output:?}");
    assert!(std::fs::read_to_string(&file).unwrap().starts_with("t,x\n"));
    std::fs::remove_file(&file).unwrap();
    assert_eq!(run(&["solve", "-", "-o", "result.docx"], SWEEP_LESS).status.code(), Some(64));
}

const SWEEP_LESS: &str = r#"{"problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}}, "time": {"end": 1}}"#;
/// A temporary folder, removed when it is dropped.
struct Folder(std::path::PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("dvi-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn with(&self, name: &str, text: &str) -> String {
        let path = self.0.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.0.join(name)).unwrap_or_default()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn several_files_are_solved_each_beside_itself() {
    let folder = Folder::new("several");
    let (decay, coarse) = (folder.with("decay.json", DECAY), folder.with("coarse.json", COARSE));
    let alone = run(&["solve", "--format", "csv", &decay], "").stdout;
    let output = run(&["solve", "--format", "csv", &decay, &coarse], "");
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.stdout.is_empty());
    // The exit code of a solve of several files is that of the first file whose exit code is not 0.
    assert_eq!(output.status.code(), Some(7), "{told}");
    assert!(told.contains("decay.json: completed, ") && told.contains("  dvi: not trusted: energy balance"), "{told}");
    assert_eq!(folder.read("decay.result.csv").into_bytes(), alone);
    assert!(folder.read("coarse.result.csv").starts_with("t,q,q_dot,"));

    let bad = folder.with("bad.json", "{");
    let output = run(&["solve", &bad, &decay, &coarse], "");
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert!(folder.read("decay.result.json").contains("\"completed\"") && folder.read("bad.result.json").is_empty());

    for arguments in [
        vec!["solve", "-", &decay],
        vec!["solve", &decay, &decay],
        vec!["solve", "--memory-mib", "99", &decay, &coarse],
    ] {
        assert_eq!(run(&arguments, "").status.code(), Some(64), "{arguments:?}");
    }
}

#[test]
fn a_deck_is_solved_as_a_file() {
    let folder = Folder::new("deck");
    let deck =
        folder.with("rc.cir", "An RC circuit\nV1 in 0 5\nR1 in out 1k\nC1 out 0 1u IC=0\n.tran 1u 5m uic\n.end\n");
    let output = run(&["solve", &deck], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let end = result["trajectory"]["fields"]["v(out)"].as_array().unwrap().last().unwrap().as_f64().unwrap();
    assert!((end - 5.0 * (1.0 - (-5.0_f64).exp())).abs() < 1e-5);
    assert_eq!(
        (&result["provenance"]["label"], &result["provenance"]["problem"]),
        (&"An RC circuit".into(), &"circuit".into())
    );
    let wrong = folder.with("wrong.cir", "Wrong\nR1 a 0 {x}\n.tran 1 1\n");
    let output = run(&["check", &wrong], "");
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && told.contains("line 2, column 8: `{x}`"), "{told}");
}

/// Tests that the digest of a specification agrees with that of `sha256sum`.
#[test]
fn an_answer_says_what_it_is_the_answer_to() {
    let output = run(
        &["solve", "-"],
        "{\"label\":\"x\",\"problem\":{\"dvi\":{\"states\":{\"x\":{\"initial\":1,\"rate\":\"-x\"}}}},\"time\":{\"end\":1}}",
    );
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let digest = "030ebdb953b383602abf91cfd4ea0f8fe564d1bbae3f9ce274b9841763a4c880";
    let told = serde_json::json!({
        "program": concat!("dvi ", env!("CARGO_PKG_VERSION")), "label": "x", "problem": "dvi", "digest": digest,
        "rtol": 1e-6, "atol": 1e-9
    });
    assert_eq!(result["provenance"], told);
}

#[test]
fn shells_and_man_know_every_subcommand() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = run(&["completions", shell], "");
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && text.contains("healthcheck") && text.contains("memory-mib"), "{shell}");
    }
    let page = String::from_utf8(run(&["man"], "").stdout).unwrap();
    assert!(page.contains(".TH dvi 1") && page.contains("dvi\\-solve"), "{page}");
    let page = String::from_utf8(run(&["man", "solve"], "").stdout).unwrap();
    assert!(page.contains(".TH dvi-solve 1") && page.contains("\\-\\-format"), "{page}");
    assert_eq!(run(&["man", "nothing"], "").status.code(), Some(64));
    let folder = Folder::new("man");
    assert!(run(&["man", "--folder", folder.0.to_str().unwrap()], "").status.success());
    assert!(folder.read("dvi-token-create.1").contains(".TH dvi-token-create 1"));
}
