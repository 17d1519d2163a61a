//! VP9, all profiles but RGB.

use rusty_vp9::{DecodedFrame, Error as Failure, Vp9Decoder};

use super::vp9_header::{Vp9Header, frames};
use super::{Decode, StreamFacts, check_same};
use crate::colour::Tags;
use crate::error::{DecodeError, Result};
use crate::guard::guarded;
use crate::picture::{Chroma, DecodedPicture, PlaneSamples, SamplePlane, Yuv};

pub(super) struct Vp9 {
    decoder: Vp9Decoder,
    format: Option<(u8, Tags)>,
    size: Option<(u32, u32)>,
}

impl Vp9 {
    pub(super) fn new() -> Self {
        Vp9 { decoder: Vp9Decoder::new(), format: None, size: None }
    }

    fn drain(&mut self, ready: &mut Vec<DecodedPicture>) -> Result<()> {
        loop {
            match guarded("VP9", || Ok(self.decoder.next_frame()))? {
                Ok(frame) => ready.push(DecodedPicture::Yuv(yuv(frame)?)),
                // A frame that is not shown asks for more, too: the queue ends the loop.
                Err(Failure::Again | Failure::Eof) => return Ok(()),
                Err(Failure::Unsupported(what)) => return Err(DecodeError::unsupported(format!("VP9 with {what}"))),
                Err(error) => return Err(DecodeError::corrupt(format!("VP9: {error}"))),
            }
        }
    }
}

impl Decode for Vp9 {
    fn push(&mut self, packet: &[u8], ready: &mut Vec<DecodedPicture>) -> Result<()> {
        for frame in frames(packet) {
            let header = Vp9Header::read(frame)?;
            if let Some(size) = header.size {
                check_same(&mut self.size, size)?;
            }
            if let Some(format) = header.format {
                check_same(&mut self.format, format)?;
            }
            if self.format.is_none() {
                return Err(DecodeError::corrupt("VP9: it does not begin with a key frame"));
            }
            match guarded("VP9", || Ok(self.decoder.push(frame, None)))? {
                Ok(()) => self.drain(ready)?,
                Err(error) => return Err(DecodeError::corrupt(format!("VP9: {error}"))),
            }
        }
        Ok(())
    }

    fn finish(&mut self, _: &mut Vec<DecodedPicture>) -> Result<()> {
        Ok(())
    }

    fn facts(&self) -> StreamFacts {
        let (depth, colour) = self.format.unwrap_or_default();
        StreamFacts { depth, colour, ..StreamFacts::default() }
    }
}

fn yuv(frame: DecodedFrame) -> Result<Yuv> {
    let depth = frame.bit_depth as u8;
    let planes: [(Vec<u8>, usize); 3] = frame
        .planes
        .into_iter()
        .zip(frame.strides)
        .collect::<Vec<_>>()
        .try_into()
        .map_err(|_| DecodeError::corrupt("VP9: a picture has not three planes"))?;
    let words = |bytes: Vec<u8>| bytes.chunks_exact(2).map(|it| u16::from_le_bytes([it[0], it[1]])).collect();
    let planes = if depth == 8 {
        PlaneSamples::Bytes(planes.map(|(samples, stride)| SamplePlane { samples, stride }))
    } else {
        PlaneSamples::Words(planes.map(|(bytes, stride)| SamplePlane { samples: words(bytes), stride: stride / 2 }))
    };
    let chroma = Chroma::Subsampled(frame.subsampling_x as usize, frame.subsampling_y as usize);
    Ok(Yuv { size: (frame.width as usize, frame.height as usize), origin: (0, 0), depth, chroma, planes })
}
