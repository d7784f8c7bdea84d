//! The life cycle of the HTTP server, from the first connection to the last.
//!
//! 1. Accept connections, and serve each on a task of its own; a client that does not send its headers in time, or
//!    does not take its response, is disconnected. At the limit of open connections, further ones wait in the
//!    system's backlog.
//! 2. On a signal to stop: refuse new jobs, and give running ones the grace time. Connections are still accepted, so
//!    that clients can fetch results and a load balancer sees `/readyz` fail.
//! 3. When no job is left, at the end of the grace time, or on a second signal: leave the remaining jobs to the next
//!    process, or cancel them if they are not durable.
//! 4. End the event streams, let pending responses complete, and close.

use super::http::Shared;
use super::jobs::Client;
use super::remainder::Lent;
use super::write_timeout::TimedWrites;
use axum::Router;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use jiff::Timestamp;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::OwnedSemaphorePermit;
use tokio::sync::mpsc::Receiver;
use tokio::time::{sleep, timeout};
use tower_service::Service;

/// The time limit, at the stop of the service, for cancelled solves to reach their next step, and again for pending
/// responses to be sent.
const LAST_CALL: Duration = Duration::from_secs(5);

/// The interval between two searches for jobs whose retention time has expired.
const TIDY: Duration = Duration::from_secs(60);

/// The interval between two attempts to recover a job store that could not be written.
const HEAL: Duration = Duration::from_secs(1);

/// The pause after a failed `accept`: while no file descriptor is free, the next `accept` would fail at once.
const BREATH: Duration = Duration::from_millis(50);

/// Serves connections until a message on `stop`; a second message cuts the grace time for running jobs short.
pub async fn serve(listener: TcpListener, router: Router, shared: Shared, mut stop: Receiver<()>) {
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(shared.options.read_time());
    let connections = GracefulShutdown::new();
    let accepting = async {
        loop {
            match listener.accept().await {
                Ok((stream, from)) => {
                    // `acquire_owned` fails only on a closed semaphore, and the semaphore of connections is never
                    // closed.
                    let Ok(place) = Arc::clone(&shared.connections).acquire_owned().await else { return };
                    let client = Client::at(from.ip());
                    serve_connection(&http, &connections, stream, shared.options.read_time(), client, &router, place);
                }
                Err(error) => {
                    tracing::warn!(%error, "no connection could be accepted");
                    sleep(BREATH).await;
                }
            }
        }
    };
    let stopping = async {
        stop.recv().await;
        shared.jobs.drain();
        let grace = shared.options.grace();
        tracing::info!(grace_seconds = grace.as_secs(), "stopping: no more jobs are taken on");
        tokio::select! {
            () = shared.jobs.idle() => {}
            () = sleep(grace) => {}
            Some(()) = stop.recv() => {}
        }
        shared.jobs.park_all().await;
        if timeout(LAST_CALL, shared.jobs.idle()).await.is_err() {
            tracing::warn!("some solves did not stop and are abandoned");
        }
        shared.jobs.flush().await;
    };
    let expiring = async {
        loop {
            sleep(TIDY).await;
            shared.jobs.expire(Timestamp::now()).await;
        }
    };
    let healing = async {
        loop {
            sleep(HEAL).await;
            shared.jobs.heal().await;
        }
    };
    tokio::select! {
        () = accepting => {}
        () = expiring => {}
        () = healing => {}
        () = stopping => {}
    }
    shared.closing.send_replace(true);
    if timeout(LAST_CALL, connections.shutdown()).await.is_err() {
        tracing::warn!("some connections did not take their answers and are cut off");
    }
    tracing::info!("stopped");
}

fn serve_connection(
    http: &http1::Builder,
    connections: &GracefulShutdown,
    stream: TcpStream,
    io_timeout: Duration,
    client: Client,
    router: &Router,
    place: OwnedSemaphorePermit,
) {
    // Disable Nagle's algorithm: responses are written whole, and waiting for more data only delays them.
    if let Err(error) = stream.set_nodelay(true) {
        tracing::debug!(%error, "a connection was lost at its start");
        return;
    }
    let router = router.clone();
    let service = service_fn(move |request: hyper::Request<Incoming>| {
        let (mut request, body) = Lent::of(request);
        request.extensions_mut().insert(client);
        let answer = router.clone().call(request);
        async move {
            let answer = answer.await;
            if let Some(body) = body {
                body.drop_rest(io_timeout).await;
            }
            answer
        }
    });
    let connection =
        connections.watch(http.serve_connection(TokioIo::new(TimedWrites::new(stream, io_timeout)), service));
    tokio::spawn(async move {
        let _until_its_end = place;
        if let Err(error) = connection.await {
            tracing::debug!(%error, "a connection ended in an error");
        }
    });
}
