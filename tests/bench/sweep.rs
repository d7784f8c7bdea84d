//! A sweep of ten thousand friction belts at `rtol` 1e-8, compared with the bare steps of Radau IIA, a loop over the
//! command line and a loop of single requests to a service. `cargo bench --bench sweep [MEMBERS]`.
//!
//! The output has the seconds for all members, also as a ratio to the bare steps on one thread. The slow loops run a
//! part of the members, and their times are scaled to all. The output also has the memory of a sweep with a million
//! rows, minus that of a sweep with one, on the command line and in a service.

use dvi::problem::Control;
use dvi::radau::Radau;
use dvi::solution::Solution;
use dvi::specification::Specification;
use hybrid::OneStep;
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::num::NonZeroUsize;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

const DVI: &str = env!("CARGO_BIN_EXE_dvi");
/// Number of sweep members in those comparisons that start a process or send a request for each member.
const LOOPED: usize = 200;
/// Number of repetitions of fast measurements. The least time is printed, since other programs also use the machine.
const TURNS: usize = 5;
/// Interval between two readings of the peak memory of a process, which the system records.
const LOOK: Duration = Duration::from_millis(20);

fn main() {
    let members = std::env::args().skip(1).find_map(|argument| argument.parse().ok()).unwrap_or(10_000);
    let specification = read(&belts(members));
    let plan = specification.sweep().expect("a sweep");
    let members = plan.members();
    let cores = thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    let one = || dvi::solve_on(NonZeroUsize::MIN, &specification, &Control::new());
    let all = || dvi::solve_on(cores, &specification, &Control::new());
    let solution = one();
    let steps = solution.diagnostics.steps.accepted;
    println!("{members} belts, {steps} steps, {} switches, {cores} cores", solution.diagnostics.switches);
    drop(solution);
    let bound: Vec<Specification> = (0..members)
        .map(|k| {
            let mut values = vec![0.0; plan.targets.len()];
            plan.design.write(k, &mut values);
            specification.member(&values).expect("a member")
        })
        .collect();
    let (mut bare, mut alone, mut shared, mut binding, mut solving) = (vec![], vec![], vec![], vec![], vec![]);
    for _ in 0..TURNS {
        bare.push(seconds(|| bound.iter().for_each(steps_of)));
        alone.push(seconds(one));
        shared.push(seconds(all));
        binding.push(seconds(|| {
            let mut values = vec![0.0; plan.targets.len()];
            for k in 0..members {
                plan.design.write(k, &mut values);
                drop(specification.member(&values).expect("a member"));
            }
        }));
        solving.push(seconds(|| bound.iter().for_each(|member| drop(run_of(member)))));
    }
    drop(bound);
    let bare = least(&bare);
    let tell = |name: &str, seconds: f64| println!("{name:<44} {seconds:>9.3} s {:>8.2}", seconds / bare);
    println!("{:<44} {:>11} {:>8}", "all members", "time", "/bare");
    tell("bare steps, one thread", bare);
    tell("runs with their evidence, one thread", least(&solving));
    tell("binding of parameters alone, one thread", least(&binding));
    tell("sweep, one thread", least(&alone));
    tell("sweep, all cores", least(&shared));
    let folder = std::env::temp_dir().join(format!("dvi-bench-sweep-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder");
    let (document, table) = (folder.join("belts.json"), folder.join("belts.csv"));
    fs::write(&document, belts(members).to_string()).expect("a file");
    let program = seconds(|| {
        let status = Command::new(DVI).arg("sweep").arg(&document).arg("-o").arg(&table).status();
        assert!(status.expect("the program").success());
    });
    tell("dvi sweep, table written", program);
    let single = folder.join("belt.json");
    let mut belt = belts(members);
    belt.as_object_mut().expect("an object").remove("sweep");
    belt["output"] = json!({"times": [20]});
    fs::write(&single, belt.to_string()).expect("a file");
    let looped = seconds(|| {
        for k in 0..LOOPED {
            let set = format!("v_belt={}", 0.1 + 0.004 * k as f64);
            let status = Command::new(DVI).args(["solve", "--set", &set]).arg(&single).stdout(Stdio::null()).status();
            assert!(status.expect("the program").success());
        }
    });
    tell("a loop over dvi solve --set", looped * members as f64 / LOOPED as f64);
    let posted = posts(&belt, &folder);
    tell("a loop of POST /solve, one connection", posted * members as f64 / LOOPED as f64);
    println!("{:<44} {:>11}", "a million rows above one", "MiB");
    let rows = folder.join("rows.csv");
    let swept = |members: usize| {
        fs::write(&document, decays(members).to_string()).expect("a file");
        peak_of(Command::new(DVI).arg("sweep").arg(&document).arg("-o").arg(&rows))
    };
    println!("{:<44} {:>11.1}", "dvi sweep, table written", (swept(1_000_000) - swept(1)) / 1024.0);
    let served = |members: usize| of_service(&decays(members), &folder.join(format!("data-{members}")));
    let (one, million) = (served(1), served(1_000_000));
    println!("{:<44} {:>11.1}", "service, the table made and sent as CSV", (million.0 - one.0) / 1024.0);
    println!("{:<44} {:>11.1}", "largest of its workers", (million.1 - one.1) / 1024.0);
    let _ = fs::remove_dir_all(&folder);
}

/// A sweep of a decay over its rate and its initial value, which collects two numbers of each member.
fn decays(members: usize) -> Value {
    json!({
        "problem": {"dvi": {"parameters": {"k": 1}, "states": {"x": {"initial": 1, "rate": "-k*x"}}}},
        "time": {"end": 1},
        "sweep": {"over": {"k": {"uniform": [0, 2]}, "x.initial": {"normal": [1, 0.1]}}, "design": "random", "count": members,
            "collect": {"x": {"final": "x"}, "mean": {"mean": "x"}}}})
}

/// Returns the peak resident memory of a process so far, in KiB; `None` once it has ended.
fn peak(process: u32) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.split_whitespace().next()?.parse().ok()
}

/// Runs a command, and returns its peak resident memory in KiB.
fn peak_of(command: &mut Command) -> f64 {
    let mut child = command.spawn().expect("the program");
    let mut most = 0.0_f64;
    while child.try_wait().expect("a child").is_none() {
        most = most.max(peak(child.id()).unwrap_or(0.0));
        thread::sleep(LOOK);
    }
    most
}

/// Returns the peak resident memory of a service that solves a sweep and sends its table, and that of the largest of
/// its workers, in KiB.
fn of_service(sweep: &Value, data: &std::path::Path) -> (f64, f64) {
    let (mut server, address) = serve(data);
    let ask = |request: String| -> String {
        let mut connection = TcpStream::connect(&address).expect("a connection");
        connection.write_all(request.as_bytes()).expect("a request");
        let mut answer = String::new();
        connection.read_to_string(&mut answer).expect("an answer");
        answer
    };
    let body = sweep.to_string();
    let accepted = ask(format!(
        "POST /solve HTTP/1.0\r\nhost: localhost\r\nprefer: respond-async\r\ncontent-length: {}\r\n\r\n{body}",
        body.len()
    ));
    let path = accepted.lines().find_map(|line| line.strip_prefix("location: ")).expect("a job").to_owned();
    let mut workers = 0.0_f64;
    while ask(format!("GET {path} HTTP/1.0\r\nhost: localhost\r\n\r\n")).find("\"finished\"").is_none() {
        let children = fs::read_to_string(format!("/proc/{0}/task/{0}/children", server.id())).unwrap_or_default();
        let largest = children.split_whitespace().filter_map(|id| peak(id.parse().ok()?)).fold(0.0, f64::max);
        workers = workers.max(largest);
        thread::sleep(LOOK);
    }
    let table = ask(format!("GET {path}/results HTTP/1.0\r\nhost: localhost\r\naccept: text/csv\r\n\r\n"));
    assert!(table.lines().count() > sweep["sweep"]["count"].as_u64().expect("a count") as usize, "{}", &table[..200]);
    let front = peak(server.id()).unwrap_or(0.0);
    let _ = server.kill();
    let _ = server.wait();
    (front, workers)
}

/// A sweep of the friction belt over its speed and its friction.
fn belts(members: usize) -> Value {
    let speeds = members.div_ceil(25).max(1);
    json!({
        "problem": {"dvi": {"parameters": {"m": 1, "c": 0.1, "k": 1, "f": 1, "v_belt": 0.5},
            "states": {"x": {"initial": 4, "rate": "v"}, "v": {"initial": 0, "rate": "(-c*v - k*x - F)/m"}},
            "variables": {"F": {"inequality": "-(v - v_belt)"}}, "set": [{"box": {"of": ["F"], "lower": "-f", "upper": "f"}}]}},
        "time": {"end": 20}, "method": {"rtol": 1e-8},
        "sweep": {"over": {"v_belt": {"linspace": [0.1, 1, speeds]}, "f": {"linspace": [0.2, 1.2, 25]}},
            "collect": {"x": {"final": "x"}, "v": {"final": "v"}}}})
}

fn read(document: &Value) -> Specification {
    Specification::from_json(document.to_string().as_bytes()).unwrap_or_else(|errors| panic!("{errors:#?}"))
}

/// Performs the steps of Radau IIA for a member of the sweep, and nothing else.
fn steps_of(member: &Specification) {
    let (model, time, control) = (member.model().dvi().expect("a problem"), member.time(), Control::new());
    let mut problem = model.problem();
    let mut radau =
        Radau::new(&mut *problem, member.settings(), time.start, &model.initial, time.end, &control).expect("a start");
    while !radau.is_done() {
        radau.step().expect("a step");
    }
}

/// Solves a member of the sweep with all checks and measurements of a normal solve.
fn run_of(member: &Specification) -> Solution {
    let mut plan = member.plan();
    (plan.times, plan.fields) = (Some(vec![plan.end]), Vec::new());
    member.model().run(member, &plan, &Control::new())
}

fn seconds<T>(run: impl FnOnce() -> T) -> f64 {
    let clock = Instant::now();
    drop(std::hint::black_box(run()));
    clock.elapsed().as_secs_f64()
}

fn least(times: &[f64]) -> f64 {
    times.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Starts a service on a data folder, and returns it with its address.
fn serve(data: &std::path::Path) -> (Child, String) {
    let mut server = Command::new(DVI)
        .args(["serve", "--listen", "127.0.0.1:0", "--log-format", "json", "--data"])
        .arg(data)
        // The log lines of requests are switched off: they would fill the pipe of the process, which is not read.
        .env("RUST_LOG", "info,dvi::request=off,dvi::job=off")
        .stderr(Stdio::piped())
        .spawn()
        .expect("a service");
    let mut log = BufReader::new(server.stderr.take().expect("its log"));
    let address = loop {
        let mut line = String::new();
        assert!(log.read_line(&mut line).expect("a line") > 0, "the service ended");
        let entry: Value = serde_json::from_str(&line).unwrap_or_default();
        if let Some(address) = entry["fields"]["address"].as_str() {
            break address.to_owned();
        }
    };
    // The rest of the log is read and discarded, so that the pipe of the process does not fill.
    thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
    (server, address)
}

/// Returns the seconds that requests take, sent one after the other on one connection.
fn posts(belt: &Value, folder: &std::path::Path) -> f64 {
    let (mut server, address) = serve(&folder.join("data"));
    let mut connection = TcpStream::connect(&address).expect("a connection");
    connection.set_nodelay(true).expect("no delay");
    let mut reader = BufReader::new(connection.try_clone().expect("a connection"));
    let mut belt = belt.clone();
    let time = seconds(|| {
        for k in 0..LOOPED {
            belt["problem"]["dvi"]["parameters"]["v_belt"] = json!(0.1 + 0.004 * k as f64);
            let body = belt.to_string();
            let head = format!(
                "POST /solve HTTP/1.1\r\nhost: {address}\r\ncontent-type: application/json\r\naccept: text/csv\r\ncontent-length: {}\r\n\r\n",
                body.len()
            );
            connection.write_all((head + &body).as_bytes()).expect("a request");
            read_answer(&mut reader);
        }
    });
    let _ = server.kill();
    let _ = server.wait();
    time
}

fn read_answer(reader: &mut BufReader<TcpStream>) {
    let (mut length, mut is_chunked) = (0, false);
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).expect("a line");
        let line = line.trim().to_ascii_lowercase();
        if line.is_empty() {
            break;
        }
        if let Some(value) = line.strip_prefix("content-length:") {
            length = value.trim().parse().expect("a length");
        }
        is_chunked |= line == "transfer-encoding: chunked";
    }
    loop {
        if is_chunked {
            let mut line = String::new();
            reader.read_line(&mut line).expect("a chunk");
            length = usize::from_str_radix(line.trim(), 16).expect("a length") + 2;
        }
        let mut body = vec![0; length];
        reader.read_exact(&mut body).expect("a body");
        if !is_chunked || length == 2 {
            return;
        }
    }
}
