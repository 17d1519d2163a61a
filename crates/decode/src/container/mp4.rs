//! mp4 and mov: the movie's description.

use std::fs::File;
use std::io::BufReader;

use super::boxes::{Box, boxes, find, find_path, full, need};
use super::mp4_entry::{self, SampleEntry};
use super::{Geometry, Packet, Setup, Stamps, VideoTrack, mp4_fragments, mp4_tables, mp4_tags};
use crate::bytes::{Bytes, big_endian, read_at};
use crate::error::{DecodeError, Result};
use crate::info::Note;
use crate::limits::LARGEST_DESCRIPTION;
use crate::timeline::{Edit, Timeline};
use crate::upright::Orientation;

/// Part by which the shown size may be off the stored one: a converter rounds sides to whole pixels.
const ROUNDED: f64 = 0.01;

/// Reads the description of the first video track.
pub(super) fn read(file: &mut BufReader<File>, length: u64) -> Result<VideoTrack> {
    let Described { movie, fragments } = described(file, length)?;
    let track = boxes(&movie)
        .filter(|it| it.name == *b"trak")
        .map(|it| it.payload)
        .find(|trak| handler(trak) == Some(*b"vide"))
        .ok_or_else(|| DecodeError::corrupt("it has no video track"))?;
    let media = need(track, b"mdia")?;
    let table =
        find_path(media, &[b"minf", b"stbl"]).ok_or_else(|| DecodeError::corrupt("it has no table of samples"))?;
    let entry = mp4_entry::read(need(table, b"stsd")?)?;
    let header = TrackHeader::read(need(track, b"tkhd")?)?;
    let ticks = clock(need(media, b"mdhd")?)?;
    let movie_header = need(&movie, b"mvhd")?;
    let mut samples = mp4_tables::samples(table, length)?;
    let in_fragments = !fragments.is_empty();
    if in_fragments {
        let defaults = mp4_fragments::Defaults::of(&movie, header.id)?;
        mp4_fragments::append(&mut samples, &fragments, &defaults, length)?;
    }
    let edits = match find_path(track, &[b"edts", b"elst"]) {
        // The list of a movie in fragments was written before most of them, and its durations miss them.
        Some(list) => edits(list, in_fragments)?,
        None => Vec::new(),
    };
    let timeline = Timeline::edited(ticks, clock(movie_header)?, &edits)?;
    let mut notes: Vec<_> =
        timeline.segments.iter().filter(|it| it.rate != 1.0).map(|it| Note::EditRate(it.rate)).collect();
    if timeline.segments.len() > 1 {
        notes.push(Note::Cuts(timeline.segments.len()));
    }
    let (orientation, stretch) = Orientation::of_matrix(header.matrix, movie_matrix(movie_header)?)?;
    let geometry = Geometry { pixel_aspect: pixel_aspect(&entry, header.shown, orientation, stretch), orientation };
    let tags = mp4_tags::read(&movie);
    let stamps = if samples.offsets_differ { Stamps::Presentation } else { Stamps::Decoding };
    let SampleEntry { setup, colour, interlaced, .. } = entry;
    // Codecs without reordering have one order.
    let reorders = matches!(setup, Setup::H264(_) | Setup::Hevc(_) | Setup::Other(_));
    let stamps = if reorders { stamps } else { Stamps::Presentation };
    Ok(VideoTrack {
        container: "mp4",
        claimed_rate: mean_rate(&samples.packets, ticks),
        capture_rate: mp4_tags::capture_rate(&tags),
        setup,
        packets: samples.packets,
        timeline,
        stamps,
        geometry,
        colour,
        interlaced,
        tags,
        notes,
        prefix: Vec::new(),
        transport: None,
    })
}

/// The boxes that describe the movie, and its fragments with their places in the file.
struct Described {
    movie: Vec<u8>,
    fragments: Vec<(u64, Vec<u8>)>,
}

fn described(file: &mut BufReader<File>, length: u64) -> Result<Described> {
    let (mut at, mut read, mut movie, mut fragments) = (0u64, 0u64, None, Vec::new());
    while at + 8 <= length {
        let header = read_at(file, at, (length - at).min(16))?;
        let (start, size) = match big_endian(&header[..4]) {
            0 => (8, length - at),
            1 if header.len() == 16 => (16, big_endian(&header[8..])),
            size => (8, size),
        };
        if size < start {
            // Zeros or rubbish after the last box.
            break;
        }
        let name = &header[4..8];
        if name == b"moov" || name == b"moof" {
            read = read.saturating_add(size);
            if read > LARGEST_DESCRIPTION {
                return Err(DecodeError::too_large(format!("its description claims {read} bytes")));
            }
            if at.saturating_add(size) > length {
                return Err(DecodeError::corrupt("it is cut off within its description"));
            }
            let payload = read_at(file, at + start, size - start)?;
            match name {
                b"moof" => fragments.push((at, payload)),
                _ => movie = movie.or(Some(payload)),
            }
        }
        at = at.saturating_add(size);
    }
    let movie = movie.ok_or_else(|| {
        DecodeError::corrupt(
            "it has no description of its frames (\"moov\"), which recorders write last: it is incomplete",
        )
    })?;
    if find(&movie, b"cmov").is_some() {
        return Err(DecodeError::unsupported("a mov with a compressed description"));
    }
    Ok(Described { movie, fragments })
}

fn handler(track: &[u8]) -> Option<[u8; 4]> {
    let payload = find_path(track, &[b"mdia", b"hdlr"])?;
    payload.get(8..12)?.try_into().ok()
}

/// Ticks a second of a movie or media header.
fn clock(header: &[u8]) -> Result<u32> {
    let (version, _, mut bytes) = full(header)?;
    bytes.take(if version == 1 { 16 } else { 8 })?;
    match bytes.u32()? {
        0 => Err(DecodeError::corrupt("its clock has no ticks")),
        ticks => Ok(ticks),
    }
}

/// The matrix of a movie header: nine numbers after rate, volume and reserved bytes.
fn movie_matrix(header: &[u8]) -> Result<[i32; 9]> {
    let (version, _, mut bytes) = full(header)?;
    bytes.take(if version == 1 { 28 } else { 16 } + 16)?;
    matrix(&mut bytes)
}

fn matrix(bytes: &mut Bytes) -> Result<[i32; 9]> {
    let mut matrix = [0; 9];
    for number in &mut matrix {
        *number = bytes.i32()?;
    }
    Ok(matrix)
}

/// A track's header.
struct TrackHeader {
    id: u32,
    matrix: [i32; 9],
    /// Width and height at which it is shown before it is turned, pixels.
    shown: [f64; 2],
}

impl TrackHeader {
    fn read(payload: &[u8]) -> Result<Self> {
        let (version, _, mut bytes) = full(payload)?;
        let wide = version == 1;
        bytes.take(if wide { 16 } else { 8 })?;
        let id = bytes.u32()?;
        // Reserved, duration, reserved, layer, group, volume, reserved.
        bytes.take(4 + if wide { 8 } else { 4 } + 16)?;
        let matrix = matrix(&mut bytes)?;
        let mut fixed = || Ok::<_, DecodeError>(f64::from(bytes.u32()?) / 65536.0);
        Ok(TrackHeader { id, matrix, shown: [fixed()?, fixed()?] })
    }
}

/// Shown width of a stored pixel over its height: a box states it, or the size at which the track is shown, or neither.
/// A matrix may stretch in addition.
fn pixel_aspect(entry: &SampleEntry, shown: [f64; 2], orientation: Orientation, stretch: f64) -> Option<f64> {
    let stored = [entry.size.0, entry.size.1].map(f64::from);
    let by_size = |shown: [f64; 2]| {
        let aspect = shown[0] * stored[1] / (shown[1] * stored[0]);
        (shown != stored && aspect.is_finite() && aspect > 0.0).then_some(aspect)
    };
    // Some writers state the upright size, not that before the turn.
    let square = |aspect: &f64| (aspect - 1.0).abs() <= ROUNDED;
    let upright = by_size([shown[1], shown[0]]).filter(|aspect| orientation.swaps_sides() && square(aspect));
    let swapped = orientation.swaps_sides() && shown == [stored[1], stored[0]];
    let by_size = if swapped { None } else { upright.or_else(|| by_size(shown)) };
    match entry.pixel_aspect.or(by_size) {
        None if stretch == 1.0 => None,
        aspect => Some(aspect.unwrap_or(1.0) * stretch),
    }
}

fn edits(payload: &[u8], without_durations: bool) -> Result<Vec<Edit>> {
    let (version, _, mut bytes) = full(payload)?;
    let count = bytes.u32()? as usize;
    let entry = if version == 1 { 20 } else { 12 };
    if count > bytes.0.len() / entry {
        return Err(DecodeError::corrupt(format!("its edit list claims {count} entries")));
    }
    (0..count)
        .map(|_| {
            let (duration, begin) = match version {
                1 => (bytes.u64()?, bytes.u64()? as i64),
                _ => (bytes.u32()?.into(), bytes.i32()?.into()),
            };
            let duration = if without_durations && begin >= 0 { 0 } else { duration };
            Ok(Edit { duration, begin, rate: bytes.i32()? })
        })
        .collect()
}

/// Frames a second by the mean of the decoding times.
fn mean_rate(packets: &[Packet], ticks: u32) -> Option<f64> {
    let stamps = packets.iter().map(|packet| packet.stamp);
    let span = stamps.clone().max()?.checked_sub(stamps.min()?)?;
    (span > 0).then(|| (packets.len() - 1) as f64 * f64::from(ticks) / span as f64)
}

/// Boxes of a name, for other readers of the description.
pub(super) fn all<'a>(payload: &'a [u8], name: &'static [u8; 4]) -> impl Iterator<Item = Box<'a>> {
    boxes(payload).filter(move |it| it.name == *name)
}
