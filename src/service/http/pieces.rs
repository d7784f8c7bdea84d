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
    /// The part of the room that kept values may take: pieces always have the rest.
    for_kept: Arc<Semaphore>,
    kib: u32,
}

/// The room of values that are kept in memory until their response has been sent.
#[derive(Debug)]
pub struct Kept(#[expect(dead_code, reason = "dropped with the values")] [OwnedSemaphorePermit; 2]);

/// The part of the room that kept values may take in all, and the part that those of one response may take: a slow
/// reader holds them for as long as it reads.
const FOR_KEPT: u32 = 2;
const OF_ONE: u32 = 32;

impl Room {
    /// Room for `mib` MiB.
    pub fn new(mib: usize) -> Self {
        let kib = u32::try_from(mib.saturating_mul(KIB)).unwrap_or(u32::MAX).min(Semaphore::MAX_PERMITS as u32);
        let semaphore = |kib: u32| Arc::new(Semaphore::new(kib as usize));
        Self { free: semaphore(kib), for_kept: semaphore(kib / FOR_KEPT), kib }
    }

    /// Takes room for `bytes` bytes of values, if they are few and there is room for them now. Who waited for such room
    /// and held some might wait for ever.
    pub fn keep(&self, bytes: usize) -> Option<Kept> {
        let kib = u32::try_from(bytes.div_ceil(KIB)).ok().filter(|kib| *kib <= self.kib / OF_ONE)?;
        let taken = |of: &Arc<Semaphore>| Arc::clone(of).try_acquire_many_owned(kib).ok();
        Some(Kept([taken(&self.for_kept)?, taken(&self.free)?]))
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
        // As much as there is room for: to come back to the connection takes longer than to generate a little.
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
        // A request for more than the whole room takes the whole room.
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
        // Kept values that find no room take none.
        let all = Arc::clone(&room.free).try_acquire_many_owned(2 * KIB as u32);
        assert!(all.is_ok() && room.keep(1).is_none());
        drop((pieces, all));
        assert!(room.keep(2 * KIB * KIB).is_some());
    }
}
