//! Which packet gives which frame of the display order, and where decoding can begin.

use std::fs::File;
use std::io::BufReader;

use crate::bytes::read_at;
use crate::codec::{ROLE_BYTES, Role, role};
use crate::container::{Packet, Setup, Track};
use crate::error::{Error, Result};

/// A video track and the order of its frames.
#[derive(Debug)]
pub(crate) struct Index {
    pub track: Track,
    /// Of each packet.
    pub roles: Vec<Role>,
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
    pub(crate) fn new(track: Track, file: &mut BufReader<File>) -> Result<Self> {
        let roles = roles(&track, file)?;
        let mut shown: Vec<(f64, usize)> = Vec::new();
        let mut entries = 0;
        for (number, (packet, role)) in track.packets.iter().zip(&roles).enumerate() {
            entries += usize::from(*role == Role::Entry);
            // Leading pictures of the first entry refer to frames before the video's beginning.
            let is_given = match role {
                Role::Hidden => false,
                Role::Leading => entries > 1,
                Role::Entry | Role::Picture => true,
            };
            let time = track.timeline.seconds(packet.stamp).filter(|_| is_given);
            shown.extend(time.map(|time| (time, number)));
        }
        if shown.is_empty() {
            let packets = track.packets.len();
            let what =
                if packets == 0 { "it has no frames".into() } else { format!("none of its {packets} frames is shown") };
            return Err(Error::corrupt(what));
        }
        shown.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
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
        self.roles[..=earliest].iter().rposition(|role| *role == Role::Entry).unwrap_or(0)
    }

    /// The bytes of a packet.
    pub(crate) fn packet(&self, file: &mut BufReader<File>, packet: &Packet) -> Result<Vec<u8>> {
        let bytes = read_at(file, packet.offset, packet.size)?;
        Ok(if self.track.prefix.is_empty() { bytes } else { [&self.track.prefix[..], &bytes].concat() })
    }
}

fn roles(track: &Track, file: &mut BufReader<File>) -> Result<Vec<Role>> {
    let by_mark = matches!(track.setup, Setup::Av1 | Setup::Mjpeg | Setup::Other(_));
    let mut roles = Vec::with_capacity(track.packets.len());
    for packet in &track.packets {
        let first = if by_mark { Vec::new() } else { read_at(file, packet.offset, packet.size.min(ROLE_BYTES))? };
        let first = if track.prefix.is_empty() { first } else { [&track.prefix[..], &first].concat() };
        roles.push(role(&track.setup, &first, packet.sync));
    }
    Ok(roles)
}
