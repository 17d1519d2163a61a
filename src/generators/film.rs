//! The frames of a clip before they become grey levels.

/// Frames of one size, each with its levels channel by channel, row by row: 0 is black, 1 as bright as a grey level can
/// be. Light and noise may lead beyond.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Pixels.
    pub side: usize,
    pub channels: usize,
    /// `[frames][channels * side * side]`
    pub frames: Vec<Vec<f64>>,
}

impl Film {
    /// The channels of all frames, one after the other.
    pub(crate) fn planes_mut(&mut self) -> impl Iterator<Item = &mut [f64]> {
        let pixels = self.side * self.side;
        self.frames.iter_mut().flat_map(move |frame| frame.chunks_exact_mut(pixels))
    }

    /// Writes all frames as uint8 `[frames, side, side, channels]`, 0..255, cut off at both ends.
    pub fn quantise(&self, frames: &mut [u8]) {
        let bytes = self.side * self.side * self.channels;
        for (levels, frame) in self.frames.iter().zip(frames.chunks_exact_mut(bytes)) {
            quantise(levels, self.channels, frame);
        }
    }
}

/// Writes the levels of one frame, channel by channel, as grey levels, pixel by pixel: cut off, not rounded, as in the
/// original.
pub fn quantise(levels: &[f64], channels: usize, frame: &mut [u8]) {
    for (channel, plane) in levels.chunks_exact(levels.len() / channels).enumerate() {
        for (pixel, level) in frame.chunks_exact_mut(channels).zip(plane) {
            // Below 0 the conversion gives 0.
            pixel[channel] = (level.min(1.0) * 255.0) as u8;
        }
    }
}
