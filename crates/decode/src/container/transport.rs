//! MPEG transport streams (ITU-T H.222.0): packets of 188 bytes, of which those of one video stream are picked. Blu-ray's and
//! camcorders' m2ts put four bytes before each.

use std::fs::File;
use std::io::{BufReader, Read, Seek};

use super::{Geometry, Packet, ParameterSets, Setup, Stamps, VideoTrack};
use crate::error::{DecodeError, Result};
use crate::limits::{LARGEST_PACKET, check_frames};
use crate::timeline::Timeline;
use crate::upright::Orientation;

/// Bytes of a packet, and its first one.
const SIZE: usize = 188;
const SYNC: u8 = 0x47;
/// Ticks of the clock, a second, and bits after which it begins anew.
const CLOCK: f64 = 90_000.0;
const WRAPS: i64 = 1 << 33;
/// Most bytes before the tables that name the video stream.
const LATEST_TABLES: u64 = 1 << 24;
/// Bytes of a PES header before its optional part ends.
const PES: usize = 9;

/// How the bytes of one stream lie in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Transport {
    /// Bytes before each packet.
    before: usize,
    stream: u16,
}

/// Bytes before each packet of a file that begins like a transport stream; none if it is none.
pub(super) fn bytes_before(first: &[u8]) -> Option<usize> {
    let at = |place: usize| first.get(place) == Some(&SYNC);
    [0, 4].into_iter().find(|&before| at(before) && at(2 * before + SIZE) && at(3 * before + 2 * SIZE))
}

/// Reads a file and finds the frames of its first video stream.
pub(super) fn read(file: &mut BufReader<File>, before: usize) -> Result<VideoTrack> {
    let mut found = TransportTrack::default();
    let mut packet = vec![0; before + SIZE];
    let mut place = 0;
    file.rewind()?;
    while filled(file, &mut packet)? {
        found.packet(place, before, &packet[before..])?;
        place += packet.len() as u64;
        if found.video.is_none() && place > LATEST_TABLES {
            break;
        }
    }
    let (stream, setup) =
        found.video.ok_or_else(|| DecodeError::corrupt("it has no table that names a video stream"))?;
    let mut packets = found.packets;
    if let Some(last) = packets.last_mut() {
        last.size = place - last.offset;
    }
    Ok(VideoTrack {
        container: "mpegts",
        setup,
        packets,
        timeline: Timeline::whole(CLOCK),
        stamps: Stamps::Presentation,
        geometry: Geometry { pixel_aspect: None, orientation: Orientation::UPRIGHT },
        colour: Default::default(),
        interlaced: None,
        claimed_rate: None,
        capture_rate: None,
        tags: Vec::new(),
        notes: Vec::new(),
        prefix: Vec::new(),
        transport: Some(Transport { before, stream }),
    })
}

/// Fills the buffer; false at the end of the file.
fn filled(file: &mut BufReader<File>, buffer: &mut [u8]) -> Result<bool> {
    match file.read_exact(buffer) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error.into()),
    }
}

#[derive(Default)]
struct TransportTrack {
    /// Stream that holds the table of the programme.
    programme: Option<u16>,
    video: Option<(u16, Setup)>,
    packets: Vec<Packet>,
    /// Stamp of the frame before, without wraps.
    last: Option<i64>,
}

impl TransportTrack {
    fn packet(&mut self, place: u64, before: usize, packet: &[u8]) -> Result<()> {
        let Some((stream, starts, payload)) = payload(packet) else { return Ok(()) };
        match (&self.programme, &self.video) {
            (None, _) if stream == 0 && starts => self.programme = programme(payload),
            (Some(table), None) if stream == *table && starts => self.video = video(payload),
            (_, Some((video, _))) if stream == *video && starts => {
                if let Some(last) = self.packets.last_mut() {
                    last.size = place - last.offset;
                    if last.size > LARGEST_PACKET {
                        return Err(DecodeError::too_large(format!("a frame takes {} bytes", last.size)));
                    }
                }
                let stamp = self.stamp(payload)?;
                self.packets.push(Packet { offset: place, size: (before + SIZE) as u64, stamp, sync: false });
                check_frames(self.packets.len())?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Presentation time of a frame, ticks; its clock's wraps are undone.
    fn stamp(&mut self, pes: &[u8]) -> Result<i64> {
        let number = self.packets.len();
        let missing = || DecodeError::corrupt(format!("frame {number} of its stream has no time stamp"));
        let stamp = match pes {
            [0, 0, 1, _, _, _, _, flags, _, a, b, c, d, e, ..] if flags & 0x80 != 0 => {
                let [a, b, c, d, e] = [a, b, c, d, e].map(|byte| i64::from(*byte));
                (a >> 1 & 7) << 30 | b << 22 | (c >> 1) << 15 | d << 7 | e >> 1
            }
            _ => return Err(missing()),
        };
        let near = self.last.unwrap_or(stamp);
        let unwrapped = stamp + ((near - stamp) as f64 / WRAPS as f64).round() as i64 * WRAPS;
        self.last = Some(unwrapped);
        Ok(unwrapped)
    }
}

/// Stream, whether a unit starts, and the payload of a packet; none of one without.
fn payload(packet: &[u8]) -> Option<(u16, bool, &[u8])> {
    let [SYNC, high, low, control, rest @ ..] = packet else { return None };
    let stream = u16::from_be_bytes([high & 0x1f, *low]);
    let payload = match control >> 4 & 3 {
        1 => rest,
        // An adaptation field and its length come first.
        3 => rest.get(1 + usize::from(*rest.first()?)..)?,
        _ => return None,
    };
    Some((stream, high & 0x40 != 0, payload))
}

/// The section of a table, from its first byte on, without its checksum.
fn section(payload: &[u8], table: u8) -> Option<&[u8]> {
    let section = payload.get(1 + usize::from(*payload.first()?)..)?;
    let [kind, high, low, ..] = section else { return None };
    let length = usize::from(u16::from_be_bytes([high & 0x0f, *low]));
    (*kind == table).then(|| &section[..(3 + length).saturating_sub(4).min(section.len())])
}

/// Stream of the first programme's table.
fn programme(payload: &[u8]) -> Option<u16> {
    let entries = section(payload, 0)?.get(8..)?;
    let programme = entries.chunks_exact(4).find(|entry| entry[..2] != [0, 0])?;
    Some(u16::from_be_bytes([programme[2] & 0x1f, programme[3]]))
}

/// The first video stream of a programme.
fn video(payload: &[u8]) -> Option<(u16, Setup)> {
    let table = section(payload, 2)?;
    let length = |at: usize| Some(usize::from(u16::from_be_bytes([table.get(at)? & 0x0f, *table.get(at + 1)?])));
    let mut at = 12 + length(10)?;
    while let Some([kind, high, low]) = table.get(at..at + 3) {
        let stream = u16::from_be_bytes([high & 0x1f, *low]);
        let setup = match kind {
            0x1b => Some(Setup::H264(ParameterSets::default())),
            0x24 => Some(Setup::Hevc(ParameterSets::default())),
            0x01 | 0x02 => Some(Setup::Other("MPEG-2".into())),
            0x10 => Some(Setup::Other("MPEG-4 part 2".into())),
            0xea => Some(Setup::Other("VC-1".into())),
            _ => None,
        };
        if let Some(setup) = setup {
            return Some((stream, setup));
        }
        at += 5 + length(at + 3)?;
    }
    None
}

impl Transport {
    /// Bytes of a frame among those of its range of the file.
    pub(crate) fn frame(self, range: &[u8]) -> Vec<u8> {
        let mut frame = Vec::with_capacity(range.len());
        for packet in range.chunks_exact(self.before + SIZE) {
            if let Some((stream, starts, payload)) = payload(&packet[self.before..])
                && stream == self.stream
            {
                let header = if starts { PES + payload.get(PES - 1).map_or(0, |more| usize::from(*more)) } else { 0 };
                frame.extend_from_slice(payload.get(header..).unwrap_or_default());
            }
        }
        frame
    }

    /// Whole packets that hold so many bytes of a frame, nearly.
    pub(crate) fn range(self, bytes: u64) -> u64 {
        bytes.div_ceil(SIZE as u64) * (self.before + SIZE) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_adaptation_field_is_skipped_and_other_streams_are_left_out() {
        let packet = |stream: u16, starts: bool, stuffing: usize, fill: u8| {
            let mut packet =
                vec![SYNC, (stream >> 8) as u8 | u8::from(starts) << 6, stream as u8, 0x30, stuffing as u8];
            packet.extend(vec![0xff; stuffing]);
            packet.resize(SIZE, fill);
            packet
        };
        let transport = Transport { before: 0, stream: 0x100 };
        let range = [packet(0x100, false, 80, 7), packet(0x101, false, 0, 9), packet(0x100, false, 182, 5)].concat();
        assert_eq!(transport.frame(&range), [vec![7; 103], vec![5; 1]].concat());
    }

    #[test]
    fn the_clock_may_begin_anew() {
        let pes = |stamp: i64| {
            let part = |shift: i64, mask: i64| (stamp >> shift & mask) as u8;
            let stamp =
                [part(30, 7) << 1 | 0x21, part(22, 255), part(15, 127) << 1 | 1, part(7, 255), part(0, 127) << 1 | 1];
            [&[0, 0, 1, 0xe0, 0, 0, 0x80, 0x80, 5][..], &stamp].concat()
        };
        let mut found = TransportTrack::default();
        assert_eq!(found.stamp(&pes(WRAPS - 900)).unwrap(), WRAPS - 900);
        assert_eq!(found.stamp(&pes(2700)).unwrap(), WRAPS + 2700);
        assert_eq!(found.stamp(&pes(900)).unwrap(), WRAPS + 900);
        assert!(found.stamp(&[0, 0, 1, 0xe0, 0, 0, 0x80, 0, 0]).is_err());
    }
}
