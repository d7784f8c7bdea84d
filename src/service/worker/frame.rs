//! The framing of messages between the front process and a worker on a byte stream: the length of the message (four
//! bytes, little-endian), the length of its payload (four bytes, little-endian), the message as JSON, and the
//! payload.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::{self, Read, Write};

/// The size of the header of a frame (a message with its payload), in bytes: the length of the message and the length
/// of the payload.
const HEAD: usize = 8;

/// The largest size, in bytes, of a message (some hundred events, or the reasons of a verdict) and of the payload of
/// a report (a piece of a result, a summary, or the errors of a specification). Longer input is refused.
const LONGEST: usize = 64 << 20;

/// Encodes a message as a frame without its payload; `bytes` is the length of the payload.
///
/// # Errors
/// The message or the payload is too long for its length field.
pub fn head<M: Serialize>(message: &M, bytes: usize) -> io::Result<Vec<u8>> {
    let mut head = vec![0; HEAD];
    serde_json::to_writer(&mut head, message)?;
    let lengths = [head.len() - HEAD, bytes].map(u32::try_from);
    for (place, length) in head.chunks_mut(4).zip(lengths) {
        place.copy_from_slice(&length.map_err(|_| io::ErrorKind::FileTooLarge)?.to_le_bytes());
    }
    Ok(head)
}

/// Writes a message and its payload as one frame.
///
/// # Errors
/// I/O errors of `out`.
pub fn write<M: Serialize>(out: &mut impl Write, message: &M, bytes: &[u8]) -> io::Result<()> {
    let mut frame = head(message, bytes.len())?;
    // A short payload is copied behind its message, so that one write to the pipe suffices.
    if bytes.len() <= 64 << 10 {
        frame.extend_from_slice(bytes);
        return out.write_all(&frame);
    }
    out.write_all(&frame)?;
    out.write_all(bytes)
}

/// Reads a message and its payload; returns `None` at the end of the stream.
///
/// # Errors
/// I/O errors of `input`, or the input is not a message.
pub fn read<M: DeserializeOwned>(input: &mut impl Read) -> io::Result<Option<(M, Vec<u8>)>> {
    let mut lengths = [0; HEAD];
    match input.read_exact(&mut lengths) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        read => read?,
    }
    let (message, bytes) = parts(lengths)?;
    let mut text = vec![0; message];
    input.read_exact(&mut text)?;
    let mut rest = vec![0; bytes];
    input.read_exact(&mut rest)?;
    Ok(Some((serde_json::from_slice(&text)?, rest)))
}

fn parts(lengths: [u8; HEAD]) -> io::Result<(usize, usize)> {
    let [a, b, c, d, e, f, g, h] = lengths;
    let [message, bytes] = [[a, b, c, d], [e, f, g, h]].map(|length| u32::from_le_bytes(length) as usize);
    if message > LONGEST {
        return Err(io::ErrorKind::InvalidData.into());
    }
    Ok((message, bytes))
}

/// A decoder of a stream of frames (messages with payloads): input is appended to its buffer, and complete frames are
/// taken from the buffer.
#[derive(Debug, Default)]
pub struct Decoder {
    /// The bytes of the stream that have not been decoded; new bytes are appended.
    pub buffer: Vec<u8>,
}

impl Decoder {
    /// Takes the next message and its payload from the buffer, if they are complete.
    ///
    /// # Errors
    /// The input is not a message.
    pub fn take<M: DeserializeOwned>(&mut self) -> io::Result<Option<(M, Vec<u8>)>> {
        let Some((lengths, rest)) = self.buffer.split_first_chunk::<HEAD>() else { return Ok(None) };
        let (message, bytes) = parts(*lengths)?;
        if bytes > LONGEST {
            return Err(io::ErrorKind::InvalidData.into());
        }
        if rest.len() < message + bytes {
            return Ok(None);
        }
        let (text, rest) = rest.split_at(message);
        let taken = (serde_json::from_slice(text)?, rest[..bytes].to_vec());
        self.buffer.drain(..HEAD + message + bytes);
        Ok(Some(taken))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_come_out_as_they_went_in_however_they_are_cut() {
        let sent = [("first", vec![]), ("second", vec![7; 100_000]), ("third", b"{}\n".to_vec())];
        let mut stream = Vec::new();
        for (message, bytes) in &sent {
            write(&mut stream, message, bytes).unwrap();
        }
        let mut input = stream.as_slice();
        for (message, bytes) in &sent {
            assert_eq!(read::<String>(&mut input).unwrap().unwrap(), ((*message).to_owned(), bytes.clone()));
        }
        assert!(read::<String>(&mut input).unwrap().is_none());
        for piece in [1, 13, 4096, stream.len()] {
            let (mut decoder, mut taken) = (Decoder::default(), Vec::new());
            for bytes in stream.chunks(piece) {
                decoder.buffer.extend_from_slice(bytes);
                while let Some((message, bytes)) = decoder.take::<String>().unwrap() {
                    taken.push((message, bytes));
                }
            }
            assert!(taken.iter().map(|(message, bytes)| (message.as_str(), bytes.clone())).eq(sent.clone()));
        }
    }

    #[test]
    fn what_is_no_message_is_refused() {
        assert!(read::<String>(&mut &b"GET /solve HTTP/1.1\r\n"[..]).is_err());
        let mut decoder = Decoder { buffer: b"\x02\0\0\0\0\0\0\0{]".to_vec() };
        assert!(decoder.take::<String>().is_err());
        // A frame of excessive length is refused at once, since it would never be complete.
        let mut decoder = Decoder { buffer: b"\x02\0\0\0\xff\xff\xff\xff".to_vec() };
        assert!(decoder.take::<String>().is_err());
    }
}
