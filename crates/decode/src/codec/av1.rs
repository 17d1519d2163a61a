//! AV1, all profiles but RGB.

use re_rav1d::dav1d::{Decoder, Error as Failure, Picture as Av1Picture, PixelLayout, PlanarImageComponent, Settings};

use super::{Decode, StreamFacts, check_same};
use crate::colour::Tags;
use crate::error::{DecodeError, Result};
use crate::guard::guarded;
use crate::limits::MOST_PIXELS;
use crate::picture::{Chroma, DecodedPicture, PlaneSamples, SamplePlane, Yuv};

pub(super) struct Av1 {
    decoder: Decoder,
    facts: StreamFacts,
    format: Option<((u32, u32), u8)>,
}

impl Av1 {
    pub(super) fn new() -> Result<Self> {
        let mut settings = Settings::new();
        settings.set_n_threads(1);
        settings.set_max_frame_delay(1);
        settings.set_all_layers(false);
        settings.set_frame_size_limit(MOST_PIXELS as u32);
        let decoder =
            Decoder::with_settings(&settings).map_err(|error| DecodeError::corrupt(format!("AV1: {error}")))?;
        Ok(Av1 { decoder, facts: StreamFacts::default(), format: None })
    }

    fn drain(&mut self, ready: &mut Vec<DecodedPicture>) -> Result<()> {
        loop {
            match guarded("AV1", || Ok(self.decoder.get_picture()))? {
                Ok(picture) => ready.push(self.decoded(&picture)?),
                Err(error) if error.is_again() => return Ok(()),
                Err(error) => return Err(failure(error)),
            }
        }
    }

    fn decoded(&mut self, picture: &Av1Picture) -> Result<DecodedPicture> {
        let yuv = yuv(picture)?;
        check_same(&mut self.format, ((picture.width(), picture.height()), yuv.depth))?;
        let code = [
            picture.color_primaries() as u8,
            picture.transfer_characteristic() as u8,
            picture.matrix_coefficients() as u8,
        ];
        let mut colour = Tags::of_codes(code[0], code[1], code[2]);
        colour.full_range = Some(matches!(picture.color_range(), re_rav1d::dav1d::pixel::YUVRange::Full));
        if code[2] == 0 {
            return Err(DecodeError::unsupported("AV1 in RGB"));
        }
        self.facts = StreamFacts { depth: yuv.depth, colour, ..StreamFacts::default() };
        Ok(DecodedPicture::Yuv(yuv))
    }
}

impl Decode for Av1 {
    fn push(&mut self, packet: &[u8], ready: &mut Vec<DecodedPicture>) -> Result<()> {
        let data = packet.to_vec();
        let mut sent = guarded("AV1", || Ok(self.decoder.send_data(data, None, None, None)))?;
        loop {
            self.drain(ready)?;
            match sent {
                Ok(()) => return Ok(()),
                Err(error) if error.is_again() => {
                    sent = guarded("AV1", || Ok(self.decoder.send_pending_data()))?;
                }
                Err(error) => return Err(failure(error)),
            }
        }
    }

    fn finish(&mut self, ready: &mut Vec<DecodedPicture>) -> Result<()> {
        self.drain(ready)
    }

    fn facts(&self) -> StreamFacts {
        self.facts
    }
}

fn failure(error: Failure) -> DecodeError {
    match error {
        Failure::UnsupportedBitstream => DecodeError::unsupported("a kind of AV1"),
        error => DecodeError::corrupt(format!("AV1: {error}")),
    }
}

fn yuv(picture: &Av1Picture) -> Result<Yuv> {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let chroma = match picture.pixel_layout() {
        PixelLayout::I400 => Chroma::None,
        PixelLayout::I420 => Chroma::Subsampled(1, 1),
        PixelLayout::I422 => Chroma::Subsampled(1, 0),
        PixelLayout::I444 => Chroma::Subsampled(0, 0),
    };
    let depth = picture.bits_per_component().map_or(8, |bits| bits.0 as u8);
    let bytes = if depth > 8 { 2 } else { 1 };
    let rows = |component: PlanarImageComponent| {
        let (across, down) = match (component, chroma) {
            (PlanarImageComponent::Y, _) => (0, 0),
            (_, Chroma::None) => return Vec::new(),
            (_, Chroma::Subsampled(across, down)) => (across, down),
        };
        let (width, height) = (width.div_ceil(1 << across), height.div_ceil(1 << down));
        let (plane, stride) = (picture.plane(component), picture.stride(component) as usize);
        let rows = plane.chunks(stride.max(1)).take(height);
        rows.flat_map(|row| row.iter().take(width * bytes).copied()).collect::<Vec<u8>>()
    };
    let planes = [PlanarImageComponent::Y, PlanarImageComponent::U, PlanarImageComponent::V].map(rows);
    let widths = match chroma {
        Chroma::None => [width, 0, 0],
        Chroma::Subsampled(across, _) => [width, width.div_ceil(1 << across), width.div_ceil(1 << across)],
    };
    let words = |bytes: &Vec<u8>| bytes.chunks_exact(2).map(|it| u16::from_le_bytes([it[0], it[1]])).collect();
    let [y, u, v] = planes;
    let planes = if bytes == 1 {
        let plane = |samples, stride| SamplePlane { samples, stride };
        PlaneSamples::Bytes([plane(y, widths[0]), plane(u, widths[1]), plane(v, widths[2])])
    } else {
        let plane = |bytes, stride| SamplePlane { samples: words(bytes), stride };
        PlaneSamples::Words([plane(&y, widths[0]), plane(&u, widths[1]), plane(&v, widths[2])])
    };
    Ok(Yuv { size: (width, height), origin: (0, 0), depth, chroma, planes })
}
