//! A picture in the making: frames, blocks of colour and text on white.

use std::path::Path;
use std::sync::LazyLock;

use anyhow::{Result, anyhow, ensure};
use image::codecs::png::{CompressionType, FilterType as PngFilter, PngEncoder};
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use plotters::backend::BitMapBackend;
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind, IntoDrawingArea};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontDesc, FontFamily, FontStyle, IntoFont, RGBColor, TextStyle, register_font};
use tch::{Device, Kind, Tensor};

use crate::support::atomic;

/// The text's colour.
pub const INK: RGBColor = RGBColor(38, 42, 48);
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);

/// The embedded font under a name of its own, so that no font of the machine decides how a picture looks.
const FONT: &str = "paig";
static REGISTERED: LazyLock<bool> =
    LazyLock::new(|| register_font(FONT, FontStyle::Normal, dejavu::sans::regular()).is_ok());

/// The embedded font, `size` pixels high.
pub(crate) fn font(size: u32) -> FontDesc<'static> {
    assert!(*REGISTERED, "the embedded font is sound");
    (FontFamily::Name(FONT), size).into_font()
}

/// An RGB picture, white at the start. Places are (x, y) of a top left corner in pixels.
#[derive(Clone)]
pub struct Canvas {
    pixels: RgbImage,
}

impl Canvas {
    pub fn new(width: u32, height: u32) -> Self {
        Canvas { pixels: RgbImage::from_pixel(width, height, PAPER) }
    }

    /// The corner of a picture need not lie within the canvas; what sticks out is cut off.
    pub fn paste(&mut self, picture: &RgbImage, (x, y): (u32, u32)) {
        imageops::replace(&mut self.pixels, picture, i64::from(x), i64::from(y));
    }

    pub fn fill(&mut self, corner: (u32, u32), (width, height): (u32, u32), colour: RGBColor) {
        self.paste(&RgbImage::from_pixel(width, height, Rgb([colour.0, colour.1, colour.2])), corner);
    }

    /// One line of text; `at` is its left end, middle or right end, halfway up its capitals.
    pub fn text(&mut self, text: &str, at: (u32, u32), size: u32, align: HPos, colour: RGBColor) -> Result<()> {
        // The font's layout box reaches above the capitals: a fifth of the size further down looks centred.
        let at = (at.0 as i32, (at.1 + size / 5) as i32);
        let style = TextStyle::from(font(size)).color(&colour).pos(Pos::new(align, VPos::Center));
        drawn(self.area().draw_text(text, &style, at))
    }

    /// The whole canvas as a drawing area.
    pub fn area(&mut self) -> DrawingArea<BitMapBackend<'_>, Shift> {
        let size = self.pixels.dimensions();
        BitMapBackend::with_buffer(&mut self.pixels, size).into_drawing_area()
    }

    pub fn pixels(&self) -> &RgbImage {
        &self.pixels
    }

    pub(crate) fn into_pixels(self) -> RgbImage {
        self.pixels
    }

    pub fn write_png(&self, path: &Path) -> Result<()> {
        atomic::write_file(path, |file| {
            let encoder = PngEncoder::new_with_quality(file, CompressionType::Best, PngFilter::Adaptive);
            Ok(self.pixels.write_with_encoder(encoder)?)
        })
    }
}

/// A drawing error as one that can leave the thread.
pub fn drawn<T, E: std::error::Error + Send + Sync>(result: Result<T, DrawingAreaErrorKind<E>>) -> Result<T> {
    result.map_err(|error| anyhow!("cannot draw: {error}"))
}

/// Frames `[n, C, h, w]` in \[0, 1\] (clipped to it) as `n` pictures, every pixel `times` as large; one channel becomes grey.
pub fn pictures(frames: &Tensor, times: u32) -> Result<Vec<RgbImage>> {
    let (count, channels, height, width) = frames.size4()?;
    ensure!(channels == 1 || channels == 3, "a picture needs 1 or 3 channels; the frames have {channels}");
    let bytes = (frames.to_device(Device::Cpu).clamp(0.0, 1.0) * 255.0).round().to_kind(Kind::Uint8);
    let bytes = bytes.expand([count, 3, height, width], false).permute([0, 2, 3, 1]);
    let (width, height) = (width as u32, height as u32);
    let picture = |frame| {
        let bytes = Vec::<u8>::try_from(bytes.get(frame).contiguous().flatten(0, -1))?;
        let picture = RgbImage::from_raw(width, height, bytes).expect("three bytes for each pixel");
        Ok(imageops::resize(&picture, width * times, height * times, FilterType::Nearest))
    };
    (0..count).map(picture).collect()
}

/// The same of one frame `[C, h, w]`.
pub fn picture(frame: &Tensor, times: u32) -> Result<RgbImage> {
    Ok(pictures(&frame.unsqueeze(0), times)?.remove(0))
}
