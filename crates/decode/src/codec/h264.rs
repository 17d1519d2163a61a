//! H.264, 8 bits, 4:2:0, frames.

use std::collections::BTreeMap;

use rusty_h264_common::nal::emulation_unprevent;
use rusty_h264_decoder::{DecodeError as Failure, Decoder, Pps};

use super::h264_sps::H264Sps;
use super::nal::{first_kind, units};
use super::{Decode, PacketRole, StreamFacts, check_same};
use crate::container::ParameterSets;
use crate::error::{DecodeError, Result};
use crate::guard::guarded;
use crate::info::Fields;
use crate::picture::{Chroma, DecodedPicture, PlaneSamples, SamplePlane, Yuv};

const START_CODE: [u8; 4] = [0, 0, 0, 1];
/// Types of NAL units.
const SLICE: u8 = 1;
const IDR_SLICE: u8 = 5;
const SPS: u8 = 7;
const PPS: u8 = 8;

/// A decoder with the pictures that wait for earlier ones.
pub(super) struct H264 {
    decoder: Decoder,
    length_bytes: Option<usize>,
    sps: Option<H264Sps>,
    format: Option<(u32, u32)>,
    /// By coded video sequence and picture order count.
    waiting: BTreeMap<(usize, i32), DecodedPicture>,
    /// Coded video sequences begun.
    sequence: usize,
}

impl H264 {
    /// # Errors
    /// Damaged parameter sets, and formats that the decoder lacks.
    pub(super) fn new(sets: &ParameterSets) -> Result<Self> {
        let mut h264 = H264 {
            decoder: Decoder::new(),
            length_bytes: sets.length_bytes,
            sps: None,
            format: None,
            waiting: BTreeMap::new(),
            sequence: 0,
        };
        let mut stream = Vec::new();
        for unit in &sets.units {
            h264.take_unit(unit, &mut stream)?;
        }
        h264.decode(&stream)?;
        Ok(h264)
    }

    /// Checks a unit before the decoder sees it, and appends it to the stream.
    fn take_unit(&mut self, unit: &[u8], stream: &mut Vec<u8>) -> Result<()> {
        match (unit[0] & 31, &unit[1..]) {
            (SPS, payload) => {
                let sps = H264Sps::parse(payload)?;
                check(&sps)?;
                check_same(&mut self.format, sps.size)?;
                self.sps = Some(sps);
            }
            (PPS, payload) => {
                let pps = guarded("a picture parameter set", || Ok(Pps::parse(&emulation_unprevent(payload))))?;
                if pps.is_ok_and(|pps| pps.weighted_bipred_idc == 1) {
                    return Err(DecodeError::unsupported("H.264 with explicit weights of B frames"));
                }
            }
            _ => {}
        }
        stream.extend(START_CODE);
        stream.extend(unit);
        Ok(())
    }

    fn decode(&mut self, stream: &[u8]) -> Result<Option<rusty_h264_common::YuvFrame>> {
        match guarded("H.264", || Ok(self.decoder.decode(stream)))? {
            Ok(frame) => Ok(frame),
            Err(Failure::Unsupported(what)) => Err(DecodeError::unsupported(format!("H.264 with {what}"))),
            Err(error) => Err(DecodeError::corrupt(format!("H.264: {error}"))),
        }
    }

    fn release(&mut self, most: usize, ready: &mut Vec<DecodedPicture>) {
        while self.waiting.len() > most || self.waiting.first_key_value().is_some_and(|it| it.0.0 < self.sequence) {
            ready.extend(self.waiting.pop_first().map(|it| it.1));
        }
    }
}

fn check(sps: &H264Sps) -> Result<()> {
    match sps {
        H264Sps { depth: 9.., .. } => Err(DecodeError::unsupported(format!("H.264 with {} bits", sps.depth))),
        H264Sps { chroma_format: 1, .. } => Ok(()),
        _ => Err(DecodeError::unsupported("H.264 with another chroma format than 4:2:0")),
    }
}

impl Decode for H264 {
    fn push(&mut self, packet: &[u8], ready: &mut Vec<DecodedPicture>) -> Result<()> {
        let (mut stream, mut has_slice, mut is_idr) = (Vec::with_capacity(packet.len() + 64), false, false);
        for unit in units(packet, self.length_bytes) {
            let unit = unit?;
            has_slice |= matches!(unit[0] & 31, SLICE..=IDR_SLICE);
            is_idr |= unit[0] & 31 == IDR_SLICE;
            self.take_unit(unit, &mut stream)?;
        }
        if !has_slice {
            return Ok(());
        }
        let frame =
            self.decode(&stream)?.ok_or_else(|| DecodeError::corrupt("H.264: a packet holds no whole picture"))?;
        let sps = self.sps.ok_or_else(|| DecodeError::corrupt("H.264: a picture comes before its parameters"))?;
        self.sequence += usize::from(is_idr);
        let picture = DecodedPicture::Yuv(visible(frame, &sps)?);
        let key = (self.sequence, self.decoder.last_poc());
        if self.waiting.insert(key, picture).is_some() {
            return Err(DecodeError::corrupt("H.264: two pictures have one place in the display order"));
        }
        self.release(sps.reorder, ready);
        Ok(())
    }

    fn finish(&mut self, ready: &mut Vec<DecodedPicture>) -> Result<()> {
        self.release(0, ready);
        Ok(())
    }

    fn facts(&self) -> StreamFacts {
        let signal = self.sps.map(|sps| sps.signal).unwrap_or_default();
        let interlaced = self.sps.filter(|sps| !sps.is_progressive).map(|_| Fields::Unknown);
        StreamFacts { depth: 8, colour: signal.colour, pixel_aspect: signal.pixel_aspect, interlaced }
    }
}

/// The visible part of a frame, which the decoder crops on the right and below only.
fn visible(frame: rusty_h264_common::YuvFrame, sps: &H264Sps) -> Result<Yuv> {
    let (size, origin) = (sps.size, (sps.origin.0 as usize, sps.origin.1 as usize));
    let size = (size.0 as usize, size.1 as usize);
    let half = frame.width / 2;
    let holds =
        frame.y.len() >= frame.width * frame.height && frame.u.len().min(frame.v.len()) >= half * (frame.height / 2);
    if frame.width < origin.0 + size.0 || frame.height < origin.1 + size.1 || !holds {
        return Err(DecodeError::corrupt("H.264: a picture is smaller than stated"));
    }
    let plane = |samples, stride| SamplePlane { samples, stride };
    let planes = PlaneSamples::Bytes([plane(frame.y, frame.width), plane(frame.u, half), plane(frame.v, half)]);
    Ok(Yuv { size, origin, depth: 8, chroma: Chroma::Subsampled(1, 1), planes })
}

/// Decoding can begin with a picture before which nothing is referred to.
pub(super) fn role(packet: &[u8], length_bytes: Option<usize>) -> PacketRole {
    match first_kind(packet, length_bytes, |unit| unit[0] & 31, |kind| (SLICE..=IDR_SLICE).contains(&kind)) {
        Ok(Some(IDR_SLICE)) => PacketRole::Entry,
        Ok(None) => PacketRole::Hidden,
        // Its slice may lie beyond the first bytes.
        Ok(Some(_)) | Err(()) => PacketRole::Picture,
    }
}
