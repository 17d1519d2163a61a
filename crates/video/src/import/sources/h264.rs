//! H.264 frames, 8 bit 4:2:0, one by one.

use anyhow::{Result, anyhow};
use rusty_h264_common::YuvFrame;
use rusty_h264_decoder::{DecodeError, Decoder};

use super::container::ParameterSets;
use super::damage::guarded;

const START_CODE: [u8; 4] = [0, 0, 0, 1];

/// A decoder that is fed with the samples of a container in their order.
pub(super) struct SampleDecoder {
    decoder: Decoder,
    length_bytes: usize,
}

/// What came of a sample.
pub(super) enum Decoded {
    Frame(YuvFrame),
    /// A tool of the standard that the decoder lacks.
    Unsupported(String),
}

impl SampleDecoder {
    /// A decoder that knows the stream's parameter sets; or why it cannot decode such a stream.
    ///
    /// # Errors
    /// Damaged parameter sets.
    pub(super) fn new(sets: &ParameterSets) -> Result<std::result::Result<Self, String>> {
        let mut decoder = Decoder::new();
        let stream: Vec<u8> = sets.units.iter().flat_map(|unit| START_CODE.iter().chain(unit)).copied().collect();
        let read = guarded("cannot read its H.264 parameter sets", || Ok(decoder.decode(&stream)))?;
        match read {
            Ok(_) => Ok(Ok(SampleDecoder { decoder, length_bytes: sets.length_bytes })),
            Err(DecodeError::Unsupported(what)) => Ok(Err(format!("it is H.264 with {what}"))),
            Err(error) => Err(anyhow!("cannot read its H.264 parameter sets: {error}")),
        }
    }

    /// Decodes one sample: the NAL units of one frame, each after its length.
    ///
    /// # Errors
    /// Damage, or a sample without a frame.
    pub(super) fn decode(&mut self, sample: &[u8]) -> Result<Decoded> {
        let stream = annex_b(sample, self.length_bytes)?;
        match guarded("cannot decode it", || Ok(self.decoder.decode(&stream)))? {
            Ok(Some(frame)) => Ok(Decoded::Frame(frame)),
            Ok(None) => Err(anyhow!("it holds no whole picture; is the file damaged?")),
            Err(DecodeError::Unsupported(what)) => Ok(Decoded::Unsupported(what.into())),
            Err(error) => Err(anyhow!("cannot decode it: {error}; is the file damaged?")),
        }
    }
}

/// Lengths replaced by start codes.
fn annex_b(mut sample: &[u8], length_bytes: usize) -> Result<Vec<u8>> {
    let mut stream = Vec::with_capacity(sample.len() + 64);
    while sample.len() > length_bytes {
        let (length, rest) = sample.split_at(length_bytes);
        let length = length.iter().fold(0, |sum, &byte| sum << 8 | usize::from(byte));
        let unit =
            rest.get(..length).ok_or_else(|| anyhow!("a unit is longer than its sample; is the file damaged?"))?;
        stream.extend(START_CODE);
        stream.extend(unit);
        sample = &rest[length..];
    }
    Ok(stream)
}

/// Whether a decoder may begin with this sample: it holds a slice of an IDR picture, before which nothing is referred to.
pub(super) fn is_entry(mut sample: &[u8], length_bytes: usize) -> bool {
    const IDR_SLICE: u8 = 5;
    while sample.len() > length_bytes {
        let (length, rest) = sample.split_at(length_bytes);
        let length = length.iter().fold(0, |sum, &byte| sum << 8 | usize::from(byte));
        if rest[0] & 31 == IDR_SLICE {
            return true;
        }
        let Some(next) = rest.get(length..) else { return false };
        sample = next;
    }
    false
}
