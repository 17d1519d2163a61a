//! HEVC, 8 and 10 bits, 4:2:0.

use rusty_h265::Decoder;

use super::hevc_sps::HevcSps;
use super::nal::{first_kind, units};
use super::{Decode, PacketRole, StreamFacts, check_same};
use crate::container::ParameterSets;
use crate::error::{DecodeError, Result};
use crate::guard::guarded;
use crate::info::Fields;
use crate::picture::{Chroma, DecodedPicture, PlaneSamples, Yuv};

/// Types of NAL units.
const SPS: u8 = 33;
const LAST_SLICE: u8 = 31;
/// Pictures that refer to some before the entry that they follow (RASL).
const LEADING: [u8; 2] = [8, 9];
/// Pictures at which decoding can begin.
const ENTRIES: std::ops::RangeInclusive<u8> = 16..=23;

pub(super) struct Hevc {
    decoder: Decoder,
    length_bytes: Option<usize>,
    sps: Option<HevcSps>,
    format: Option<((u32, u32), u8)>,
}

impl Hevc {
    /// # Errors
    /// Damaged parameter sets, and formats that the decoder lacks.
    pub(super) fn new(sets: &ParameterSets) -> Result<Self> {
        let mut hevc = Hevc { decoder: Decoder::new(), length_bytes: sets.length_bytes, sps: None, format: None };
        for unit in &sets.units {
            hevc.push_unit(unit)?;
        }
        Ok(hevc)
    }

    fn push_unit(&mut self, unit: &[u8]) -> Result<()> {
        if let (SPS, Some(payload)) = (kind(unit), unit.get(2..)) {
            let sps = HevcSps::parse(payload)?;
            if sps.chroma_format != 1 || sps.depth > 10 {
                let what = format!("HEVC with {} bits and chroma format {}", sps.depth, sps.chroma_format);
                return Err(DecodeError::unsupported(what));
            }
            check_same(&mut self.format, (sps.size, sps.depth))?;
            self.sps = Some(sps);
        }
        match guarded("HEVC", || Ok(self.decoder.push_nal(unit, None)))? {
            Err(rusty_h265::Error::Unsupported(what)) => Err(DecodeError::unsupported(format!("HEVC with {what}"))),
            Err(error) => Err(DecodeError::corrupt(format!("HEVC: {error}"))),
            Ok(()) if self.decoder.stats.errors > 0 || self.decoder.stats.generated_refs > 0 => {
                Err(DecodeError::corrupt("HEVC: a picture refers to one that is missing"))
            }
            Ok(()) => Ok(()),
        }
    }

    fn drain(&mut self, ready: &mut Vec<DecodedPicture>) -> Result<()> {
        while let Ok(frame) = self.decoder.next_frame() {
            let picture = frame.picture;
            let (x, y, width, height) = picture.crop;
            let depth = picture.bit_depth_luma.max(picture.bit_depth_chroma);
            if picture.bit_depth_luma != picture.bit_depth_chroma {
                return Err(DecodeError::unsupported("HEVC with luma and chroma of unequal depth"));
            }
            let yuv = Yuv {
                size: (width, height),
                origin: (x, y),
                depth,
                chroma: Chroma::Subsampled(1, 1),
                planes: PlaneSamples::Hevc(picture),
            };
            ready.push(DecodedPicture::Yuv(yuv));
        }
        Ok(())
    }
}

impl Decode for Hevc {
    fn push(&mut self, packet: &[u8], ready: &mut Vec<DecodedPicture>) -> Result<()> {
        for unit in units(packet, self.length_bytes) {
            self.push_unit(unit?)?;
        }
        self.drain(ready)
    }

    fn finish(&mut self, ready: &mut Vec<DecodedPicture>) -> Result<()> {
        guarded("HEVC", || {
            self.decoder.flush();
            Ok(())
        })?;
        self.drain(ready)
    }

    fn facts(&self) -> StreamFacts {
        let Some(sps) = self.sps else { return StreamFacts::default() };
        let HevcSps { depth, is_interlaced, signal, .. } = sps;
        let interlaced = is_interlaced.then_some(Fields::Unknown);
        StreamFacts { depth, colour: signal.colour, pixel_aspect: signal.pixel_aspect, interlaced }
    }
}

/// Type of a NAL unit.
fn kind(unit: &[u8]) -> u8 {
    unit[0] >> 1 & 63
}

/// The role of the first slice.
pub(super) fn role(packet: &[u8], length_bytes: Option<usize>) -> PacketRole {
    let of = |kind: u8| match kind {
        kind if ENTRIES.contains(&kind) => PacketRole::Entry,
        kind if LEADING.contains(&kind) => PacketRole::Leading,
        _ => PacketRole::Picture,
    };
    match first_kind(packet, length_bytes, kind, |kind| kind <= LAST_SLICE) {
        Ok(found) => found.map_or(PacketRole::Hidden, of),
        // Its slice lies beyond the first bytes.
        Err(()) => PacketRole::Picture,
    }
}
