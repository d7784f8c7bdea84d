//! Functions for tests of the service: requests without a socket, and solvers that a test controls.

use crate::nats::{self, Worker};
pub use crate::threads::threads;
use axum::Router;
use axum::body::{Body, Bytes, HttpBody};
use axum::http::{HeaderMap, Request, StatusCode};
use dvi::problem::Stop;
use dvi::service::jobs::{Client, Solver};
use dvi::service::{Options, Service};
use dvi::solution::{Field, Solution, Status, Trajectory, Verdict};
use http_body_util::BodyExt;
use hyper::body::Frame;
use serde_json::Value;
use std::io;
use std::net::IpAddr;
use std::num::NonZeroUsize;
use std::pin::Pin;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Condvar, Mutex};
use std::task::{Context, Poll};
use std::thread;
use std::time::{Duration, Instant};
use tokio::select;
use tokio::sync::{oneshot, watch};
use tower::ServiceExt;

/// Specification of an exponential decay.
pub const DECAY: &str = r#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x"}}}},"time":{"end":1}}"#;

/// Returns the solution that the solvers of this module return: `x(0) = 1`, `x(1) = 0.5`.
pub fn halving(status: Status) -> Solution {
    let fields = vec![Field { name: "x".to_owned(), values: vec![1.0, 0.5] }];
    let trajectory = Trajectory { t: vec![0.0, 1.0], fields, events: vec![] };
    let verdict = Verdict { trusted: status == Status::Completed, ..Verdict::default() };
    Solution { status, verdict, trajectory, ..Solution::default() }
}

/// Returns a solver that returns a solution at once.
pub fn instant() -> Solver {
    Arc::new(|_, _| halving(Status::Completed))
}

/// Returns options for a service with a single worker.
pub fn one_worker() -> Options {
    Options { workers: NonZeroUsize::MIN, express: 0, relief: 0, ..Options::default() }
}

pub fn count(n: usize) -> NonZeroUsize {
    NonZeroUsize::new(n).unwrap()
}

/// A gate for tests: it blocks every solve until the test lets the solve through or the solve is cancelled.
pub struct Gate {
    open: Mutex<usize>,
    opened: Condvar,
    entered: watch::Sender<usize>,
    cancelled: watch::Sender<usize>,
}

impl Gate {
    pub fn new() -> Arc<Self> {
        let (entered, cancelled) = (watch::Sender::new(0), watch::Sender::new(0));
        Arc::new(Self { open: Mutex::new(0), opened: Condvar::new(), entered, cancelled })
    }

    pub fn solver(self: &Arc<Self>) -> Solver {
        let gate = Arc::clone(self);
        Arc::new(move |_, control| {
            // An inline solve, recognised by its short deadline, is not blocked by the gate.
            if control.deadline().is_some_and(|deadline| deadline < Instant::now() + Duration::from_millis(10)) {
                return halving(Status::Stopped);
            }
            control.report(0.5, 7);
            gate.entered.send_modify(|n| *n += 1);
            let mut open = gate.open.lock().unwrap();
            loop {
                // Check for cancellation first: a cancelled solve must not use up the permission of another solve.
                if let Some(stop) = control.poll() {
                    if stop == Stop::Cancelled {
                        gate.cancelled.send_modify(|n| *n += 1);
                    }
                    return halving(Status::Stopped);
                }
                if *open > 0 {
                    *open -= 1;
                    return halving(Status::Completed);
                }
                open = gate.opened.wait_timeout(open, Duration::from_millis(1)).unwrap().0;
            }
        })
    }

    /// Permits `n` blocked solves to finish.
    pub fn let_through(&self, n: usize) {
        *self.open.lock().unwrap() += n;
        self.opened.notify_all();
    }

    /// Waits until `n` solves have begun since the gate was created.
    pub async fn entered(&self, n: usize) {
        let mut entered = self.entered.subscribe();
        within(format!("{n} solves begin"), entered.wait_for(|entered| *entered >= n)).await.unwrap();
    }

    /// Waits until `n` solves have been cancelled since the gate was created.
    pub async fn cancelled(&self, n: usize) {
        let mut cancelled = self.cancelled.subscribe();
        within(format!("{n} solves are cancelled"), cancelled.wait_for(|cancelled| *cancelled >= n)).await.unwrap();
    }
}

/// Longest time for which a test waits for an event.
const LONGEST: Duration = Duration::from_secs(60);

/// Waits for `event`, and fails the test if it does not occur within the time limit. A separate thread measures the
/// time, since some tests pause the clock of their runtime.
pub async fn within<T>(told: String, event: impl Future<Output = T>) -> T {
    let ((done, is_done), (ring, late)) = (channel::<()>(), oneshot::channel());
    thread::spawn(move || {
        if is_done.recv_timeout(LONGEST) == Err(RecvTimeoutError::Timeout) {
            let _ = ring.send(());
        }
    });
    select! {
        biased;
        came = event => {
            drop(done);
            came
        }
        Ok(()) = late => panic!("not within {LONGEST:?}: {told}"),
    }
}

/// A service under test with its HTTP router and, if it shares its jobs over NATS, a worker.
pub struct Site {
    pub service: Service,
    pub router: Router,
    _worker: Option<Worker>,
}

impl Site {
    pub fn new(options: Options, solver: Solver) -> Self {
        if nats::is_shared() {
            let options = Options { nats: nats::anew(), ..options };
            let worker = nats::worker(&options, Arc::clone(&solver));
            return Self { _worker: Some(worker), ..Self::gateway(options, solver) };
        }
        let service = Service::start(options, Arc::clone(&solver), &threads(solver)).unwrap();
        Self::of(service)
    }

    /// Wraps a running service; no worker over NATS is started.
    pub fn of(service: Service) -> Self {
        let router = service.router();
        Self { service, router, _worker: None }
    }

    /// Returns a service under test that is a gateway over NATS, without a worker.
    pub fn gateway(options: Options, solver: Solver) -> Self {
        Self::of(nats::gateway(options, solver))
    }

    pub async fn get(&self, path: &str) -> Reply {
        Call::new("GET", path).send(self).await
    }

    /// Posts the decay problem for `client` as an asynchronous job, and returns its path.
    pub async fn accept(&self, client: u8) -> String {
        let reply = Call::solve(DECAY).client(client).header("prefer", "respond-async").send(self).await;
        assert_eq!(reply.status, StatusCode::ACCEPTED, "{:?}", reply.json());
        reply.header("location").to_owned()
    }

    /// Waits until the worker of the job at `path` has reported a step.
    pub async fn reported(&self, path: &str) {
        let start = Instant::now();
        while self.get(path).await.json()["steps"] == 0 {
            assert!(start.elapsed() < Duration::from_secs(20), "the worker reports nothing");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }

    /// Waits until the job at `path` is reported as running.
    pub async fn runs(&self, path: &str) {
        let start = Instant::now();
        while self.get(path).await.json()["status"] != "running" {
            assert!(start.elapsed() < Duration::from_secs(20), "{path} does not run");
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }

    /// Waits for the end of the job at `path`, and returns its status.
    pub async fn ended(&self, path: &str) -> Value {
        let id = path.rsplit('/').next().unwrap().parse().unwrap();
        let job = self.service.jobs().find(id).unwrap();
        within(format!("{path} ends"), job.settled()).await;
        self.get(path).await.json()
    }

    /// Waits until no job waits or runs.
    pub async fn idle(&self) {
        within("no job is left".to_owned(), self.service.jobs().idle()).await;
    }
}

/// An HTTP request under construction.
pub struct Call(Request<Body>);

impl Call {
    pub fn new(method: &str, path: &str) -> Self {
        Self(Request::builder().method(method).uri(path).header("host", "localhost").body(Body::empty()).unwrap())
    }

    pub fn solve(document: impl Into<Body>) -> Self {
        Self::post("/solve", document)
    }

    pub fn check(document: impl Into<Body>) -> Self {
        Self::post("/check", document)
    }

    pub fn post(path: &str, document: impl Into<Body>) -> Self {
        let call = Self::new("POST", path).header("content-type", "application/json");
        Self(call.0.map(|_| document.into()))
    }

    pub fn header(mut self, name: &'static str, value: &str) -> Self {
        self.0.headers_mut().insert(name, value.parse().unwrap());
        self
    }

    pub fn client(mut self, last: u8) -> Self {
        self.0.extensions_mut().insert(Client::at(IpAddr::from([10, 0, 0, last])));
        self
    }

    /// Sends the request on behalf of the owner of the job in its path, unless another client is set.
    pub async fn send(self, site: &Site) -> Reply {
        self.by_owner(site).send_to(site.router.clone()).await
    }

    /// Sends the request on behalf of the owner of the job in its path, unless another client is set, and returns the
    /// unread body of the response.
    pub async fn body(self, site: &Site) -> Body {
        site.router.clone().oneshot(self.by_owner(site).0).await.unwrap().into_body()
    }

    fn by_owner(mut self, site: &Site) -> Self {
        let id = self.0.uri().path().split('/').nth(2).and_then(|id| id.parse().ok());
        if self.0.extensions().get::<Client>().is_none()
            && let Some(job) = id.and_then(|id| site.service.jobs().find(id))
        {
            self.0.extensions_mut().insert(job.client);
        }
        self
    }

    pub async fn send_to(self, router: Router) -> Reply {
        let response = router.oneshot(self.0).await.unwrap();
        let (parts, body) = response.into_parts();
        let body = body.collect().await.unwrap().to_bytes().to_vec();
        Reply { status: parts.status, headers: parts.headers, body }
    }
}

/// An HTTP response, read to its end.
#[derive(Debug)]
pub struct Reply {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: Vec<u8>,
}

impl Reply {
    pub fn header(&self, name: &str) -> &str {
        self.headers.get(name).unwrap_or_else(|| panic!("no {name} in {self:?}")).to_str().unwrap()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error} in {self:?}"))
    }

    pub fn text(&self) -> &str {
        std::str::from_utf8(&self.body).unwrap()
    }

    /// Asserts that the response is the problem (RFC 9457) with the given status and type, and returns the members of
    /// the problem.
    #[track_caller]
    pub fn problem(&self, status: u16, slug: &str) -> Value {
        let problem = self.json();
        assert_eq!(self.status.as_u16(), status, "{problem}");
        assert_eq!(self.header("content-type"), "application/problem+json");
        assert_eq!(problem["type"], format!("/problems/{slug}"), "{problem}");
        assert_eq!(problem["status"], status);
        for member in ["title", "detail"] {
            assert!(problem[member].as_str().is_some_and(|text| !text.is_empty()), "{member} in {problem}");
        }
        problem
    }
}

/// A step of a scripted request body: data, an error, or waiting forever.
pub enum Arrival {
    Piece(String),
    Broken,
    Never,
}

/// A request body of unknown length that performs scripted steps, beginning with the last one in the list.
pub struct Scripted(pub Vec<Arrival>);

impl HttpBody for Scripted {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        match self.0.pop() {
            Some(Arrival::Piece(text)) => Poll::Ready(Some(Ok(Frame::data(text.into())))),
            Some(Arrival::Broken) => Poll::Ready(Some(Err(io::ErrorKind::UnexpectedEof.into()))),
            Some(Arrival::Never) => {
                self.0.push(Arrival::Never);
                Poll::Pending
            }
            None => Poll::Ready(None),
        }
    }
}
