//! `GET /readyz`: whether a load balancer should send work to the service.

use crate::harness::{Call, DECAY, Site, halving, one_worker, threads};
use dvi::service::Service;
use dvi::service::jobs::Solver;
use dvi::service::worker::Launcher;
use dvi::solution::Status;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Waits until `/readyz` responds with the given status, and returns the response.
async fn becomes(site: &Site, status: u16) -> crate::harness::Reply {
    let start = Instant::now();
    loop {
        let reply = site.get("/readyz").await;
        if reply.status == status {
            return reply;
        }
        assert!(start.elapsed() < Duration::from_secs(30), "{}", reply.text());
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test]
async fn a_service_that_cannot_start_workers_is_not_ready_until_it_can() {
    let solver: Solver = Arc::new(|specification, _| {
        assert!(specification.label().is_none(), "on purpose");
        halving(Status::Completed)
    });
    let (refused, start) = (Arc::new(AtomicBool::new(false)), threads(Arc::clone(&solver)));
    let refuses = Arc::clone(&refused);
    let launcher: Launcher =
        Arc::new(move || if refuses.load(Relaxed) { Err(io::ErrorKind::WouldBlock.into()) } else { start() });
    let service = Service::start(one_worker(), solver, &launcher).unwrap();
    let site = Site::of(service);
    becomes(&site, 200).await;
    refused.store(true, Relaxed);
    // The solver panics in this job, so that the only worker is lost.
    Call::solve(DECAY.replacen('{', "{\"label\":\"panics\",", 1)).send(&site).await.problem(500, "defect");
    let reply = becomes(&site, 503).await;
    reply.problem(503, "no-workers");
    assert!(reply.header("retry-after").parse::<u64>().unwrap() > 0);
    assert_eq!(site.get("/healthz").await.status, 200);
    let path = site.accept(1).await;
    refused.store(false, Relaxed);
    becomes(&site, 200).await;
    assert_eq!(site.ended(&path).await["status"], "successful");
}
