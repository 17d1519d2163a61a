//! Animated gifs.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use image::codecs::gif::GifDecoder;
use image::{AnimationDecoder, DynamicImage, ImageDecoder, Limits, RgbImage};

use super::{Facts, Frames, LARGEST_SIDE, MOST_FRAMES, check_size};

/// Times are the sums of the frames' delays.
pub(super) fn facts(path: &Path) -> Result<Facts> {
    let decoder = open(path)?;
    let size = decoder.dimensions();
    check_size(size.0, size.1)?;
    let (mut times, mut time) = (Vec::new(), Duration::ZERO);
    for frame in decoder.into_frames() {
        let frame = frame.with_context(|| format!("frame {} is damaged", times.len()))?;
        ensure!(times.len() < MOST_FRAMES, "it has more than {MOST_FRAMES} frames");
        times.push(time.as_secs_f64());
        time += Duration::from(frame.delay());
    }
    // Without delays a gif says nothing of time.
    let timed = time > Duration::ZERO || times.len() == 1;
    Ok(Facts { size, frames: times.len(), times: timed.then_some(times), complaint: None })
}

fn open(path: &Path) -> Result<GifDecoder<BufReader<File>>> {
    let mut decoder = GifDecoder::new(BufReader::new(File::open(path)?)).context("not a readable gif")?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    decoder.set_limits(limits).context("its frames are too large")?;
    Ok(decoder)
}

/// A gif as it plays.
pub(super) struct Animation<'a> {
    frames: image::Frames<'a>,
    /// Frames taken so far, and the last of them.
    taken: usize,
    last: RgbImage,
}

impl Animation<'_> {
    pub(super) fn open(path: &Path) -> Result<Self> {
        Ok(Animation { frames: open(path)?.into_frames(), taken: 0, last: RgbImage::default() })
    }
}

impl Frames for Animation<'_> {
    fn frame(&mut self, number: usize) -> Result<RgbImage> {
        while self.taken <= number {
            let frame = self.frames.next().with_context(|| format!("frame {number} is missing"))?;
            let frame = frame.with_context(|| format!("frame {} is damaged", self.taken))?;
            self.last = DynamicImage::from(frame.into_buffer()).into_rgb8();
            self.taken += 1;
        }
        Ok(self.last.clone())
    }
}
