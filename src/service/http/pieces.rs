//! Responses sent in pieces, each generated when the one before has been taken. The bytes of all pieces in memory have
//! a common bound: the responses to slow clients wait for room, and hold only the room of the pieces not yet taken.

use super::part::Part;
use axum::body::{Bytes, HttpBody};
use hyper::body::Frame;
use solution::columnar::{JsonPieces, TablePieces};
use solution::encodings::MembersPieces;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::spawn_blocking;

/// The unit of room, in bytes.
const KIB: usize = 1 << 10;

/// The room taken for a piece before it is generated, in bytes: more than the length of most pieces.
const PIECE: usize = 128 * KIB;

/// The room for the bytes of pending responses.
#[derive(Clone, Debug)]
pub struct Room {
    free: Arc<Semaphore>,
    kib: u32,
}

impl Room {
    /// Room for `mib` MiB.
    pub fn new(mib: usize) -> Self {
        let kib = u32::try_from(mib.saturating_mul(KIB)).unwrap_or(u32::MAX).min(Semaphore::MAX_PERMITS as u32);
        Self { free: Arc::new(Semaphore::new(kib as usize)), kib }
    }

    /// Waits for room for `bytes` bytes, or for all of the room if there is less.
    pub async fn take(&self, bytes: usize) -> Option<OwnedSemaphorePermit> {
        let kib = u32::try_from(bytes.div_ceil(KIB)).unwrap_or(u32::MAX).min(self.kib);
        // The semaphore is never closed.
        Arc::clone(&self.free).acquire_many_owned(kib).await.ok()
    }
}

/// Bytes and the room that they take, which is freed when they are dropped.
pub struct Taken<B> {
    bytes: B,
    _room: Option<OwnedSemaphorePermit>,
}

impl<B> Taken<B> {
    /// `bytes` in `room`.
    pub fn new(bytes: B, room: Option<OwnedSemaphorePermit>) -> Self {
        Self { bytes, _room: room }
    }
}

impl<B: AsRef<[u8]>> AsRef<[u8]> for Taken<B> {
    fn as_ref(&self) -> &[u8] {
        self.bytes.as_ref()
    }
}

/// A response being generated.
pub enum Making {
    /// JSON.
    Json(JsonPieces),
    /// A table, in one of its formats.
    Table(TablePieces),
    /// The table of a sweep, in one of its formats.
    Members(Box<MembersPieces>),
}

/// A part of the results, and the state of its generation.
pub struct Unwritten {
    /// The part of the results.
    pub part: Part,
    /// The state of the generation.
    pub making: Making,
}

impl Unwritten {
    /// Appends the next piece to `out`; returns whether there are more.
    ///
    /// # Errors
    /// I/O errors of the disk.
    pub fn write(&mut self, out: &mut Vec<u8>) -> io::Result<bool> {
        match &mut self.making {
            Making::Json(json) => json.write(&*self.part.columns, out),
            Making::Table(table) => table.write(&*self.part.columns, out),
            Making::Members(table) => {
                let members = self.part.columns.members().ok_or(io::ErrorKind::InvalidInput)?;
                table.write(members, out)
            }
        }
    }
}

/// A piece, and the rest of the response.
type NextPiece = io::Result<(Bytes, Option<Box<Unwritten>>)>;

/// The body of a response in pieces.
pub struct Pieces {
    room: Room,
    /// The rest of the response, between two pieces.
    rest: Option<Box<Unwritten>>,
    /// The generation of the next piece.
    next: Option<Pin<Box<dyn Future<Output = NextPiece> + Send>>>,
}

impl Pieces {
    /// The body of a response that has not been begun.
    pub fn new(answer: Unwritten, room: Room) -> Self {
        Self { room, rest: Some(Box::new(answer)), next: None }
    }
}

async fn next_piece(mut answer: Box<Unwritten>, room: Room) -> NextPiece {
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
            *next = Some(Box::pin(next_piece(answer, room.clone())));
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
        // A request for more than the whole room takes the whole room.
        assert!(room.take(usize::MAX).await.is_some());
    }
}
