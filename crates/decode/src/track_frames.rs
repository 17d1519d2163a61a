//! The frames of a track that is decoded here.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::BufReader;
use std::sync::Arc;

use crate::codec::{Decoded, Facts, Role, decoder};
use crate::container::Stamps;
use crate::error::{Error, Result};
use crate::frame::{Display, Frame};
use crate::index::Index;
use crate::limits::{MOST_WAITING, check_size};
use crate::picture::Picture;
use crate::stream::Sink;

/// Decodes the first frame: its size and depth, and what the stream states.
///
/// # Errors
/// Damage; a codec, or a tool of one, that is not decoded here.
pub(crate) fn probe(index: &Index, file: &mut BufReader<File>) -> Result<(Picture, Facts)> {
    let mut decoder = decoder(&index.track.setup)?;
    let first = index.roles.iter().position(|role| *role != Role::Hidden).unwrap_or(0);
    let mut ready = Vec::new();
    for (number, packet) in index.track.packets.iter().enumerate().take(first + 1) {
        decoder.push(&index.packet(file, packet)?, number, &mut ready)?;
    }
    decoder.finish(&mut ready)?;
    let picture = ready.into_iter().next().ok_or_else(|| Error::corrupt("its first frame is missing"))?.picture;
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
    display: &Arc<Display>,
    from: usize,
    sink: &Sink,
) -> Result<()> {
    let entry = index.entry(from);
    let mut order = Order {
        index,
        display,
        next: from,
        waiting: BTreeMap::new(),
        ties: BTreeMap::new(),
        pushed: VecDeque::new(),
        size: None,
    };
    let mut decoder = decoder(&index.track.setup)?;
    let mut ready = Vec::new();
    for (number, packet) in index.track.packets.iter().enumerate().skip(entry) {
        let mut push = || {
            if index.roles[number] != Role::Hidden {
                order.pushed.push_back(number);
            }
            decoder.push(&index.packet(&mut file, packet)?, number, &mut ready)?;
            order.take(&mut ready)
        };
        push().map_err(|error| at_frame(index, index.numbers[number], error))?;
        if !order.send(sink) || order.next == index.times.len() {
            return Ok(());
        }
    }
    decoder.finish(&mut ready)?;
    order.take(&mut ready)?;
    if order.send(sink) && order.next < index.times.len() {
        return Err(at_frame(index, Some(order.next), Error::corrupt("it is missing")));
    }
    Ok(())
}

fn at_frame(index: &Index, number: Option<usize>, error: Error) -> Error {
    match number {
        Some(number) => Error::at_frame(number, Some(index.times[number]), error),
        None => error,
    }
}

/// Puts pictures into display order and gives them their times.
struct Order<'a> {
    index: &'a Index,
    display: &'a Arc<Display>,
    /// Display number of the next frame to be sent.
    next: usize,
    waiting: BTreeMap<usize, Frame>,
    /// Frames so far of those that share a time, by the display number of the first.
    ties: BTreeMap<usize, usize>,
    /// Packets that are to give pictures, where their stamps are times of decoding.
    pushed: VecDeque<usize>,
    size: Option<(u32, u32)>,
}

impl Order<'_> {
    fn take(&mut self, ready: &mut Vec<Decoded>) -> Result<()> {
        for Decoded { picture, packet } in ready.drain(..) {
            let packet = match self.index.track.stamps {
                Stamps::Presentation => packet,
                // Pictures come in display order: the earliest time is that of the first.
                Stamps::Decoding => self.pushed.pop_front().unwrap_or(packet),
            };
            crate::codec::check_same(&mut self.size, picture.size())?;
            let Some(number) = self.index.numbers[packet].map(|number| self.in_tie(number)) else { continue };
            if number < self.next {
                continue;
            }
            let (seconds, display) = (Some(self.index.times[number]), self.display.clone());
            self.waiting.insert(number, Frame { number, seconds, picture, display });
        }
        if self.waiting.len() > MOST_WAITING {
            let next = self.next;
            return Err(Error::corrupt(format!(
                "frame {next} is missing, or the time stamps contradict the codec's order"
            )));
        }
        Ok(())
    }

    /// The display number of a frame among those of its very time: they are shown in the codec's order.
    fn in_tie(&mut self, number: usize) -> usize {
        let times = &self.index.times;
        let first = times.partition_point(|time| *time < times[number]);
        if times.get(first + 1) != Some(&times[first]) {
            return number;
        }
        let taken = self.ties.entry(first).or_insert(0);
        *taken += 1;
        first + *taken - 1
    }

    /// Sends what is next. False once nobody wants more.
    fn send(&mut self, sink: &Sink) -> bool {
        while let Some(frame) = self.waiting.remove(&self.next) {
            self.next += 1;
            if !sink.send(frame) {
                return false;
            }
        }
        true
    }
}
