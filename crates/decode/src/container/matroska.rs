//! Matroska and WebM (RFC 9559): clusters of blocks, each with its presentation time.

use std::fs::File;
use std::io::BufReader;

use super::ebml::{Element, Head, LONGEST_HEAD, elements, find, float, head, number, unsigned};
use super::{Geometry, Packet, ParameterSets, Setup, Stamps, VideoTrack, mp4_entry};
use crate::bytes::{big_endian, read_at};
use crate::colour::Tags;
use crate::error::{DecodeError, Result, printable};
use crate::info::Fields;
use crate::limits::{LARGEST_DESCRIPTION, LARGEST_PACKET, check_frames};
use crate::timeline::Timeline;
use crate::upright::Orientation;

const SEGMENT: u32 = 0x1853_8067;
const INFO: u32 = 0x1549_a966;
const TIMESTAMP_SCALE: u32 = 0x2a_d7b1;
const TRACKS: u32 = 0x1654_ae6b;
const TRACK_ENTRY: u32 = 0xae;
const TRACK_NUMBER: u32 = 0xd7;
const TRACK_TYPE: u32 = 0x83;
const CODEC_ID: u32 = 0x86;
const CODEC_PRIVATE: u32 = 0x63a2;
const DEFAULT_DURATION: u32 = 0x23_e383;
const VIDEO: u32 = 0xe0;
const CONTENT_ENCODINGS: u32 = 0x6d80;
const CONTENT_ENCODING: u32 = 0x6240;
const CONTENT_COMPRESSION: u32 = 0x5034;
const CONTENT_ALGORITHM: u32 = 0x4254;
const CONTENT_SETTINGS: u32 = 0x4255;
const CLUSTER: u32 = 0x1f43_b675;
const TIMESTAMP: u32 = 0xe7;
const SIMPLE_BLOCK: u32 = 0xa3;
const BLOCK_GROUP: u32 = 0xa0;
const BLOCK: u32 = 0xa1;
const REFERENCE: u32 = 0xfb;
/// Nanoseconds of a tick, where it is not stated.
const USUAL_TICK: u64 = 1_000_000;
/// Header stripping among the algorithms of compression.
const STRIPPING: u64 = 3;
/// Most bytes that are stored once and precede each frame; they are copied for each.
const LONGEST_PREFIX: usize = 1024;

/// Reads the tracks and finds the blocks of the first video track.
pub(super) fn read(file: &mut BufReader<File>, length: u64) -> Result<VideoTrack> {
    let mut found = MatroskaTrack::default();
    found.walk(file, length)?;
    let mut track = found.track.ok_or_else(|| DecodeError::corrupt("it has no video track"))?;
    track.packets = found.packets;
    track.timeline = Timeline::whole(1e9 / found.tick.unwrap_or(USUAL_TICK) as f64);
    Ok(track)
}

#[derive(Default)]
struct MatroskaTrack {
    tick: Option<u64>,
    number: u64,
    track: Option<VideoTrack>,
    packets: Vec<Packet>,
    /// Time of the cluster, ticks.
    cluster: i64,
}

impl MatroskaTrack {
    /// Visits the elements of the file; what lies in segments, clusters and groups of blocks is visited in place.
    fn walk(&mut self, file: &mut BufReader<File>, length: u64) -> Result<()> {
        let mut at = 0;
        while at < length {
            let bytes = read_at(file, at, LONGEST_HEAD.min(length - at))?;
            let Ok(Head { id, length: start, size }) = head(&bytes) else {
                // Rubbish after the last cluster is no concern of the video's.
                return if self.packets.is_empty() { head(&bytes).map(drop) } else { Ok(()) };
            };
            let payload = at + start;
            let open = [SEGMENT, CLUSTER, BLOCK_GROUP].contains(&id);
            let end = match size {
                Some(size) => payload.saturating_add(size),
                None if open => payload,
                None => return Err(DecodeError::corrupt("an element of unknown size cannot be read")),
            };
            match id {
                SEGMENT | CLUSTER => {}
                BLOCK_GROUP => {
                    let size = end.min(length) - payload;
                    self.group(file, payload, size)?;
                }
                INFO | TRACKS | TIMESTAMP => {
                    let size = end - payload;
                    if size > LARGEST_DESCRIPTION {
                        return Err(DecodeError::too_large(format!("its description claims {size} bytes")));
                    }
                    self.describe(id, &read_at(file, payload, size)?)?;
                }
                SIMPLE_BLOCK => self.block(file, payload, end - payload, None)?,
                _ => {}
            }
            at = if id == SEGMENT || id == CLUSTER { payload } else { end };
        }
        Ok(())
    }

    fn describe(&mut self, id: u32, payload: &[u8]) -> Result<()> {
        match id {
            TIMESTAMP => self.cluster = i64::try_from(big_endian(payload)).unwrap_or(i64::MAX),
            INFO => self.tick = unsigned(payload, TIMESTAMP_SCALE).filter(|tick| *tick > 0).or(self.tick),
            _ if self.track.is_none() => {
                let is_video = |it: &Element| it.id == TRACK_ENTRY && unsigned(it.payload, TRACK_TYPE) == Some(1);
                if let Some(entry) = elements(payload).find(is_video) {
                    self.number = unsigned(entry.payload, TRACK_NUMBER).unwrap_or(0);
                    self.track = Some(track(entry.payload)?);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// A group holds one block and says whether it depends on others.
    fn group(&mut self, file: &mut BufReader<File>, start: u64, size: u64) -> Result<()> {
        let (mut at, mut block, mut depends) = (start, None, false);
        while at < start + size {
            let bytes = read_at(file, at, LONGEST_HEAD.min(start + size - at))?;
            let Head { id, length, size: inner } = head(&bytes)?;
            let inner = inner.ok_or_else(|| DecodeError::corrupt("a block of unknown size cannot be read"))?;
            match id {
                BLOCK => block = Some((at + length, inner)),
                REFERENCE => depends = true,
                _ => {}
            }
            at = at.saturating_add(length).saturating_add(inner);
        }
        match block {
            Some((place, size)) => self.block(file, place, size, Some(!depends)),
            None => Ok(()),
        }
    }

    /// A block: number of its track, time since the cluster's, flags, then one frame.
    fn block(&mut self, file: &mut BufReader<File>, place: u64, size: u64, sync: Option<bool>) -> Result<()> {
        if size > LARGEST_PACKET {
            return Err(DecodeError::too_large(format!("frame {} claims {size} bytes", self.packets.len())));
        }
        let bytes = read_at(file, place, size.min(LONGEST_HEAD))?;
        let (track, length) = number(&bytes, false).ok_or_else(|| DecodeError::corrupt("a block is damaged"))?;
        let rest = bytes.get(length..length + 3).ok_or_else(|| DecodeError::corrupt("a block is damaged"))?;
        if track != self.number || self.track.is_none() {
            return Ok(());
        }
        let since = i16::from_be_bytes([rest[0], rest[1]]);
        let flags = rest[2];
        if flags & 6 != 0 {
            return Err(DecodeError::unsupported("a Matroska video with several frames in a block"));
        }
        let head = length as u64 + 3;
        let stamp = self.cluster.saturating_add(since.into());
        let sync = sync.unwrap_or(flags & 0x80 != 0);
        if size > head {
            self.packets.push(Packet { offset: place + head, size: size - head, stamp, sync });
        }
        check_frames(self.packets.len())
    }
}

/// Reads a track's entry; its blocks are found later.
fn track(entry: &[u8]) -> Result<VideoTrack> {
    let video = find(entry, VIDEO).ok_or_else(|| DecodeError::corrupt("its video track has no size"))?;
    let side = |id: u32| unsigned(video, id).and_then(|side| u32::try_from(side).ok()).unwrap_or(0);
    let size = (side(0xb0), side(0xba));
    let id = String::from_utf8_lossy(find(entry, CODEC_ID).unwrap_or_default()).into_owned();
    let rate = unsigned(entry, DEFAULT_DURATION).filter(|duration| *duration > 0).map(|it| 1e9 / it as f64);
    if projection(video) {
        return Err(DecodeError::unsupported("a Matroska video with a projection or a roll"));
    }
    Ok(VideoTrack {
        container: "matroska",
        setup: setup(&id, find(entry, CODEC_PRIVATE).unwrap_or_default())?,
        packets: Vec::new(),
        timeline: Timeline::whole(1000.0),
        stamps: Stamps::Presentation,
        geometry: Geometry { pixel_aspect: aspect(video, size), orientation: Orientation::UPRIGHT },
        colour: colour(video),
        interlaced: fields(video),
        claimed_rate: rate,
        capture_rate: None,
        tags: Vec::new(),
        notes: Vec::new(),
        prefix: prefix(entry)?,
        transport: None,
    })
}

fn setup(id: &str, private: &[u8]) -> Result<Setup> {
    let in_band = private.is_empty();
    Ok(match id {
        "V_MPEG4/ISO/AVC" if in_band => Setup::H264(ParameterSets::default()),
        "V_MPEG4/ISO/AVC" => Setup::H264(mp4_entry::avc(private)?),
        "V_MPEGH/ISO/HEVC" if in_band => Setup::Hevc(ParameterSets::default()),
        "V_MPEGH/ISO/HEVC" => Setup::Hevc(mp4_entry::hevc(private)?),
        "V_VP8" => Setup::Vp8,
        "V_VP9" => Setup::Vp9,
        "V_AV1" => Setup::Av1,
        "V_MJPEG" => Setup::Mjpeg,
        other => Setup::Other(printable(other)),
    })
}

/// Bytes stripped off each frame, or none.
fn prefix(entry: &[u8]) -> Result<Vec<u8>> {
    let Some(encodings) = find(entry, CONTENT_ENCODINGS) else { return Ok(Vec::new()) };
    let mut prefix = Vec::new();
    for encoding in elements(encodings).filter(|it| it.id == CONTENT_ENCODING) {
        let stripped = find(encoding.payload, CONTENT_COMPRESSION)
            .filter(|it| unsigned(it, CONTENT_ALGORITHM).unwrap_or(0) == STRIPPING)
            .ok_or_else(|| DecodeError::unsupported("a compressed or encrypted Matroska track"))?;
        prefix = [find(stripped, CONTENT_SETTINGS).unwrap_or_default(), &prefix].concat();
        if prefix.len() > LONGEST_PREFIX {
            return Err(DecodeError::too_large(format!("{} bytes precede each of its frames", prefix.len())));
        }
    }
    Ok(prefix)
}

/// Shown width of a pixel over its height: the size of display over the size stored, cropped.
fn aspect(video: &[u8], size: (u32, u32)) -> Option<f64> {
    let side = |id: u32| unsigned(video, id).map(|side| side as f64);
    let crop = |ids: [u32; 2]| ids.into_iter().filter_map(side).sum::<f64>();
    let (width, height) = (f64::from(size.0) - crop([0x54cc, 0x54dd]), f64::from(size.1) - crop([0x54aa, 0x54bb]));
    let aspect = side(0x54b0)? / side(0x54ba)? * height / width;
    (aspect.is_finite() && aspect > 0.0).then_some(aspect)
}

fn colour(video: &[u8]) -> Tags {
    let Some(colour) = find(video, 0x55b0) else { return Tags::default() };
    let code = |id: u32| unsigned(colour, id).and_then(|code| u8::try_from(code).ok()).unwrap_or(2);
    let mut tags = Tags::of_codes(code(0x55bb), code(0x55ba), code(0x55b1));
    tags.full_range = match unsigned(colour, 0x55b9) {
        Some(1) => Some(false),
        Some(2) => Some(true),
        _ => None,
    };
    tags
}

fn fields(video: &[u8]) -> Option<Fields> {
    (unsigned(video, 0x9a) == Some(1)).then(|| match unsigned(video, 0x9d) {
        Some(1 | 9) => Fields::TopFirst,
        Some(6 | 14) => Fields::BottomFirst,
        _ => Fields::Unknown,
    })
}

/// Whether frames are to be turned or projected before they are shown.
fn projection(video: &[u8]) -> bool {
    let Some(projection) = find(video, 0x7670) else { return false };
    let turned = |id: u32| float(projection, id).is_some_and(|angle| angle != 0.0);
    unsigned(projection, 0x7671).unwrap_or(0) != 0 || [0x7673, 0x7674, 0x7675].into_iter().any(turned)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An element with a size of four bytes.
    fn element(id: u32, payload: &[u8]) -> Vec<u8> {
        let id = id.to_be_bytes();
        let id = &id[id.iter().position(|byte| *byte != 0).unwrap()..];
        [id, &(0x1000_0000 | payload.len() as u32).to_be_bytes(), payload].concat()
    }

    #[test]
    fn stripped_bytes_precede_each_frame_if_they_are_few() {
        let encoding = |bytes: &[u8]| {
            let settings = [element(CONTENT_ALGORITHM, &[STRIPPING as u8]), element(CONTENT_SETTINGS, bytes)].concat();
            element(CONTENT_ENCODING, &element(CONTENT_COMPRESSION, &settings))
        };
        let entry = |encodings: &[u8]| element(CONTENT_ENCODINGS, encodings);
        assert_eq!(prefix(&entry(&[encoding(&[2]), encoding(&[1])].concat())).unwrap(), [1, 2]);
        let many = encoding(&[7; 100]).repeat(11);
        assert!(matches!(prefix(&entry(&many)), Err(DecodeError::TooLarge { .. })));
    }
}
