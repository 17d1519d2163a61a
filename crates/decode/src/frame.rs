//! A frame that is handed out.

use std::sync::Arc;

use image::{DynamicImage, GrayImage, RgbImage};

use crate::colour::Converter;
use crate::fields::Parity;
use crate::picture::DecodedPicture;
use crate::upright::Orientation;

/// A frame: when it is shown, and its pixels, which are converted when they are asked for.
#[derive(Clone)]
pub struct Frame {
    pub(crate) number: usize,
    pub(crate) seconds: Option<f64>,
    pub(crate) picture: DecodedPicture,
    pub(crate) display: Arc<Presentation>,
    /// The field that is shown, where frames are split into fields.
    pub(crate) field: Option<Parity>,
}

/// How the frames of a video become upright pictures.
pub(crate) struct Presentation {
    pub orientation: Orientation,
    pub converter: Converter,
}

impl Frame {
    /// Display number, counted from 0.
    pub fn number(&self) -> usize {
        self.number
    }

    /// Presentation time, seconds since the video's first frame; none where the source has no times.
    pub fn seconds(&self) -> Option<f64> {
        self.seconds
    }

    /// Width and height of the upright frame, pixels.
    pub fn size(&self) -> (u32, u32) {
        self.display.orientation.size(self.picture.size())
    }

    /// The upright frame in colour.
    pub fn rgb(&self) -> RgbImage {
        let stored = match &self.picture {
            DecodedPicture::Yuv(yuv) => self.display.converter.rgb(yuv),
            DecodedPicture::Rgb(picture) => picture.clone(),
        };
        let shown = match self.field {
            Some(field) => field.rgb(stored),
            None => stored,
        };
        self.display.orientation.turn_rgb(shown)
    }

    /// The upright frame's luma, 0 for black to 255 for white.
    pub fn grey(&self) -> GrayImage {
        let stored = match &self.picture {
            DecodedPicture::Yuv(yuv) => self.display.converter.grey(yuv),
            DecodedPicture::Rgb(picture) => DynamicImage::from(picture.clone()).into_luma8(),
        };
        let shown = match self.field {
            Some(field) => field.grey(stored),
            None => stored,
        };
        self.display.orientation.turn_grey(shown)
    }

    /// The samples as decoded, neither turned nor converted: planes of luma and chroma, or RGB. Bytes at 8 bits, else
    /// little-endian pairs of bytes. To compare decoders by.
    pub fn samples(&self) -> Vec<u8> {
        match &self.picture {
            DecodedPicture::Yuv(yuv) => {
                let mut raw = Vec::with_capacity(self.picture.bytes());
                yuv.append_raw(&mut raw);
                raw
            }
            DecodedPicture::Rgb(picture) => picture.as_raw().clone(),
        }
    }
}
