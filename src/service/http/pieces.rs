//! Answers that go out in pieces, each written when the one before has been taken. The bytes of all pieces in hand are bounded
//! together: clients who read slowly wait for room, and hold none but that of the pieces they have yet to take.

use super::part::Part;
use axum::body::{Bytes, HttpBody};
use hyper::body::Frame;
use solution::columnar::{JsonPieces, TablePieces};
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::spawn_blocking;

/// The unit of room.
const KIB: usize = 1 << 10;

/// What is taken for a piece before it is written: more than most are long.
const PIECE: usize = 128 * KIB;

/// Room for the bytes of answers.
#[derive(Clone, Debug)]
pub struct Room {
    free: Arc<Semaphore>,
    kib: u32,
}

impl Room {
    /// So many MiB.
    pub fn new(mib: usize) -> Self {
        let kib = u32::try_from(mib.saturating_mul(KIB)).unwrap_or(u32::MAX).min(Semaphore::MAX_PERMITS as u32);
        Self { free: Arc::new(Semaphore::new(kib as usize)), kib }
    }

    /// Room for `bytes`, or all that there is, once it is free.
    pub async fn take(&self, bytes: usize) -> Option<OwnedSemaphorePermit> {
        let kib = u32::try_from(bytes.div_ceil(KIB)).unwrap_or(u32::MAX).min(self.kib);
        // Closed it never is.
        Arc::clone(&self.free).acquire_many_owned(kib).await.ok()
    }
}

/// Bytes with the room that they take, which is free again when they are gone.
pub struct Taken<B> {
    bytes: B,
    _room: Option<OwnedSemaphorePermit>,
}

impl<B> Taken<B> {
    /// Those bytes in that room.
    pub fn new(bytes: B, room: Option<OwnedSemaphorePermit>) -> Self {
        Self { bytes, _room: room }
    }
}

impl<B: AsRef<[u8]>> AsRef<[u8]> for Taken<B> {
    fn as_ref(&self) -> &[u8] {
        self.bytes.as_ref()
    }
}

/// An answer in the making.
pub enum Making {
    /// JSON.
    Json(JsonPieces),
    /// A table.
    Table(TablePieces),
}

/// A part, and how far its answer is.
pub struct Unwritten {
    /// What it is of.
    pub part: Part,
    /// How far it is.
    pub making: Making,
}

impl Unwritten {
    /// The next piece, and whether there is more.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn write(&mut self, out: &mut Vec<u8>) -> io::Result<bool> {
        match &mut self.making {
            Making::Json(json) => json.write(&*self.part.columns, out),
            Making::Table(table) => table.write(&*self.part.columns, out),
        }
    }
}

/// A piece, and what is left to be written.
type Written = io::Result<(Bytes, Option<Box<Unwritten>>)>;

/// The body of an answer in pieces.
pub struct Pieces {
    room: Room,
    /// What is to be written, when the next piece is asked for.
    rest: Option<Box<Unwritten>>,
    /// The piece that is being written.
    next: Option<Pin<Box<dyn Future<Output = Written> + Send>>>,
}

impl Pieces {
    /// All that is to be written.
    pub fn new(answer: Unwritten, room: Room) -> Self {
        Self { room, rest: Some(Box::new(answer)), next: None }
    }
}

async fn written(mut answer: Box<Unwritten>, room: Room) -> Written {
    let taken = room.take(PIECE).await;
    let work = move || {
        let mut bytes = Vec::with_capacity(PIECE);
        let more = answer.write(&mut bytes)?;
        Ok((bytes, more.then_some(answer)))
    };
    let (bytes, rest) = spawn_blocking(work).await.map_err(io::Error::other).flatten()?;
    Ok((Bytes::from_owner(Taken::new(bytes, taken)), rest))
}

impl HttpBody for Pieces {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        let Self { room, rest, next } = &mut *self;
        if next.is_none() {
            let Some(answer) = rest.take() else { return Poll::Ready(None) };
            *next = Some(Box::pin(written(answer, room.clone())));
        }
        let Some(piece) = next else { return Poll::Ready(None) };
        let piece = ready!(piece.as_mut().poll(context));
        *next = None;
        Poll::Ready(Some(piece.map(|(bytes, more)| {
            *rest = more;
            Frame::data(bytes)
        })))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;
    use tokio::time::timeout;

    #[tokio::test(start_paused = true)]
    async fn who_comes_when_all_room_is_taken_waits_until_bytes_are_gone() {
        let room = Room::new(1);
        let first = Bytes::from_owner(Taken::new(vec![1; 10], room.take(KIB * KIB).await));
        let second = room.take(1);
        tokio::pin!(second);
        assert!(timeout(Duration::from_secs(60), &mut second).await.is_err());
        drop(first);
        assert!(second.await.is_some());
        // More than there is takes all.
        assert!(room.take(usize::MAX).await.is_some());
    }
}
