//! AVI: RIFF chunks of one video stream. Frames lie in `movi` lists; times are their numbers at the header's rate.

use std::fs::File;
use std::io::BufReader;

use super::{Geometry, Packet, ParameterSets, Setup, Stamps, VideoTrack};
use crate::bytes::{Bytes, read_at};
use crate::error::{DecodeError, Result, printable};
use crate::limits::{LARGEST_DESCRIPTION, LARGEST_PACKET, check_frames};
use crate::timeline::Timeline;
use crate::upright::Orientation;

/// Bytes of a chunk's name and size.
const HEADER: u64 = 8;
/// Deepest lists within lists; a `rec ` lies in a `movi` in a `RIFF`.
const DEEPEST: usize = 4;

/// Reads the headers and finds the frames of the first video stream.
pub(super) fn read(file: &mut BufReader<File>, length: u64) -> Result<VideoTrack> {
    let mut found = AviTrack::default();
    walk(file, 0..length, 0, &mut found)?;
    let stream = found.stream.ok_or_else(|| DecodeError::corrupt("it has no video stream"))?;
    let (rate, scale) = (stream.rate, stream.scale);
    if rate == 0 || scale == 0 {
        return Err(DecodeError::corrupt(format!("its clock runs at {rate}/{scale} frames a second")));
    }
    let rate = f64::from(rate) / f64::from(scale);
    Ok(VideoTrack {
        container: "avi",
        setup: stream.setup,
        packets: found.packets,
        timeline: Timeline::whole(rate),
        stamps: Stamps::Decoding,
        geometry: Geometry { pixel_aspect: found.aspect.map(|it| it.of(stream.size)), orientation: stream.orientation },
        colour: Default::default(),
        interlaced: None,
        claimed_rate: Some(rate),
        capture_rate: None,
        tags: Vec::new(),
        notes: Vec::new(),
        prefix: Vec::new(),
        transport: None,
    })
}

#[derive(Default)]
struct AviTrack {
    /// Streams met so far.
    streams: u32,
    stream: Option<Stream>,
    aspect: Option<Aspect>,
    packets: Vec<Packet>,
    /// Frames so far, empty ones included: those repeat the one before.
    ticks: i64,
}

struct Stream {
    /// Digits with which its chunks' names begin.
    number: [u8; 2],
    setup: Setup,
    rate: u32,
    scale: u32,
    size: (u32, u32),
    orientation: Orientation,
}

/// Aspect of the whole frame by OpenDML's `vprp`.
#[derive(Debug, Clone, Copy)]
struct Aspect {
    frame: f64,
}

impl Aspect {
    /// Shown width of a pixel over its height.
    fn of(self, (width, height): (u32, u32)) -> f64 {
        self.frame * f64::from(height) / f64::from(width.max(1))
    }
}

/// Visits the chunks of a range of the file.
fn walk(file: &mut BufReader<File>, range: std::ops::Range<u64>, depth: usize, found: &mut AviTrack) -> Result<()> {
    let mut at = range.start;
    while at + HEADER <= range.end {
        let header = read_at(file, at, HEADER)?;
        let mut bytes = Bytes(&header);
        let (name, size) = (bytes.name()?, u64::from(bytes.u32_le()?));
        if !name.iter().all(|letter| (b' '..=b'~').contains(letter)) {
            // Zeros or rubbish after the last chunk.
            break;
        }
        let payload = at + HEADER..at.saturating_add(HEADER + size).min(range.end);
        let is_list = name == *b"RIFF" || name == *b"LIST";
        if is_list && depth < DEEPEST && size >= 4 {
            let kind = read_at(file, payload.start, 4.min(payload.end - payload.start))?;
            let inner = payload.start + 4..payload.end;
            match kind.as_slice() {
                b"strl" => stream(file, inner, found)?,
                b"AVI " | b"AVIX" | b"hdrl" | b"movi" | b"rec " => walk(file, inner, depth + 1, found)?,
                _ => {}
            }
        } else {
            found.packet(name, payload.start, size)?;
        }
        // Chunks begin at even places.
        at = at.saturating_add(HEADER + size + size % 2);
    }
    Ok(())
}

impl AviTrack {
    fn packet(&mut self, name: [u8; 4], offset: u64, size: u64) -> Result<()> {
        let Some(stream) = &self.stream else { return Ok(()) };
        if name[..2] != stream.number || !matches!(&name[2..], b"dc" | b"db") {
            return Ok(());
        }
        if size > LARGEST_PACKET {
            return Err(DecodeError::too_large(format!("frame {} claims {size} bytes", self.ticks)));
        }
        if size > 0 {
            self.packets.push(Packet { offset, size, stamp: self.ticks, sync: false });
            check_frames(self.packets.len())?;
        }
        self.ticks += 1;
        Ok(())
    }
}

/// Reads the headers of a stream: `strh`, `strf` and `vprp`.
fn stream(file: &mut BufReader<File>, range: std::ops::Range<u64>, found: &mut AviTrack) -> Result<()> {
    let size = range.end - range.start;
    if size > LARGEST_DESCRIPTION {
        return Err(DecodeError::too_large(format!("its header claims {size} bytes")));
    }
    let number = found.streams;
    found.streams += 1;
    if found.stream.is_some() {
        return Ok(());
    }
    let list = read_at(file, range.start, size)?;
    let (mut rates, mut codec, mut rest) = (None, None, Bytes(&list));
    while rest.0.len() >= HEADER as usize {
        let (name, size) = (rest.name()?, rest.u32_le()? as usize);
        let payload = &rest.0[..size.min(rest.0.len())];
        match &name {
            b"strh" => rates = video_rates(payload)?,
            b"strf" => codec = Some(payload),
            b"vprp" => found.aspect = aspect(payload)?,
            _ => {}
        }
        rest.0 = rest.0.get(size.saturating_add(size % 2)..).unwrap_or_default();
    }
    if let (Some([rate, scale]), Some(codec)) = (rates, codec) {
        let digits = [b'0' + (number / 10 % 10) as u8, b'0' + (number % 10) as u8];
        found.stream = Some(bitmap(codec, digits, rate, scale)?);
    }
    Ok(())
}

/// Rate and scale of a video stream's header: frames a second is their ratio.
fn video_rates(payload: &[u8]) -> Result<Option<[u32; 2]>> {
    let mut bytes = Bytes(payload);
    let kind = bytes.name()?;
    // Codec, flags, priority, language, initial frames.
    bytes.take(16)?;
    let (scale, rate) = (bytes.u32_le()?, bytes.u32_le()?);
    Ok((kind == *b"vids").then_some([rate, scale]))
}

/// The stream's format, a bitmap header.
fn bitmap(payload: &[u8], number: [u8; 2], rate: u32, scale: u32) -> Result<Stream> {
    let mut bytes = Bytes(payload);
    let _size = bytes.u32_le()?;
    let (width, height) = (bytes.u32_le()?, bytes.u32_le()? as i32);
    bytes.take(4)?;
    let codec = bytes.name()?;
    let setup = match &codec.map(|letter| letter.to_ascii_uppercase()) {
        b"H264" | b"X264" | b"AVC1" | b"DAVC" => Setup::H264(ParameterSets::default()),
        b"HEVC" | b"H265" | b"X265" | b"HVC1" => Setup::Hevc(ParameterSets::default()),
        b"VP80" => Setup::Vp8,
        b"VP90" => Setup::Vp9,
        b"AV01" => Setup::Av1,
        b"MJPG" | b"JPEG" | b"LJPG" | b"AVRN" => Setup::Mjpeg,
        b"XVID" | b"DIVX" | b"DX50" | b"FMP4" | b"MP4V" => Setup::Other("MPEG-4 part 2".into()),
        other => Setup::Other(printable(&String::from_utf8_lossy(other))),
    };
    Ok(Stream { number, setup, rate, scale, size: (width, height.unsigned_abs()), orientation: Orientation::UPRIGHT })
}

/// Aspect of the frame: two numbers of 16 bits after five of 32.
fn aspect(payload: &[u8]) -> Result<Option<Aspect>> {
    let mut bytes = Bytes(payload);
    bytes.take(20)?;
    let (height, width) = (bytes.u16_le()?, bytes.u16_le()?);
    let frame = f64::from(width) / f64::from(height);
    Ok((width > 0 && height > 0).then_some(Aspect { frame }))
}
