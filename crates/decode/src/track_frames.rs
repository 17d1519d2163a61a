//! The frames of a track that is decoded here.

use std::fs::File;
use std::io::BufReader;
use std::sync::Arc;
use std::vec::IntoIter;

use crate::codec::{PacketRole, StreamFacts, check_same, decoder};
use crate::error::{DecodeError, Result};
use crate::frame::{Frame, Presentation};
use crate::index::Index;
use crate::limits::check_size;
use crate::picture::DecodedPicture;
use crate::stream::Sink;

/// Decodes the first frame: its size and depth, and what the stream states.
///
/// # Errors
/// Damage; a codec, or a tool of one, that is not decoded here.
pub(crate) fn probe(index: &Index, file: &mut BufReader<File>) -> Result<(DecodedPicture, StreamFacts)> {
    let mut decoder = decoder(&index.track.setup)?;
    let first = index.roles.iter().position(|role| *role != PacketRole::Hidden).unwrap_or(0);
    let mut ready = Vec::new();
    for packet in index.track.packets.iter().take(first + 1) {
        decoder.push(&index.packet(file, packet)?, &mut ready)?;
    }
    decoder.finish(&mut ready)?;
    let picture = ready.into_iter().next().ok_or_else(|| DecodeError::corrupt("its first frame is missing"))?;
    let (width, height) = picture.size();
    check_size(width, height)?;
    Ok((picture, decoder.facts()))
}

/// Decodes the frames from a display number on.
///
/// # Errors
/// Damage, with the frame at which it was found.
pub(crate) fn decode(
    index: &Index,
    mut file: BufReader<File>,
    display: &Arc<Presentation>,
    from: usize,
    sink: &Sink,
) -> Result<()> {
    let entry = index.entry(from);
    let mut order = Order { index, display, given: index.given(entry).into_iter(), next: from, size: None };
    let mut decoder = decoder(&index.track.setup)?;
    let mut ready = Vec::new();
    for (number, packet) in index.track.packets.iter().enumerate().skip(entry) {
        if order.next == index.times.len() {
            return Ok(());
        }
        let mut push = || {
            decoder.push(&index.packet(&mut file, packet)?, &mut ready)?;
            order.send(&mut ready, sink)
        };
        if !push().map_err(|error| at_frame(index, index.numbers[number], error))? {
            return Ok(());
        }
    }
    decoder.finish(&mut ready)?;
    if order.send(&mut ready, sink)? && order.next < index.times.len() {
        return Err(at_frame(index, Some(order.next), DecodeError::corrupt("it is missing")));
    }
    Ok(())
}

fn at_frame(index: &Index, number: Option<usize>, error: DecodeError) -> DecodeError {
    match number {
        Some(number) => DecodeError::at_frame(number, Some(index.times[number]), error),
        None => error,
    }
}

/// Gives pictures their times.
struct Order<'a> {
    index: &'a Index,
    display: &'a Arc<Presentation>,
    /// Packets whose pictures are to come, by their time stamps. Pictures come in the codec's order of display, and the first
    /// gets the earliest stamp: where the stamps contradict the codec (times of decoding, equal ones, damage), it is right.
    given: IntoIter<usize>,
    /// Display number of the next frame to be sent.
    next: usize,
    size: Option<(u32, u32)>,
}

impl Order<'_> {
    /// Sends what is shown. False once nobody wants more.
    fn send(&mut self, ready: &mut Vec<DecodedPicture>, sink: &Sink) -> Result<bool> {
        for picture in ready.drain(..) {
            let more = || DecodeError::corrupt("it gives more frames than its index states");
            let packet = self.given.next().ok_or_else(more)?;
            check_same(&mut self.size, picture.size())?;
            let Some(number) = self.index.numbers[packet].filter(|number| *number >= self.next) else { continue };
            self.next = number + 1;
            let (seconds, display) = (Some(self.index.times[number]), self.display.clone());
            if !sink.send(Frame { number, seconds, picture, display, field: None }) {
                return Ok(false);
            }
        }
        Ok(true)
    }
}
