//! Containers: where the coded frames lie, when each is shown, and which way is up.

mod avi;
mod boxes;
mod ebml;
mod matroska;
mod mp4;
mod mp4_entry;
mod mp4_fragments;
mod mp4_tables;
mod mp4_tags;
mod transport;

use std::fs::File;
use std::io::{BufReader, Read, Seek};

use crate::bytes::big_endian;
use crate::colour::Tags;
use crate::error::{DecodeError, Result};
use crate::info::{Fields, Note};
use crate::timeline::Timeline;
use crate::upright::Orientation;

pub(crate) use self::transport::Transport;

/// The video track of a file.
#[derive(Debug)]
pub(crate) struct VideoTrack {
    pub container: &'static str,
    pub setup: Setup,
    /// In decoding order.
    pub packets: Vec<Packet>,
    pub timeline: Timeline,
    pub stamps: Stamps,
    pub geometry: Geometry,
    /// Colour tags of the container.
    pub colour: Tags,
    pub interlaced: Option<Fields>,
    pub claimed_rate: Option<f64>,
    pub capture_rate: Option<f64>,
    pub tags: Vec<(String, String)>,
    pub notes: Vec<Note>,
    /// Bytes that precede each packet and are stored once (Matroska's header stripping).
    pub prefix: Vec<u8>,
    /// How frames lie among other streams; none where each lies in one piece.
    pub transport: Option<Transport>,
}

/// The codec, and what its decoder must know before the first packet.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Setup {
    H264(ParameterSets),
    Hevc(ParameterSets),
    Vp8,
    Vp9,
    Av1,
    Mjpeg,
    /// By its name for people.
    Other(String),
}

/// Parameter sets stored outside the packets.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ParameterSets {
    /// NAL units without start codes.
    pub units: Vec<Vec<u8>>,
    /// Bytes of the length before each NAL unit of a packet; none where start codes separate them (Annex B).
    pub length_bytes: Option<usize>,
}

/// A coded frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Packet {
    /// Place in the file, bytes.
    pub offset: u64,
    pub size: u64,
    /// Ticks of the track's clock.
    pub stamp: i64,
    /// Whether the container marks it as decodable without those before it.
    pub sync: bool,
}

/// What the packets' stamps mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stamps {
    /// Times at which the frames are shown.
    Presentation,
    /// Times at which they are decoded: in display order, the frames have the same times, sorted.
    Decoding,
}

/// Aspect and orientation that the container states.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Geometry {
    /// Shown width of a stored pixel over its height, where the container states it.
    pub pixel_aspect: Option<f64>,
    pub orientation: Orientation,
}

/// Bytes by which a container is recognized: three packets of a transport stream.
const LOOKED_AT: u64 = 400;

/// Reads the index of a file; recognizes the container by its first bytes. None for a container that is not read here.
///
/// # Errors
/// Damage, no video in it, claims beyond the limits.
pub(crate) fn read(file: &mut BufReader<File>) -> Result<Option<VideoTrack>> {
    let length = file.get_ref().metadata()?.len();
    let mut first = Vec::new();
    file.rewind()?;
    file.by_ref().take(LOOKED_AT).read_to_end(&mut first)?;
    file.rewind()?;
    if first.is_empty() {
        return Err(DecodeError::corrupt("it is empty"));
    }
    let name = |at: usize| first.get(at..at + 4).unwrap_or_default();
    let track = match () {
        () if boxes::TOP_LEVEL.iter().any(|known| known.as_slice() == name(4)) => mp4::read(file, length)?,
        () if big_endian(name(0)) == u64::from(ebml::HEADER) => matroska::read(file, length)?,
        () if name(0) == b"RIFF" && name(8) == b"AVI " => avi::read(file, length)?,
        () => match transport::bytes_before(&first) {
            Some(before) => transport::read(file, before)?,
            None => return Ok(None),
        },
    };
    check_inside(&track.packets, length)?;
    crate::limits::check_frames(track.packets.len())?;
    Ok(Some(track))
}

/// Refuses a file that lacks coded frames of its index.
fn check_inside(packets: &[Packet], length: u64) -> Result<()> {
    let inside = |packet: &&Packet| packet.offset.checked_add(packet.size).is_some_and(|end| end <= length);
    let there = packets.iter().filter(inside).count();
    if there < packets.len() {
        let beyond = packets.len() - there;
        let all = packets.len();
        return Err(DecodeError::corrupt(format!("it is cut off: {beyond} of its {all} frames lie beyond its end")));
    }
    Ok(())
}
