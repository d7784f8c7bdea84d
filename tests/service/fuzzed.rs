//! A short run of the message fuzzer of `cargo bench --bench fuzz`.

use crate::messages;

#[test]
fn messages_that_nobody_would_send_end_no_worker_and_no_front() {
    let count = std::env::var("DVI_MESSAGES").map_or(4_000, |text| text.parse().unwrap());
    let start = std::time::Instant::now();
    let met = messages::meet(count, u64::from(std::process::id()));
    println!("{met:?} in {:?}", start.elapsed());
    assert!(met.finished > 0, "{met:?}");
}
