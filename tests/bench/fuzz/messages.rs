//! Fuzzing of the messages between the front and a worker: invalid orders to a worker, and invalid reports to the
//! front. The receiver refuses a message, ends the task or ignores the message; it must not panic, hang, or allocate
//! the memory that a declared length asks for.

use super::mutation::Mutation;
use dvi::problem::Control;
use dvi::service::worker::{
    Confinement, Event, Finished, Left, Limits, Members, Order, Origin, Start, Supervisor, Task, Watch, frame, serve,
};
use serde_json::Value;
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;
use tokio::runtime::Builder;
use tokio::sync::Notify;
use tokio::time::timeout;

const DOCUMENT: &[u8] = br#"{"problem":{"dvi":{"states":{"x":{"initial":1,"rate":"-x"}}}},"time":{"end":1}}"#;

/// Number of messages in one fuzzed conversation.
const TALK: usize = 12;

/// A range of sweep members that an order to a worker asks for, although the document of the task is no sweep.
const MEMBERS: Members = Members { first: 1, end: 3, lost: None, seconds: 1.0 };

/// Limits of a task, so low that an allocation of the length that a message declares would be noticed.
const LIMITS: Limits = Limits { steps: 100, memory: 16 << 20, wall_seconds: Some(2.0), result_bytes: 1 << 20 };

/// Timeout of a conversation, longer than any conversation takes.
const TIMEOUT: Duration = Duration::from_secs(30);

/// Numbers of messages sent to workers (`orders`) and to the front (`reports`), and of completed tasks, over all
/// conversations.
#[derive(Debug, Default)]
pub struct Met {
    pub orders: u64,
    pub reports: u64,
    /// Number of conversations in which the front process completed its task.
    pub finished: u64,
}

/// Sends `count` fuzzed messages, half to a worker and half to the front process.
pub fn meet(count: u64, seed: u64) -> Met {
    let mut met = Met::default();
    let (orders, reports) = (orders(), reports());
    let mut mutation = Mutation::new(seed, &[orders.clone(), reports.clone()].concat());
    let (orders, reports) = ([orders, Vec::new()], [reports, Vec::new()]);
    let said = Said::default();
    let runtime = Builder::new_current_thread().enable_all().build().expect("a runtime");
    while met.orders + met.reports < count {
        let talk = talk(&mut mutation, &orders);
        let to_worker = io::Cursor::new(talk);
        // The result of the worker is ignored: it only has to return.
        let _ = serve(to_worker, said.clone(), Arc::new(dvi::solve), Confinement::default());
        assert!(!said.1.load(Relaxed), "the solver panicked over an order");
        said.0.lock().expect("a lock").clear();
        met.orders += TALK as u64;
        let talk = talk_of_worker(&mut mutation, &reports);
        met.finished += u64::from(runtime.block_on(listen(talk)));
        met.reports += TALK as u64;
    }
    met
}

/// Returns a conversation of fuzzed frames (messages with their lengths), some of which are cut or declare wrong
/// lengths.
fn talk(mutation: &mut Mutation, corpus: &[Vec<Vec<u8>>; 2]) -> Vec<u8> {
    let mut talk = Vec::new();
    for _ in 0..TALK {
        let message = if mutation.below(3) == 0 {
            mutation.change(corpus)
        } else {
            corpus[0][mutation.below(corpus[0].len())].clone()
        };
        let bytes = if mutation.below(2) == 0 { DOCUMENT } else { b"" };
        let lengths = [message.len(), bytes.len()].map(|length| match mutation.below(40) {
            0 => mutation.below(1 << 32) as u32,
            _ => length as u32,
        });
        lengths.iter().for_each(|length| talk.extend_from_slice(&length.to_le_bytes()));
        talk.extend_from_slice(&message);
        talk.extend_from_slice(bytes);
    }
    talk
}

/// Returns a conversation of fuzzed frames for the front process; most begin with the valid first reports of a
/// worker.
fn talk_of_worker(mutation: &mut Mutation, reports: &[Vec<Vec<u8>>; 2]) -> Vec<u8> {
    let mut begun = Vec::new();
    for report in &reports[0][..if mutation.below(8) == 0 { 0 } else { 2 }] {
        let message: Value = serde_json::from_slice(report).expect("a report");
        frame::write(&mut begun, &message, &[]).expect("room");
    }
    begun.extend(talk(mutation, reports));
    begun
}

/// Lets the front process give a task to a worker that sends the bytes `talk` whatever it is ordered to do. Returns
/// whether the task was completed.
async fn listen(talk: Vec<u8>) -> bool {
    let launches = AtomicU64::new(0);
    let talk = Arc::new(talk);
    let launcher = Arc::new(move || {
        let ((mut input, orders), (reports, mut output)) = (io::pipe()?, io::pipe()?);
        // If the fuzzing worker ends before it has received the task, its replacement behaves correctly.
        let (is_first, says) = (launches.fetch_add(1, Relaxed) == 0, Arc::clone(&talk));
        thread::spawn(move || {
            if !is_first {
                return serve(input, output, Arc::new(dvi::solve), Confinement::default());
            }
            let _ = output.write_all(&says);
            drop(output);
            io::copy(&mut input, &mut io::sink()).map(drop)
        });
        Ok(Start { orders: orders.into(), reports: reports.into(), process: None })
    });
    let mut supervisor = Supervisor::new(launcher, u64::MAX, Arc::new(|_: Event<'_>| {}));
    if timeout(TIMEOUT, supervisor.start()).await.expect("an end").is_err() {
        return false;
    }
    let (control, halted, origin) = (Control::new(), Notify::new(), Origin::default());
    let watch = Watch { origin: &origin, control: &control, halted: &halted, is_unwanted: &|| false };
    let mut long = Vec::new();
    let task = &mut Task {
        solve: true,
        members: None,
        document: DOCUMENT,
        limits: LIMITS,
        watch: &watch,
        long: &mut long,
        yields: false,
        slice: None,
    };
    let finished = timeout(TIMEOUT, supervisor.perform(task)).await.expect("an end");
    // Whatever a worker sends, the front process must not keep much more than the size limit of a result.
    assert!(long.len() <= 8 * LIMITS.result_bytes, "{} bytes were kept", long.len());
    if let Ok(Finished::Solved(_, Left::Text(json))) = &finished {
        assert!(json.len() <= 2 * LIMITS.result_bytes, "{} bytes were gathered", json.len());
    }
    finished.is_ok()
}

fn orders() -> Vec<Vec<u8>> {
    let origin = Origin { job: Some("job".to_owned()), request: None, traceparent: None };
    let orders = [
        Order::Solve { task: 1, limits: LIMITS, origin: origin.clone(), members: None },
        Order::Solve { task: 1, limits: LIMITS, origin: origin.clone(), members: Some(MEMBERS) },
        Order::Check { task: 2, limits: LIMITS, origin },
        Order::Look { task: 1 },
        Order::Cancel { task: 1 },
    ];
    orders.iter().map(|order| serde_json::to_vec(order).expect("an order")).collect()
}

/// Returns the reports that a worker sends for a solve, a check, a rejected specification and a panic, each after the
/// reports `Ready` and `Taken`.
fn reports() -> Vec<Vec<u8>> {
    let mut orders = Vec::new();
    let order = |task, solve| {
        let origin = Origin::default();
        if solve {
            Order::Solve { task, limits: LIMITS, origin, members: None }
        } else {
            Order::Check { task, limits: LIMITS, origin }
        }
    };
    for (task, solve, document) in [(1, true, DOCUMENT), (1, false, DOCUMENT), (1, true, &b"{}"[..])] {
        frame::write(&mut orders, &order(task, solve), document).expect("room");
    }
    let said = Said::default();
    serve(io::Cursor::new(orders), said.clone(), Arc::new(dvi::solve), Confinement::default()).expect("a worker");
    // Wait for the solver thread of the worker, which may still be busy.
    thread::sleep(Duration::from_millis(200));
    let said = said.0.lock().expect("a lock").clone();
    let (mut said, mut reports) = (said.as_slice(), Vec::new());
    while let Ok(Some((report, _))) = frame::read::<Value>(&mut said) {
        reports.push(report.to_string().into_bytes());
    }
    for more in
        [r#"{"piece":{"task":1}}"#, r#"{"defect":{"task":1,"message":"a panic"}}"#, r#"{"too_large":{"task":1}}"#]
    {
        reports.push(more.as_bytes().to_vec());
    }
    assert!(reports.len() >= 6, "{reports:?}");
    reports
}

/// The output of a worker, and whether it reported a panic of its solver.
#[derive(Clone, Default)]
struct Said(Arc<Mutex<Vec<u8>>>, Arc<AtomicBool>);

impl Write for Said {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // A frame is written in one call, with two lengths of four bytes before the message.
        self.1.fetch_or(bytes.get(8..).is_some_and(|message| message.starts_with(b"{\"defect\"")), Relaxed);
        self.0.lock().expect("a lock").extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
