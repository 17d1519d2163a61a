//! mp4 and mov: where the coded frames lie, when each is shown, and which way is up.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use re_mp4::{Mp4, StsdBoxContent, TrakBox};

use super::damage::{Bounded, guarded};
use super::edits;
use super::{MOST_FRAMES, check_size, check_square};

/// Most bytes of the boxes that describe a film; an hour has some megabytes.
const MOST_DESCRIPTION: u64 = 1 << 28;
/// Most samples of any track, sound with one sample a number included.
const MOST_SAMPLES: u64 = 50_000_000;
/// Boxes that the parser copies as a whole.
const COPIED: [&[u8; 4]; 6] = [b"avc1", b"avcC", b"av1C", b"hdlr", b"hvcC", b"url "];
/// Boxes with notes for people (title, place, camera), of which the parser copies whatever they claim to hold; it is not
/// shown them.
const NOTES: [&[u8; 4]; 2] = [b"meta", b"udta"];
/// Most reads and seeks for each byte of the description and of the headers of all boxes. Each byte is read once or twice,
/// several at a time.
const CALLS_PER_BYTE: u64 = 4;

/// The film's track.
#[derive(Debug)]
pub(super) struct Track {
    pub codec: Codec,
    /// In the order in which they are decoded.
    pub samples: Vec<Sample>,
    pub turn: Turn,
    /// Width and height of the frames before they are turned.
    pub coded: (u32, u32),
}

#[derive(Debug)]
pub(super) enum Codec {
    H264(ParameterSets),
    /// By its name for people.
    Other(String),
}

/// What an H.264 decoder must know before the first frame.
#[derive(Debug)]
pub(super) struct ParameterSets {
    /// NAL units without start codes.
    pub units: Vec<Vec<u8>>,
    /// Bytes of the number before each NAL unit of a sample.
    pub length_bytes: usize,
}

/// One coded frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Place in the file, bytes.
    pub offset: u64,
    pub size: u64,
    /// When it is shown, seconds from the first frame shown.
    pub time: f64,
    /// Its number in display order; none of one that is not shown, but may be needed to decode others.
    pub number: Option<usize>,
}

/// How the coded frames must be turned to stand upright, clockwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    None,
    Quarter,
    Half,
    ThreeQuarters,
}

impl Track {
    /// Reads the description of a film; its frames stay in the file.
    ///
    /// # Errors
    /// Damage, a file without film, sizes beyond the limits, a frame that lies beyond the end of the file.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let mut file = BufReader::new(File::open(path).context("cannot open it")?);
        let length = file.get_ref().metadata()?.len();
        let Claims { described, notes, aspect } = check_claims(&mut file, length)?;
        file.rewind()?;
        let read = || Ok(Mp4::read(Bounded::new(&mut file, CALLS_PER_BYTE * described, notes), length)?);
        let mp4 = guarded("not a readable mp4 or mov", read).context("not a readable mp4 or mov; is it complete?")?;
        let film = |track: &&re_mp4::Track| track.trak(&mp4).mdia.hdlr.handler_type.value == *b"vide";
        let track = mp4.tracks().values().find(film).context("it holds no film")?;
        let described = track.trak(&mp4);
        let codec = codec(described);
        let coded = size(described);
        if let Codec::H264(_) = codec {
            check_size(coded.0, coded.1)?;
        }
        let turn = turn(described)?;
        check_square(aspect.or_else(|| aspect_shown(described, coded, turn)).unwrap_or(1.0))?;
        ensure!(track.samples.len() <= MOST_FRAMES, "it claims {} frames", track.samples.len());
        ensure!(track.timescale > 0, "its clock has no ticks; is it damaged?");
        let shown = edits::shown(&mp4, described, track)?;
        let is_shown = |sample: &usize| shown.contains(&i128::from(track.samples[*sample].composition_timestamp));
        let mut order: Vec<usize> = (0..track.samples.len()).filter(is_shown).collect();
        ensure!(
            !order.is_empty() || track.samples.is_empty(),
            "its edit list hides all of its {} frames; is it damaged?",
            track.samples.len()
        );
        order.sort_by_key(|&sample| track.samples[sample].composition_timestamp);
        let mut numbers = vec![None; track.samples.len()];
        order.iter().enumerate().for_each(|(number, &sample)| numbers[sample] = Some(number));
        let first = order.first().map_or(0, |&sample| track.samples[sample].composition_timestamp);
        let samples: Vec<_> = track
            .samples
            .iter()
            .zip(numbers)
            .map(|(sample, number)| {
                let ticks = sample.composition_timestamp.saturating_sub(first);
                let time = ticks as f64 / track.timescale as f64;
                Sample { offset: sample.offset, size: sample.size, time, number }
            })
            .collect();
        let inside = |sample: &Sample| sample.offset.checked_add(sample.size).is_some_and(|end| end <= length);
        let there = samples.iter().filter(|sample| inside(sample)).count();
        ensure!(
            there == samples.len(),
            "it is cut off: {} of its {} frames lie beyond its end; get the whole file",
            samples.len() - there,
            samples.len()
        );
        Ok(Track { codec, samples, turn, coded })
    }

    /// Width and height of the upright frames.
    pub(super) fn size(&self) -> (u32, u32) {
        let (width, height) = self.coded;
        match self.turn {
            Turn::None | Turn::Half => (width, height),
            Turn::Quarter | Turn::ThreeQuarters => (height, width),
        }
    }

    /// Of the frames that are shown, in display order.
    pub(super) fn times(&self) -> Vec<f64> {
        let shown = self.samples.iter().filter(|sample| sample.number.is_some());
        let mut times: Vec<_> = shown.map(|sample| sample.time).collect();
        times.sort_by(f64::total_cmp);
        times
    }
}

/// What is known of a file before it is parsed.
#[derive(Default)]
struct Claims {
    /// Bytes of the description and of the headers of all boxes.
    described: u64,
    /// Where the names of boxes with notes for people stand.
    notes: Vec<u64>,
    /// Width to height of a pixel, if it is said.
    aspect: Option<f64>,
}

/// The parser makes room for as many samples as a file claims, so a claim beyond reason is refused before it.
fn check_claims(file: &mut (impl Read + Seek), length: u64) -> Result<Claims> {
    let (mut at, mut claims) = (0, Claims::default());
    while at + 8 <= length {
        file.seek(SeekFrom::Start(at))?;
        let mut header = [0; 16];
        let read = (length - at).min(16) as usize;
        file.read_exact(&mut header[..read])?;
        let size = match big_endian(&header[..4]) {
            0 => length - at,
            1 => big_endian(&header[8..]),
            size => size,
        };
        if [*b"moov", *b"moof"].iter().any(|name| header[4..8] == *name) {
            ensure!(size <= MOST_DESCRIPTION, "its description claims {size} bytes; is it damaged?");
            let mut description = Vec::new();
            file.seek(SeekFrom::Start(at))?;
            file.take(size).read_to_end(&mut description)?;
            check_counts(&description)?;
            claims.aspect = claims.aspect.or_else(|| aspect_said(&description));
            claims.described += description.len() as u64;
            let names =
                description.windows(4).enumerate().filter(|(_, name)| NOTES.iter().any(|it| it.as_slice() == *name));
            claims.notes.extend(names.map(|(place, _)| at + place as u64));
        }
        claims.described += header.len() as u64;
        at = at.saturating_add(size.max(8));
    }
    Ok(claims)
}

/// Tables in which one entry may stand for any number of samples: after the name come version and flags, then for `stsz`
/// the size of all samples and their number, for `trun` their number. And boxes of which the parser makes as much room as
/// they claim to be long, in the four bytes before the name.
fn check_counts(description: &[u8]) -> Result<()> {
    for (place, name) in description.windows(4).enumerate() {
        if COPIED.iter().any(|copied| copied.as_slice() == name) {
            let size = place.checked_sub(4).map_or(0, |start| big_endian(&description[start..place]));
            let name = name.escape_ascii();
            ensure!(
                (8..=description.len() as u64).contains(&size),
                "a box \"{name}\" claims {size} bytes; is it damaged?"
            );
        }
        let skip = match name {
            b"stsz" => 12,
            b"trun" => 8,
            _ => continue,
        };
        let Some(bytes) = description.get(place + skip..place + skip + 4) else { continue };
        let count = big_endian(bytes);
        ensure!(count <= MOST_SAMPLES, "it claims {count} samples in one track; is it damaged?");
    }
    Ok(())
}

/// Width to height of a pixel as a box `pasp` says it, which the parser does not read: after the name come both.
fn aspect_said(description: &[u8]) -> Option<f64> {
    const BOX: &[u8; 8] = b"\0\0\0\x10pasp";
    let place = description.windows(BOX.len()).position(|bytes| bytes == BOX)? + BOX.len();
    let [width, height] = [0, 4].map(|part| description.get(place + part..place + part + 4).map_or(0, big_endian));
    (width > 0 && height > 0).then(|| width as f64 / height as f64)
}

/// The same by the size at which the track is to be shown; none where it does not say. It is given before the frames are turned;
/// where it is that of the upright frames, it is taken so.
fn aspect_shown(described: &TrakBox, coded: (u32, u32), turn: Turn) -> Option<f64> {
    let shown = [described.tkhd.width.value(), described.tkhd.height.value()].map(f64::from);
    let coded = [coded.0, coded.1].map(f64::from);
    if shown.iter().chain(&coded).any(|side| *side == 0.0) {
        return None;
    }
    let aspect = |width: f64, height: f64| width / height * coded[1] / coded[0];
    let upright = aspect(shown[1], shown[0]);
    let turned = matches!(turn, Turn::Quarter | Turn::ThreeQuarters) && check_square(upright).is_ok();
    Some(if turned { upright } else { aspect(shown[0], shown[1]) })
}

fn big_endian(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0, |number, &byte| number << 8 | u64::from(byte))
}

fn codec(described: &TrakBox) -> Codec {
    let other = |name: &str| Codec::Other(name.into());
    match &described.mdia.minf.stbl.stsd.contents {
        StsdBoxContent::Avc1(avc1) => {
            let sets = [&avc1.avcc.sequence_parameter_sets, &avc1.avcc.picture_parameter_sets];
            let units = sets.into_iter().flatten().map(|unit| unit.bytes.clone()).collect();
            let length_bytes = usize::from(avc1.avcc.length_size_minus_one & 3) + 1;
            Codec::H264(ParameterSets { units, length_bytes })
        }
        StsdBoxContent::Hvc1(_) | StsdBoxContent::Hev1(_) => other("HEVC"),
        StsdBoxContent::Av01(_) => other("AV1"),
        StsdBoxContent::Vp08(_) => other("VP8"),
        StsdBoxContent::Vp09(_) => other("VP9"),
        StsdBoxContent::Unknown(code) => Codec::Other(format!("of the codec {code}")),
        StsdBoxContent::Mp4a(_) | StsdBoxContent::Tx3g(_) => other("no film"),
    }
}

fn size(described: &TrakBox) -> (u32, u32) {
    match &described.mdia.minf.stbl.stsd.contents {
        StsdBoxContent::Avc1(avc1) => (avc1.width.into(), avc1.height.into()),
        _ => (described.tkhd.width.value().into(), described.tkhd.height.value().into()),
    }
}

/// The track header's matrix: x' = a x + c y, y' = b x + d y, with y down, in 65536ths.
fn turn(described: &TrakBox) -> Result<Turn> {
    let matrix = &described.tkhd.matrix;
    Ok(match [matrix.a, matrix.b, matrix.c, matrix.d].map(i32::signum) {
        [1, 0, 0, 1] | [0, 0, 0, 0] => Turn::None,
        [0, 1, -1, 0] => Turn::Quarter,
        [-1, 0, 0, -1] => Turn::Half,
        [0, -1, 1, 0] => Turn::ThreeQuarters,
        _ => bail!("it is to be shown mirrored or at an odd angle; convert it so that it is stored upright"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_that_are_not_square_are_refused() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/numbered.mp4");
        let bytes = std::fs::read(path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let read = |bytes: &[u8]| {
            let path = folder.path().join("video.mp4");
            std::fs::write(&path, bytes).unwrap();
            Track::read(&path).map(drop).map_err(|error| error.to_string())
        };
        let place = |name: &[u8]| bytes.windows(4).position(|it| it == name).unwrap();
        // Shown as 85 x 48 instead of 64 x 48, by the track's header.
        let mut wide = bytes.clone();
        wide[place(b"tkhd") + 81] = 85;
        assert!(read(&wide).unwrap_err().contains("not square: each is shown 1.328 times as wide"));
        // A box that says so itself, in the place of the one for bit rates; it says more than the header does.
        for (sides, square) in [([4, 3], false), ([1, 1], true), ([200, 201], true), ([0, 0], true)] {
            let mut said = bytes.clone();
            let at = place(b"btrt") - 4;
            said[at..at + 8].copy_from_slice(b"\0\0\0\x10pasp");
            said[at + 8..at + 16].copy_from_slice(&sides.map(u32::to_be_bytes).concat());
            assert_eq!(read(&said).is_ok(), square, "{sides:?}");
        }
        read(&bytes).unwrap();
    }
}
