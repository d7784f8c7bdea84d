//! Tests of the service as its clients see it: without a socket where none is needed, otherwise over a socket.

mod again;
mod apart;
mod bit_rot;
mod bounds;
mod browsers;
mod catalogue;
mod check;
mod connections;
mod door;
mod durable;
mod events;
mod exchange;
mod exchange_kills;
mod exchange_sweeps;
mod explanations;
mod full_disk;
mod fuzzed;
mod guide;
mod harness;
mod hostile;
mod job_list;
mod jobs;
mod killers;
mod kills;
#[path = "../bench/fuzz/messages.rs"]
mod messages;
mod metrics;
#[path = "../bench/fuzz/mutation.rs"]
mod mutation;
mod nats;
#[expect(dead_code, reason = "benches use the rest")]
mod nats_server;
mod openapi;
mod process;
mod program;
mod readiness;
mod refusals;
mod remote;
mod results;
mod solve;
mod solve_inline;
#[cfg(feature = "otlp")]
mod spans;
mod store;
mod supervision;
mod sweep_kills;
mod sweeps;
mod threads;
mod tokens;
mod verdict;
mod workers;
