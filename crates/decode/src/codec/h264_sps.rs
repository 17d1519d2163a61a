//! Sequence parameter sets of H.264 (ITU-T H.264, 7.3.2.1.1): format, cropping, aspect, colour, depth of reordering.

use super::vui::{Signal, signal};
use crate::bits::Bits;
use crate::error::{DecodeError, Result};
use crate::limits::{LARGEST_SIDE, check_size};

/// Profiles with a chroma format.
const HIGH_PROFILES: [u32; 13] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135];
/// Most frames held, in macroblocks, by level (table A-1).
const HELD_MACROBLOCKS: [(u32, u32); 19] = [
    (9, 396),
    (10, 396),
    (11, 900),
    (12, 2376),
    (13, 2376),
    (20, 2376),
    (21, 4752),
    (22, 8100),
    (30, 8100),
    (31, 18_000),
    (32, 20_480),
    (40, 32_768),
    (41, 32_768),
    (42, 34_816),
    (50, 110_400),
    (51, 184_320),
    (52, 184_320),
    (60, 696_320),
    (62, 696_320),
];
/// Most frames held.
const MOST_HELD: u32 = 16;

/// A sequence parameter set.
#[derive(Debug, Clone, Copy)]
pub(super) struct H264Sps {
    /// 0 for grey, 1 for 4:2:0, 2 for 4:2:2, 3 for 4:4:4.
    pub chroma_format: u32,
    pub depth: u8,
    /// Size of the visible part, pixels.
    pub size: (u32, u32),
    /// Where it begins in the coded frame, pixels.
    pub origin: (u32, u32),
    /// Whether all pictures are frames.
    pub is_progressive: bool,
    /// Most frames that follow a frame in decoding order and are shown before it.
    pub reorder: usize,
    pub signal: Signal,
}

impl H264Sps {
    /// Parses the payload of a NAL unit, without its header.
    pub(super) fn parse(payload: &[u8]) -> Result<Self> {
        let mut bits = Bits::of_nal(payload);
        let profile = bits.bits(8)?;
        let constraints = bits.bits(8)?;
        let level = bits.bits(8)?;
        bits.ue()?;
        let (mut chroma_format, mut depth) = (1, 8);
        if HIGH_PROFILES.contains(&profile) {
            chroma_format = bits.ue()?;
            if chroma_format == 3 {
                bits.bit()?;
            }
            depth = 8 + bits.ue()?.max(bits.ue()?);
            bits.bit()?;
            if bits.bit()? {
                scaling_lists(&mut bits, if chroma_format == 3 { 12 } else { 8 })?;
            }
        }
        bits.ue()?;
        let order_type = order(&mut bits)?;
        let references = bits.ue()?;
        bits.bit()?;
        let (columns, rows) = (side(bits.ue()?)?, side(bits.ue()?)?);
        let is_progressive = bits.bit()?;
        if !is_progressive {
            bits.bit()?;
        }
        bits.bit()?;
        let rows = rows * if is_progressive { 1 } else { 2 };
        check_size(columns * 16, rows * 16)?;
        let crop = if bits.bit()? { [bits.ue()?, bits.ue()?, bits.ue()?, bits.ue()?] } else { [0; 4] };
        let unit_x = if matches!(chroma_format, 1 | 2) { 2 } else { 1 };
        let unit_y = if chroma_format == 1 { 2 } else { 1 } * if is_progressive { 1 } else { 2 };
        let (left, width) = window(columns * 16, unit_x, crop[0], crop[1])?;
        let (top, height) = window(rows * 16, unit_y, crop[2], crop[3])?;
        let mut signalled = Signal::default();
        let mut reorder = held(level, columns * rows).max(references);
        if bits.bit()? {
            // Writers get the end of it wrong; the beginning is what matters.
            signalled = signal(&mut bits)?;
            if let Ok(Some(stated)) = stated_reorder(&mut bits) {
                reorder = stated;
            }
        }
        // Intra profiles and the order type 2 do not reorder; the decoder has no order of type 1.
        let is_intra = matches!(profile, 44 | 100 | 110 | 122 | 244) && constraints & 0x10 != 0;
        let reorder = if order_type != 0 || is_intra { 0 } else { reorder.min(MOST_HELD) as usize };
        Ok(H264Sps {
            chroma_format,
            depth: u8::try_from(depth).unwrap_or(u8::MAX),
            size: (width, height),
            origin: (left, top),
            is_progressive,
            reorder,
            signal: signalled,
        })
    }
}

/// A side in macroblocks, from its code.
fn side(code: u32) -> Result<u32> {
    match code {
        code if code < LARGEST_SIDE / 16 => Ok(code + 1),
        code => Err(DecodeError::too_large(format!("a side of its frames has {code} macroblocks"))),
    }
}

/// Begin and length of the visible part of a side.
fn window(side: u32, unit: u32, before: u32, after: u32) -> Result<(u32, u32)> {
    let cropped = u64::from(unit) * (u64::from(before) + u64::from(after));
    if cropped >= u64::from(side) {
        return Err(DecodeError::corrupt(format!("its cropping leaves nothing of {side} pixels")));
    }
    Ok((unit * before, side - cropped as u32))
}

/// Skips scaling lists.
fn scaling_lists(bits: &mut Bits, count: usize) -> Result<()> {
    for list in 0..count {
        if !bits.bit()? {
            continue;
        }
        let (mut last, mut next) = (8i64, 8i64);
        for _ in 0..if list < 6 { 16 } else { 64 } {
            if next != 0 {
                next = (last + i64::from(bits.se()?)).rem_euclid(256);
            }
            last = if next == 0 { last } else { next };
        }
    }
    Ok(())
}

/// Skips the fields of the display order; returns its type.
fn order(bits: &mut Bits) -> Result<u32> {
    let order_type = bits.ue()?;
    match order_type {
        0 => drop(bits.ue()?),
        1 => {
            bits.bit()?;
            bits.se()?;
            bits.se()?;
            for _ in 0..bits.ue()?.min(255) {
                bits.se()?;
            }
        }
        _ => {}
    }
    Ok(order_type)
}

/// Frames that a decoder of the level holds of this size.
fn held(level: u32, macroblocks: u32) -> u32 {
    let most = HELD_MACROBLOCKS.iter().find(|it| it.0 >= level).map_or(696_320, |it| it.1);
    (most / macroblocks.max(1)).clamp(1, MOST_HELD)
}

/// The depth of reordering, if it is stated: the last but one field, after clock and buffers.
fn stated_reorder(bits: &mut Bits) -> Result<Option<u32>> {
    if bits.bit()? {
        bits.skip(65)?;
    }
    let mut buffers = false;
    for _ in 0..2 {
        if bits.bit()? {
            buffers = true;
            let count = bits.ue()?.min(31) + 1;
            bits.skip(8)?;
            for _ in 0..count {
                bits.ue()?;
                bits.ue()?;
                bits.bit()?;
            }
            bits.skip(20)?;
        }
    }
    if buffers {
        bits.bit()?;
    }
    bits.bit()?;
    if !bits.bit()? {
        return Ok(None);
    }
    bits.bit()?;
    for _ in 0..4 {
        bits.ue()?;
    }
    Ok(Some(bits.ue()?))
}
