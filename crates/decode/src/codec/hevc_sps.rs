//! Sequence parameter sets of HEVC (ITU-T H.265, 7.3.2.2): format, cropping, aspect, colour.

use super::vui::{Signal, signal};
use crate::bits::Bits;
use crate::error::{DecodeError, Result};
use crate::limits::check_size;

/// Most sets of reference pictures.
const MOST_SETS: u32 = 64;
/// Most pictures in one of them.
const MOST_REFERENCES: u32 = 16;

/// A sequence parameter set.
#[derive(Debug, Clone, Copy)]
pub(super) struct HevcSps {
    /// 0 for grey, 1 for 4:2:0, 2 for 4:2:2, 3 for 4:4:4.
    pub chroma_format: u32,
    pub depth: u8,
    /// Size of the visible part, pixels.
    pub size: (u32, u32),
    /// Whether pictures are fields, or frames of two of them.
    pub is_interlaced: bool,
    pub signal: Signal,
}

impl HevcSps {
    /// Parses the payload of a NAL unit, without its header.
    pub(super) fn parse(payload: &[u8]) -> Result<Self> {
        let mut bits = Bits::of_nal(payload);
        bits.bits(4)?;
        let layers = bits.bits(3)?;
        bits.bit()?;
        let is_interlaced = profile(&mut bits, layers)?;
        bits.ue()?;
        let chroma_format = bits.ue()?;
        if chroma_format == 3 {
            bits.bit()?;
        }
        let (width, height) = (bits.ue()?, bits.ue()?);
        check_size(width, height)?;
        let crop = if bits.bit()? { [bits.ue()?, bits.ue()?, bits.ue()?, bits.ue()?] } else { [0; 4] };
        let depth = 8 + bits.ue()?.max(bits.ue()?);
        let unit = [if matches!(chroma_format, 1 | 2) { 2 } else { 1 }, if chroma_format == 1 { 2 } else { 1 }];
        let visible = |side: u32, unit: u64, before: u32, after: u32| {
            let cropped = unit * (u64::from(before) + u64::from(after));
            u64::from(side).checked_sub(cropped).filter(|side| *side > 0)
        };
        let sides = (visible(width, unit[0], crop[0], crop[1]), visible(height, unit[1], crop[2], crop[3]));
        let (Some(width), Some(height)) = sides else {
            return Err(DecodeError::corrupt("its cropping leaves nothing of its frames"));
        };
        let signal = usability(&mut bits, layers)?;
        let depth = u8::try_from(depth).unwrap_or(u8::MAX);
        Ok(HevcSps { chroma_format, depth, size: (width as u32, height as u32), is_interlaced, signal })
    }
}

/// Skips profile, tier and levels; returns whether the source is said to be interlaced and not progressive.
fn profile(bits: &mut Bits, layers: u32) -> Result<bool> {
    bits.skip(40)?;
    let (progressive, interlaced) = (bits.bit()?, bits.bit()?);
    bits.skip(54)?;
    let mut present = Vec::new();
    for _ in 0..layers {
        present.push((bits.bit()?, bits.bit()?));
    }
    if layers > 0 {
        bits.skip(2 * (8 - layers as usize))?;
    }
    for (profile, level) in present {
        bits.skip(if profile { 88 } else { 0 } + if level { 8 } else { 0 })?;
    }
    Ok(interlaced && !progressive)
}

/// Skips what lies between the depths and the usability information, and reads that.
fn usability(bits: &mut Bits, layers: u32) -> Result<Signal> {
    let order_bits = bits.ue()?.saturating_add(4);
    let of_all = bits.bit()?;
    for _ in if of_all { 0 } else { layers }..=layers {
        for _ in 0..3 {
            bits.ue()?;
        }
    }
    for _ in 0..6 {
        bits.ue()?;
    }
    if bits.bit()? && bits.bit()? {
        scaling_lists(bits)?;
    }
    bits.skip(2)?;
    if bits.bit()? {
        bits.skip(8)?;
        bits.ue()?;
        bits.ue()?;
        bits.bit()?;
    }
    reference_sets(bits)?;
    if bits.bit()? {
        for _ in 0..bits.ue()?.min(33) {
            bits.skip(order_bits as usize + 1)?;
        }
    }
    bits.skip(2)?;
    if bits.bit()? { signal(bits) } else { Ok(Signal::default()) }
}

fn scaling_lists(bits: &mut Bits) -> Result<()> {
    for size in 0..4u32 {
        for _ in (0..6).step_by(if size == 3 { 3 } else { 1 }) {
            if !bits.bit()? {
                bits.ue()?;
                continue;
            }
            if size > 1 {
                bits.se()?;
            }
            for _ in 0..64.min(1 << (4 + 2 * size)) {
                bits.se()?;
            }
        }
    }
    Ok(())
}

fn reference_sets(bits: &mut Bits) -> Result<()> {
    let count = bits.ue()?;
    if count > MOST_SETS {
        return Err(DecodeError::corrupt(format!("a parameter set claims {count} sets of references")));
    }
    let mut before = 0;
    for set in 0..count {
        let predicted = set > 0 && bits.bit()?;
        if predicted {
            bits.bit()?;
            bits.ue()?;
            let mut kept = 0;
            for _ in 0..=before {
                let is_used = bits.bit()?;
                kept += u32::from(is_used || bits.bit()?);
            }
            before = kept;
        } else {
            let (negative, positive) = (bits.ue()?, bits.ue()?);
            if negative > MOST_REFERENCES || positive > MOST_REFERENCES {
                return Err(DecodeError::corrupt("a parameter set claims too many references"));
            }
            before = negative + positive;
            for _ in 0..before {
                bits.ue()?;
                bits.bit()?;
            }
        }
    }
    Ok(())
}
