//! Connections, from the first to the last.
//!
//! 1. Accept, and serve each connection on a task of its own; a client that does not send its headers in time,
//!    or does not take its answer, is cut off. While as many are open as may be, the next wait in the system's queue.
//! 2. When asked to stop: refuse new jobs and give the others the grace time. Connections go on being accepted, so that
//!    clients can fetch what ends and a load balancer sees `/readyz` off.
//! 3. When no job is left, or at the end of the grace time or asked a second time: leave what is left to the next
//!    process, or cancel it where there is no disk to keep it.
//! 4. End the streams of events, let answers in hand go out, and close.

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

/// The time that cancelled solves have to reach their next step, and then that answers have to go out.
const LAST_CALL: Duration = Duration::from_secs(5);

/// How often jobs are looked through for those that are too old.
const TIDY: Duration = Duration::from_secs(60);

/// How often a store that could not be written is tried again.
const HEAL: Duration = Duration::from_secs(1);

/// A pause after a failed `accept`: it fails at once for as long as there are no file descriptors.
const BREATH: Duration = Duration::from_millis(50);

/// Serves until something comes through `stop`; a second one cuts the grace time short.
pub async fn serve(listener: TcpListener, router: Router, shared: Shared, mut stop: Receiver<()>) {
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(shared.options.read_time());
    let connections = GracefulShutdown::new();
    let accepting = async {
        loop {
            match listener.accept().await {
                Ok((stream, from)) => {
                    // Places are there until the end.
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
    patience: Duration,
    client: Client,
    router: &Router,
    place: OwnedSemaphorePermit,
) {
    // Answers are written whole: waiting for more to send with them only delays them.
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
                body.drop_rest(patience).await;
            }
            answer
        }
    });
    let connection =
        connections.watch(http.serve_connection(TokioIo::new(TimedWrites::new(stream, patience)), service));
    tokio::spawn(async move {
        let _until_its_end = place;
        if let Err(error) = connection.await {
            tracing::debug!(%error, "a connection ended in an error");
        }
    });
}
