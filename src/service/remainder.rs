//! What a client still sends when its answer stands already: a body too large, or one that nobody asked for.
//!
//! Most clients read no answer before they have sent everything, and a connection that is closed on bytes unread is
//! reset, which takes the answer away (RFC 9112, section 9.6). So the rest of a body is taken and dropped before the
//! answer goes out, as far as that is bounded. A client that asks first whether to send (`Expect: 100-continue`) is told.

use axum::body::{Bytes, HttpBody};
use hyper::body::{Frame, Incoming, SizeHint};
use hyper::header::EXPECT;
use hyper::{Error, Request};
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::time::timeout;

/// The most bytes that are dropped.
const MOST: u64 = 256 << 20;

/// The longest pause after which more is expected.
const PAUSE: Duration = Duration::from_secs(1);

/// A body that is left to whoever answers, and of which the rest can be had back.
#[derive(Clone)]
pub struct Lent(Arc<Mutex<Incoming>>);

impl Lent {
    /// The request with its body lent; and the body, unless it has ended or waits to be asked for.
    pub fn of(request: Request<Incoming>) -> (Request<Self>, Option<Self>) {
        let (parts, body) = request.into_parts();
        let comes = !body.is_end_stream() && !parts.headers.contains_key(EXPECT);
        let body = Self(Arc::new(Mutex::new(body)));
        (Request::from_parts(parts, body.clone()), comes.then_some(body))
    }

    /// Takes what is left of it, for so long at the most.
    pub async fn drop_rest(mut self, patience: Duration) {
        if self.is_end_stream() || self.size_hint().lower() > MOST {
            return;
        }
        let dropping = async {
            let mut dropped = 0;
            while dropped <= MOST {
                let next = poll_fn(|context| Pin::new(&mut self).poll_frame(context));
                let Ok(Some(Ok(frame))) = timeout(PAUSE, next).await else { return };
                dropped += frame.data_ref().map_or(0, |data| data.len() as u64);
            }
        };
        // What does not come in time is not waited for.
        let _ = timeout(patience, dropping).await;
    }

    fn body(&self) -> MutexGuard<'_, Incoming> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl HttpBody for Lent {
    type Data = Bytes;
    type Error = Error;

    fn poll_frame(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Error>>> {
        Pin::new(&mut *self.body()).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body().is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body().size_hint()
    }
}
