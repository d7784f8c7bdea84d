//! The unread remainder of a request body whose response has been decided early, because the body is too large or was
//! not needed.
//!
//! Most clients read no response before they have sent everything, and a connection that is closed with unread bytes
//! is reset, which loses the response (RFC 9112, section 9.6). So the rest of the body is read and dropped before the
//! response is sent, up to a bound. A client that waits for permission to send (`Expect: 100-continue`) sends no
//! body.

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

/// The largest number of bytes of a request body that are read and dropped.
const MOST: u64 = 256 << 20;

/// The longest pause between two pieces of a request body that is being dropped.
const PAUSE: Duration = Duration::from_secs(1);

/// A request body lent to a handler, whose unread remainder can be recovered afterwards.
#[derive(Clone)]
pub struct Lent(Arc<Mutex<Incoming>>);

impl Lent {
    /// Returns the request with its body lent, and a second handle of the body unless the body has ended or the
    /// client waits for permission to send it (`Expect: 100-continue`).
    pub fn of(request: Request<Incoming>) -> (Request<Self>, Option<Self>) {
        let (parts, body) = request.into_parts();
        let comes = !body.is_end_stream() && !parts.headers.contains_key(EXPECT);
        let body = Self(Arc::new(Mutex::new(body)));
        (Request::from_parts(parts, body.clone()), comes.then_some(body))
    }

    /// Reads and drops the rest of the request body, for at most the time `limit`.
    pub async fn drop_rest(mut self, limit: Duration) {
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
        // If the time limit is exceeded, the rest of the body stays unread.
        let _ = timeout(limit, dropping).await;
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
