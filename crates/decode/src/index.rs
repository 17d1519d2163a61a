//! Which packet gives which frame of the display order, and where decoding can begin.

use std::fs::File;
use std::io::BufReader;

use crate::bytes::read_at;
use crate::codec::{PacketRole, ROLE_BYTES, role};
use crate::container::{Packet, Setup, VideoTrack};
use crate::error::{DecodeError, Result};

/// A video track and the order of its frames.
#[derive(Debug)]
pub(crate) struct Index {
    pub track: VideoTrack,
    /// Of each packet.
    pub roles: Vec<PacketRole>,
    /// Display number of each packet's frame; none of one that is not shown.
    pub numbers: Vec<Option<usize>>,
    /// Presentation times in display order, seconds since the first.
    pub times: Vec<f64>,
    /// Presentation time of the first frame, seconds.
    pub start: f64,
}

impl Index {
    /// # Errors
    /// A track without frames, and one whose edit list hides all.
    pub(crate) fn new(track: VideoTrack, file: &mut BufReader<File>) -> Result<Self> {
        let roles = roles(&track, file)?;
        let given = given(&track, &roles, 0);
        let time = |packet: usize| track.timeline.seconds(track.packets[packet].stamp).map(|time| (time, packet));
        let mut shown: Vec<_> = given.into_iter().filter_map(time).collect();
        if shown.is_empty() {
            let packets = track.packets.len();
            let what =
                if packets == 0 { "it has no frames".into() } else { format!("none of its {packets} frames is shown") };
            return Err(DecodeError::corrupt(what));
        }
        // Pieces of an edit list are in ascending order: this changes nothing but rounding.
        shown.sort_by(|a, b| a.0.total_cmp(&b.0));
        let start = shown[0].0;
        let mut numbers = vec![None; track.packets.len()];
        shown.iter().enumerate().for_each(|(number, (_, packet))| numbers[*packet] = Some(number));
        let times = shown.iter().map(|(time, _)| time - start).collect();
        Ok(Index { track, roles, numbers, times, start })
    }

    /// The last packet at which decoding can begin so that nothing is missing from a display number on.
    pub(crate) fn entry(&self, number: usize) -> usize {
        let is_wanted = |found: &Option<usize>| found.is_some_and(|found| found >= number);
        // Frames that are shown from the wanted one on may be coded before it.
        let earliest = self.numbers.iter().position(is_wanted).unwrap_or(0);
        self.roles[..=earliest].iter().rposition(|role| *role == PacketRole::Entry).unwrap_or(0)
    }

    /// The packets that give pictures if decoding begins with an entry, in the order of their time stamps.
    pub(crate) fn given(&self, entry: usize) -> Vec<usize> {
        given(&self.track, &self.roles, entry)
    }

    /// The bytes of a packet.
    pub(crate) fn packet(&self, file: &mut BufReader<File>, packet: &Packet) -> Result<Vec<u8>> {
        let bytes = read_at(file, packet.offset, packet.size)?;
        if let Some(transport) = self.track.transport {
            return Ok(transport.frame(&bytes));
        }
        Ok(if self.track.prefix.is_empty() { bytes } else { [&self.track.prefix[..], &bytes].concat() })
    }
}

fn given(track: &VideoTrack, roles: &[PacketRole], entry: usize) -> Vec<usize> {
    let mut entries = 0;
    let is_given = |packet: &usize| {
        entries += usize::from(roles[*packet] == PacketRole::Entry);
        match roles[*packet] {
            PacketRole::Hidden => false,
            // Those of the first entry refer to frames before it.
            PacketRole::Leading => entries > 1,
            PacketRole::Entry | PacketRole::Picture => true,
        }
    };
    let mut given: Vec<_> = (entry..roles.len()).filter(is_given).collect();
    given.sort_by_key(|&packet| track.packets[packet].stamp);
    given
}

fn roles(track: &VideoTrack, file: &mut BufReader<File>) -> Result<Vec<PacketRole>> {
    let by_mark = matches!(track.setup, Setup::Av1 | Setup::Mjpeg | Setup::Other(_));
    let mut roles = Vec::with_capacity(track.packets.len());
    for packet in &track.packets {
        let looked_at = track.transport.map_or(ROLE_BYTES, |transport| transport.range(ROLE_BYTES));
        let first = if by_mark { Vec::new() } else { read_at(file, packet.offset, packet.size.min(looked_at))? };
        let first = track.transport.map_or(first.clone(), |transport| transport.frame(&first));
        let first = if track.prefix.is_empty() { first } else { [&track.prefix[..], &first].concat() };
        roles.push(role(&track.setup, &first, packet.sync));
    }
    Ok(roles)
}
