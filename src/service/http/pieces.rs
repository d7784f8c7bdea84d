//! Responses sent in pieces, each generated when the client has taken the previous one. The bytes of all pieces in
//! memory have a common limit: responses to slow clients wait for memory, and occupy only that of the pieces not yet
//! taken.

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

/// The unit in which response memory is counted, in bytes.
const KIB: usize = 1 << 10;

/// The memory reserved for a piece of a response before it is generated, in bytes: more than the length of most
/// pieces.
const PIECE: usize = 128 * KIB;

/// The memory budget of all responses that have not been sent completely.
#[derive(Clone, Debug)]
pub struct Room {
    free: Arc<Semaphore>,
    /// The part of the memory budget that the values of excerpts may take; the rest of the budget is always available
    /// to pieces of responses.
    for_kept: Arc<Semaphore>,
    kib: u32,
}

/// A reservation of memory for the values of an excerpt, which are kept until their response has been sent.
#[derive(Debug)]
pub struct Kept(#[expect(dead_code, reason = "dropped with the values")] [OwnedSemaphorePermit; 2]);

/// The fraction `1/FOR_KEPT` of the memory budget is available to the values of all excerpts, and `1/OF_ONE` to those
/// of one response: a slow reader holds them for as long as it reads.
const FOR_KEPT: u32 = 2;
const OF_ONE: u32 = 32;

impl Room {
    /// Creates a memory budget of `mib` MiB for responses that have not been sent completely.
    pub fn new(mib: usize) -> Self {
        let kib = u32::try_from(mib.saturating_mul(KIB)).unwrap_or(u32::MAX).min(Semaphore::MAX_PERMITS as u32);
        let semaphore = |kib: u32| Arc::new(Semaphore::new(kib as usize));
        Self { free: semaphore(kib), for_kept: semaphore(kib / FOR_KEPT), kib }
    }

    /// Reserves memory for `bytes` bytes of values of an excerpt, if they are few and the memory is available at
    /// once. A response that waited for such memory while holding some could wait for ever (deadlock).
    pub fn keep(&self, bytes: usize) -> Option<Kept> {
        let kib = u32::try_from(bytes.div_ceil(KIB)).ok().filter(|kib| *kib <= self.kib / OF_ONE)?;
        let taken = |of: &Arc<Semaphore>| Arc::clone(of).try_acquire_many_owned(kib).ok();
        Some(Kept([taken(&self.for_kept)?, taken(&self.free)?]))
    }

    /// Waits until `bytes` bytes of the budget are free, or the whole budget if it is smaller, and reserves them.
    pub async fn take(&self, bytes: usize) -> Option<OwnedSemaphorePermit> {
        let kib = u32::try_from(bytes.div_ceil(KIB)).unwrap_or(u32::MAX).min(self.kib);
        // `acquire_many_owned` fails only on a closed semaphore, and the budget's semaphore is never closed.
        Arc::clone(&self.free).acquire_many_owned(kib).await.ok()
    }
}

/// Bytes of a response with the reservation of their memory, which is released when the bytes are dropped.
pub struct Taken<B> {
    bytes: B,
    _room: Option<OwnedSemaphorePermit>,
}

impl<B> Taken<B> {
    /// Combines `bytes` of a response with the reservation `room` of their memory.
    pub fn new(bytes: B, room: Option<OwnedSemaphorePermit>) -> Self {
        Self { bytes, _room: room }
    }
}

impl<B: AsRef<[u8]>> AsRef<[u8]> for Taken<B> {
    fn as_ref(&self) -> &[u8] {
        self.bytes.as_ref()
    }
}

/// The generator of a response with results in pieces, by format.
pub enum Making {
    /// A generator of the whole solution or an excerpt as JSON.
    Json(JsonPieces),
    /// A generator of the trajectory as a table, in one of the tabular formats.
    Table(TablePieces),
    /// A generator of the table of a sweep, in one of the tabular formats.
    Members(Box<MembersPieces>),
}

/// An excerpt of the results with the generator of its response.
pub struct Unwritten {
    /// The excerpt of the results that the response contains.
    pub part: Part,
    /// The generator, which knows the position that the response has reached.
    pub making: Making,
}

impl Unwritten {
    /// Appends the next piece of the response to `out`; returns whether there are more.
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

/// The next piece of a response, and the generator of the rest of it.
type NextPiece = io::Result<(Bytes, Option<Box<Unwritten>>)>;

/// The body of a response with results that is generated in pieces.
pub struct Pieces {
    room: Room,
    /// The generator of the rest of the response; `None` while it generates a piece on another thread, and at the
    /// end.
    rest: Option<Box<Unwritten>>,
    /// The pending generation of the next piece of the response.
    next: Option<Pin<Box<dyn Future<Output = NextPiece> + Send>>>,
}

impl Pieces {
    /// Creates the body of a response of which nothing has been generated.
    pub fn new(answer: Unwritten, room: Room) -> Self {
        Self { room, rest: Some(Box::new(answer)), next: None }
    }
}

async fn next_piece(mut answer: Box<Unwritten>, room: Room) -> NextPiece {
    let taken = room.take(PIECE).await;
    let work = move || {
        let mut bytes = Vec::with_capacity(PIECE);
        // The piece is filled as far as its size allows, since to return to the task of the connection takes longer
        // than to generate a little more.
        loop {
            let before = bytes.len();
            let more = answer.write(&mut bytes)?;
            if !more || 2 * bytes.len() - before > PIECE {
                return Ok((bytes, more.then_some(answer)));
            }
        }
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
        // A request for more than the whole memory budget of responses gets the whole budget.
        assert!(room.take(usize::MAX).await.is_some());
    }

    #[test]
    fn kept_values_leave_room_for_pieces() {
        let room = Room::new(64);
        assert!(room.keep(3 * KIB * KIB).is_none(), "those of one response are few");
        let mut kept: Vec<_> = (0..16).map(|_| room.keep(2 * KIB * KIB)).collect();
        assert!(kept.iter().all(Option::is_some));
        assert!(room.keep(1).is_none());
        let pieces = Arc::clone(&room.free).try_acquire_many_owned(32 * KIB as u32);
        assert!(pieces.is_ok());
        kept.pop();
        assert!(room.keep(2 * KIB * KIB).is_some());
        // A failed reservation takes nothing from the memory budget of responses.
        let all = Arc::clone(&room.free).try_acquire_many_owned(2 * KIB as u32);
        assert!(all.is_ok() && room.keep(1).is_none());
        drop((pieces, all));
        assert!(room.keep(2 * KIB * KIB).is_some());
    }
}
