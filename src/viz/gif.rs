//! Pictures in motion.

use std::path::Path;

use anyhow::{Context, Result};
use color_quant::NeuQuant;
use gif::{DisposalMethod, Encoder, Frame, Repeat};

use super::canvas::Canvas;
use crate::support::atomic;

/// Hundredths of a second, in which a GIF counts: 8 frames a second cannot be had exactly.
const FRAME_TIME: u16 = 12;
const LAST_FRAME_TIME: u16 = 120;
/// Frames from which the palette is learned, evenly spread.
const PALETTE_FRAMES: usize = 6;
/// Most pixels from which the palette is learned.
const PALETTE_PIXELS: usize = 50_000;
const COLOURS: usize = 256;
/// Bits of each channel by which pixels are looked up in the palette.
const BITS: u32 = 6;

/// Writes `frames` pictures of one size as an animation, endless, about 8 of them a second; the last one stands longer.
///
/// # Errors
/// A picture that cannot be drawn, a file that cannot be written, sides beyond 65,535.
pub fn write(path: &Path, frames: usize, draw: impl Fn(usize) -> Result<Canvas>) -> Result<()> {
    let sampled = PALETTE_FRAMES.min(frames);
    let sampled: Vec<Canvas> =
        (0..sampled).map(|i| draw((2 * i + 1) * frames / (2 * sampled))).collect::<Result<_>>()?;
    let first = sampled.first().context("an animation has at least one frame")?.pixels();
    let [width, height] = [first.width(), first.height()].map(u16::try_from);
    let (width, height) = (width.context("width of an animation")?, height.context("height of an animation")?);
    let mut palette = Palette::of(&sampled);
    atomic::write_file(path, |file| {
        let mut encoder = Encoder::new(file, width, height, &palette.colours())?;
        encoder.set_repeat(Repeat::Infinite)?;
        for number in 0..frames {
            let indices = draw(number)?.pixels().pixels().map(|pixel| palette.index(pixel.0)).collect::<Vec<u8>>();
            let delay = if number + 1 == frames { LAST_FRAME_TIME } else { FRAME_TIME };
            let frame = Frame {
                width,
                height,
                delay,
                dispose: DisposalMethod::Keep,
                buffer: indices.into(),
                ..Frame::default()
            };
            encoder.write_frame(&frame)?;
        }
        Ok(())
    })
}

/// The colours of an animation. One palette for all frames: what stands still does not flicker.
struct Palette {
    learned: NeuQuant,
    /// Index of each colour that was asked for, by the upper bits of its channels.
    known: Vec<Option<u8>>,
}

impl Palette {
    fn of(canvases: &[Canvas]) -> Self {
        let pixels: usize = canvases.iter().map(|canvas| canvas.pixels().pixels().len()).sum();
        let step = pixels.div_ceil(PALETTE_PIXELS).max(1);
        let samples: Vec<u8> = canvases
            .iter()
            .flat_map(|canvas| canvas.pixels().pixels())
            .step_by(step)
            .flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2], u8::MAX])
            .collect();
        Self { learned: NeuQuant::new(1, COLOURS, &samples), known: vec![None; 1 << (3 * BITS)] }
    }

    /// Red, green and blue of each colour.
    fn colours(&self) -> Vec<u8> {
        self.learned.color_map_rgb()
    }

    /// The nearest colour to that of the first pixel with the same upper bits.
    fn index(&mut self, [red, green, blue]: [u8; 3]) -> u8 {
        let place =
            [red, green, blue].iter().fold(0, |place, &level| (place << BITS) | usize::from(level >> (8 - BITS)));
        *self.known[place].get_or_insert_with(|| self.learned.index_of(&[red, green, blue, u8::MAX]) as u8)
    }
}
