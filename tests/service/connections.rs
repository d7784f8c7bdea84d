//! Behaviour that needs sockets: clients that disconnect, slow clients, and the stop of the service.

use crate::harness::{DECAY, Gate, halving, instant, one_worker, threads};
use dvi::service::jobs::Solver;
use dvi::service::{Options, Service};
use dvi::solution::Status;
use std::net::SocketAddr;
use std::num::{NonZeroU64, NonZeroUsize};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc::{Sender, channel};
use tokio::task::JoinHandle;

/// A service on a port of its own, which a test can stop.
pub struct Running {
    pub address: SocketAddr,
    service: Arc<Service>,
    stop: Sender<()>,
    served: JoinHandle<()>,
}

impl Running {
    pub async fn start(options: Options, solver: Solver) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let service = Arc::new(Service::start(options, Arc::clone(&solver), &threads(solver)).unwrap());
        let (stop, stopped) = channel(2);
        let serving = Arc::clone(&service);
        let served = tokio::spawn(async move { serving.serve(listener, stopped).await });
        Self { address, service, stop, served }
    }

    async fn send(&self, request: &str) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).await.unwrap();
        stream.write_all(request.as_bytes()).await.unwrap();
        stream
    }

    /// Sends a request, and returns the whole response.
    async fn answer(&self, request: &str) -> String {
        read(&mut self.send(request).await).await
    }
}

async fn read(stream: &mut TcpStream) -> String {
    let mut text = String::new();
    stream.read_to_string(&mut text).await.unwrap();
    text
}

fn get(path: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n")
}

fn post(extra: &str) -> String {
    let length = DECAY.len();
    format!(
        "POST /solve HTTP/1.1\r\nhost: localhost\r\n{extra}content-length: {length}\r\nconnection: close\r\n\r\n{DECAY}"
    )
}

#[tokio::test]
async fn a_client_that_goes_away_stops_its_solve() {
    let gate = Gate::new();
    let running = Running::start(one_worker(), gate.solver()).await;
    let stream = running.send(&post("")).await;
    gate.entered(1).await;
    drop(stream);
    gate.cancelled(1).await;
    running.service.jobs().idle().await;
}

#[tokio::test]
async fn a_client_that_goes_away_with_a_monitor_leaves_its_job_running() {
    let gate = Gate::new();
    let running = Running::start(one_worker(), gate.solver()).await;
    let answer = running.answer(&post("prefer: respond-async\r\n")).await;
    let path = answer.lines().find_map(|line| line.strip_prefix("location: ")).expect(&answer).to_owned();
    gate.entered(1).await;
    gate.let_through(1);
    running.service.jobs().idle().await;
    let status = running.answer(&get(&path)).await;
    assert!(status.contains("\"status\":\"successful\""), "{status}");
}

#[tokio::test]
async fn headers_that_do_not_come_cut_the_client_off() {
    let options = Options { read_seconds: NonZeroU64::MIN, ..one_worker() };
    let running = Running::start(options, instant()).await;
    let begun = Instant::now();
    let mut slow = running.send("POST /solve HTTP/1.1\r\nhost: loc").await;
    let prompt = running.answer(&get("/healthz")).await;
    assert!(prompt.starts_with("HTTP/1.1 200"), "{prompt}");
    let mut rest = Vec::new();
    let cut_off = tokio::time::timeout(Duration::from_secs(20), slow.read_to_end(&mut rest)).await;
    assert!(cut_off.is_ok(), "still connected after {:?}", begun.elapsed());
    assert!(begun.elapsed() >= Duration::from_millis(900), "cut off after {:?}", begun.elapsed());
}

#[tokio::test]
async fn a_body_that_stalls_is_answered_with_a_timeout() {
    let options = Options { read_seconds: NonZeroU64::MIN, ..one_worker() };
    let running = Running::start(options, instant()).await;
    let stalled = "POST /solve HTTP/1.1\r\nhost: localhost\r\ncontent-length: 100\r\nconnection: close\r\n\r\n{";
    let answer = running.answer(stalled).await;
    assert!(answer.starts_with("HTTP/1.1 408"), "{answer}");
    assert!(answer.contains("/problems/body-timeout"), "{answer}");
}

#[tokio::test]
async fn a_client_that_reads_no_answer_before_it_has_sent_everything_gets_its_refusal() {
    let running = Running::start(Options { body_mib: NonZeroUsize::MIN, ..one_worker() }, instant()).await;
    // The body of the request is larger than what the operating system buffers for a connection at both ends.
    let body = " ".repeat(64 << 20);
    for (content_type, status) in [("application/json", "413"), ("text/plain", "415")] {
        let head = format!(
            "POST /solve HTTP/1.1\r\nhost: localhost\r\ncontent-type: {content_type}\r\ncontent-length: {}\r\n\
             connection: close\r\n\r\n",
            body.len()
        );
        let mut stream = running.send(&head).await;
        stream.write_all(body.as_bytes()).await.unwrap();
        let answer = read(&mut stream).await;
        assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{answer}");
    }
}

#[tokio::test]
async fn a_client_that_asks_whether_to_send_is_refused_at_once() {
    let running = Running::start(Options { body_mib: NonZeroUsize::MIN, ..one_worker() }, instant()).await;
    let asks = "POST /solve HTTP/1.1\r\nhost: localhost\r\nexpect: 100-continue\r\ncontent-length: 9999999\r\n\r\n";
    let answer = running.answer(asks).await;
    assert!(answer.starts_with("HTTP/1.1 413 "), "{answer}");
}

#[tokio::test]
async fn a_client_that_does_not_take_its_answer_is_cut_off() {
    // The response is larger than what the operating system buffers for a connection at both ends.
    let values: Vec<f64> = (0..2_000_000).map(|k| f64::from(k) / 3.0).collect();
    let long: Solver = Arc::new(move |_, _| {
        let mut solution = halving(Status::Completed);
        solution.trajectory.fields[0].values.clone_from(&values);
        solution.trajectory.t.clone_from(&values);
        solution
    });
    let running = Running::start(Options { read_seconds: NonZeroU64::MIN, ..one_worker() }, long).await;
    let mut slow = running.send(&post("")).await;
    slow.readable().await.unwrap();
    let begun = Instant::now();
    while !running.answer(&get("/metrics")).await.contains("\ndvi_connections 1\n") {
        assert!(begun.elapsed() < Duration::from_secs(60), "still connected");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let mut taken = Vec::new();
    // Reading the rest of the response may end in an error, since the service has closed the connection.
    let _ = slow.read_to_end(&mut taken).await;
    assert!(!String::from_utf8(taken).unwrap().ends_with('}'), "it was all on its way");
}

#[tokio::test]
async fn a_connection_over_the_bound_waits_until_another_closes() {
    let running = Running::start(Options { connections: NonZeroUsize::MIN, ..one_worker() }, instant()).await;
    let first = TcpStream::connect(running.address).await.unwrap();
    let mut second = running.send(&get("/metrics")).await;
    let early = tokio::time::timeout(Duration::from_millis(200), second.readable()).await;
    assert!(early.is_err(), "the second is served beside the first");
    drop(first);
    let answer = read(&mut second).await;
    assert!(answer.contains("\ndvi_connections 1\n"), "{answer}");
}

#[tokio::test]
async fn a_service_asked_to_stop_answers_who_waits_and_ends() {
    let gate = Gate::new();
    let running = Running::start(one_worker(), gate.solver()).await;
    let mut waiting = running.send(&post("")).await;
    gate.entered(1).await;
    running.stop.send(()).await.unwrap();
    while !running.service.jobs().is_draining() {
        tokio::task::yield_now().await;
    }
    let ready = running.answer(&get("/readyz")).await;
    assert!(ready.starts_with("HTTP/1.1 503"), "{ready}");
    let refused = running.answer(&post("")).await;
    assert!(refused.starts_with("HTTP/1.1 503") && refused.contains("/problems/draining"), "{refused}");
    gate.let_through(1);
    let answer = read(&mut waiting).await;
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("\"status\":\"completed\""), "{answer}");
    running.served.await.unwrap();
}

#[tokio::test]
async fn jobs_that_outlive_the_grace_time_are_cancelled() {
    let gate = Gate::new();
    let running = Running::start(Options { grace_seconds: 0, ..one_worker() }, gate.solver()).await;
    let mut waiting = running.send(&post("")).await;
    gate.entered(1).await;
    running.stop.send(()).await.unwrap();
    gate.cancelled(1).await;
    let answer = read(&mut waiting).await;
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("\"status\":\"stopped\""), "{answer}");
    running.served.await.unwrap();
}

#[tokio::test]
async fn a_second_signal_cuts_the_grace_time_short() {
    let gate = Gate::new();
    let running = Running::start(Options { grace_seconds: 3600, ..one_worker() }, gate.solver()).await;
    let path = running.answer(&post("prefer: respond-async\r\n")).await;
    assert!(path.starts_with("HTTP/1.1 202"), "{path}");
    gate.entered(1).await;
    running.stop.send(()).await.unwrap();
    running.stop.send(()).await.unwrap();
    gate.cancelled(1).await;
    running.served.await.unwrap();
}

#[tokio::test]
async fn streams_of_events_do_not_hold_up_the_end_of_the_service() {
    let (done, ended) = std::sync::mpsc::channel::<()>();
    let ended = std::sync::Mutex::new(ended);
    let (began, mut beginning) = tokio::sync::mpsc::unbounded_channel();
    let stubborn: Solver = Arc::new(move |_, _| {
        let _ = began.send(());
        let _ = ended.lock().unwrap().recv();
        halving(Status::Completed)
    });
    let running = Running::start(Options { grace_seconds: 0, ..one_worker() }, stubborn).await;
    let accepted = running.answer(&post("prefer: respond-async\r\n")).await;
    beginning.recv().await.expect("a solve that begins");
    let path = accepted.lines().find_map(|line| line.strip_prefix("location: ")).expect(&accepted).to_owned();
    let mut follower = running.send(&get(&format!("{path}/events"))).await;
    let mut first = [0; 12];
    follower.read_exact(&mut first).await.unwrap();
    assert_eq!(&first, b"HTTP/1.1 200");
    running.stop.send(()).await.unwrap();
    let told = read(&mut follower).await;
    assert!(told.contains("event: progress") && !told.contains("event: done"), "{told}");
    running.served.await.unwrap();
    drop(done);
}
