//! The description of a video track's samples: codec, size, colour, pixel aspect (ISO/IEC 14496-12, 8.5.2 and 12.1).

use super::boxes::{boxes, find, full};
use super::{ParameterSets, Setup};
use crate::bytes::Bytes;
use crate::colour::Tags;
use crate::error::{DecodeError, Result, printable};
use crate::info::Fields;
use crate::limits::check_size;

/// Bytes of a video entry before its boxes.
const FIXED: usize = 78;
/// Object type of JPEG in an elementary stream descriptor.
const OBJECT_JPEG: u8 = 0x6c;

/// A sample entry.
#[derive(Debug)]
pub(super) struct SampleEntry {
    pub setup: Setup,
    /// Size of the coded frames, pixels.
    pub size: (u32, u32),
    pub pixel_aspect: Option<f64>,
    pub colour: Tags,
    pub interlaced: Option<Fields>,
}

/// Reads the first entry.
pub(super) fn read(payload: &[u8]) -> Result<SampleEntry> {
    let (_, _, mut bytes) = full(payload)?;
    let _count = bytes.u32()?;
    let entry = boxes(bytes.0).next().ok_or_else(|| DecodeError::corrupt("the description of its codec is missing"))?;
    let mut fixed = Bytes(entry.payload);
    let _reserved = fixed.take(24)?;
    let size = (u32::from(fixed.u16()?), u32::from(fixed.u16()?));
    // Zero where only the stream states the size.
    if size != (0, 0) {
        check_size(size.0, size.1)?;
    }
    let inner =
        entry.payload.get(FIXED..).ok_or_else(|| DecodeError::corrupt("the description of its codec ends early"))?;
    Ok(SampleEntry {
        setup: setup(&entry.name, inner)?,
        size,
        pixel_aspect: aspect(inner)?,
        colour: colour(inner)?,
        interlaced: fields(inner)?,
    })
}

fn setup(name: &[u8; 4], inner: &[u8]) -> Result<Setup> {
    let config = |name: &[u8; 4]| {
        find(inner, name).ok_or_else(|| DecodeError::corrupt("the parameter sets of its codec are missing"))
    };
    Ok(match name {
        b"avc1" | b"avc3" => Setup::H264(avc(config(b"avcC")?)?),
        b"hvc1" | b"hev1" => Setup::Hevc(hevc(config(b"hvcC")?)?),
        b"vp08" => Setup::Vp8,
        b"vp09" => Setup::Vp9,
        b"av01" => Setup::Av1,
        b"jpeg" | b"mjpg" => Setup::Mjpeg,
        b"mp4v" if object_type(inner) == Some(OBJECT_JPEG) => Setup::Mjpeg,
        b"mp4v" => Setup::Other("MPEG-4 part 2".into()),
        b"encv" => return Err(DecodeError::unsupported("an encrypted video")),
        other => Setup::Other(printable(&String::from_utf8_lossy(other))),
    })
}

/// The decoder configuration of H.264 (ISO/IEC 14496-15, 5.3.3).
pub(super) fn avc(config: &[u8]) -> Result<ParameterSets> {
    let mut bytes = Bytes(config);
    bytes.take(4)?;
    let length_bytes = usize::from(bytes.u8()? & 3) + 1;
    let mut units = Vec::new();
    // Sequence, then picture parameter sets.
    for mask in [31, 255] {
        for _ in 0..bytes.u8()? & mask {
            let length = bytes.u16()?;
            units.push(bytes.take(length.into())?.to_vec());
        }
    }
    Ok(ParameterSets { units, length_bytes: Some(length_bytes) })
}

/// The decoder configuration of HEVC (ISO/IEC 14496-15, 8.3.3).
pub(super) fn hevc(config: &[u8]) -> Result<ParameterSets> {
    let mut bytes = Bytes(config);
    bytes.take(21)?;
    let length_bytes = usize::from(bytes.u8()? & 3) + 1;
    let mut units = Vec::new();
    for _ in 0..bytes.u8()? {
        bytes.u8()?;
        for _ in 0..bytes.u16()? {
            let length = bytes.u16()?;
            units.push(bytes.take(length.into())?.to_vec());
        }
    }
    Ok(ParameterSets { units, length_bytes: Some(length_bytes) })
}

/// Object type of an elementary stream descriptor: in it a decoder's descriptor (tag 4) begins with it.
fn object_type(inner: &[u8]) -> Option<u8> {
    let descriptor = find(inner, b"esds")?.get(4..)?;
    let after = |bytes: &[u8]| bytes.iter().position(|byte| byte & 0x80 == 0).map(|at| at + 1);
    let body = descriptor.strip_prefix(&[3])?;
    let body = body.get(after(body)?..)?.get(3..)?;
    let body = body.strip_prefix(&[4])?;
    body.get(after(body)?).copied()
}

fn aspect(inner: &[u8]) -> Result<Option<f64>> {
    let Some(payload) = find(inner, b"pasp") else { return Ok(None) };
    let mut bytes = Bytes(payload);
    let (width, height) = (bytes.u32()?, bytes.u32()?);
    Ok((width > 0 && height > 0).then(|| f64::from(width) / f64::from(height)))
}

fn colour(inner: &[u8]) -> Result<Tags> {
    let mut tags = Tags::default();
    for it in boxes(inner).filter(|it| it.name == *b"colr") {
        let mut bytes = Bytes(it.payload);
        let kind = bytes.name()?;
        if kind == *b"nclx" || kind == *b"nclc" {
            let mut code = || bytes.u16().map(|code| u8::try_from(code).unwrap_or(2));
            tags = Tags::of_codes(code()?, code()?, code()?);
            if kind == *b"nclx" {
                tags.full_range = Some(bytes.u8()? & 0x80 != 0);
            }
        }
    }
    Ok(tags)
}

/// Fields of QuickTime's box: their number, and which is first.
fn fields(inner: &[u8]) -> Result<Option<Fields>> {
    let Some(payload) = find(inner, b"fiel") else { return Ok(None) };
    let mut bytes = Bytes(payload);
    let (count, order) = (bytes.u8()?, bytes.u8()?);
    Ok((count == 2).then_some(match order {
        1 | 9 => Fields::TopFirst,
        6 | 14 => Fields::BottomFirst,
        _ => Fields::Unknown,
    }))
}
