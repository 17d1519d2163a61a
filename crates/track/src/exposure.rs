//! Gain and offset of a frame relative to the background: flicker and exposure drift.

use nalgebra::{Matrix2, Vector2};

use crate::statistics::{NORMAL_MAD, median};

/// Pixels from which gain and offset are estimated.
const SAMPLES: usize = 2500;
/// Variance of the background, levels^2, below which the gain is not identifiable and stays near 1.
const GAIN_PRIOR: f64 = 25.0;
/// Tuning constant of the biweight: 95 % efficiency on normal noise.
const BIWEIGHT: f64 = 4.685;
/// Rounds of reweighting.
const ROUNDS: usize = 5;

/// Frame = gain * background + offset, for each channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Exposure {
    pub(crate) gain: [f64; 3],
    pub(crate) offset: [f64; 3],
}

impl Default for Exposure {
    fn default() -> Self {
        Self { gain: [1.0; 3], offset: [0.0; 3] }
    }
}

impl Exposure {
    /// Fits gain and offset of a frame by reweighted least squares (biweight), so that objects do not count.
    ///
    /// `frame` and `background` are `[pixels, 3]` in levels.
    pub(crate) fn fit(frame: &[u8], background: &[f32]) -> Self {
        let pixels = frame.len() / 3;
        // An odd stride avoids sampling a single column.
        let stride = (pixels / SAMPLES).max(1) | 1;
        let mut exposure = Self::default();
        for channel in 0..3 {
            let pairs: Vec<(f64, f64)> = (0..pixels)
                .step_by(stride)
                .map(|pixel| (f64::from(background[pixel * 3 + channel]), f64::from(frame[pixel * 3 + channel])))
                // Saturated pixels do not follow the exposure.
                .filter(|&(below, level)| (4.0..251.0).contains(&below) && (2.0..253.0).contains(&level))
                .collect();
            if pairs.len() > 30 {
                (exposure.gain[channel], exposure.offset[channel]) = line(&pairs);
            }
        }
        exposure
    }

    /// Levels of a channel as they would be at the background's exposure.
    pub(crate) fn table(&self, channel: usize) -> [f32; 256] {
        std::array::from_fn(|level| ((level as f64 - self.offset[channel]) / self.gain[channel]) as f32)
    }

    /// Tables of the three channels.
    pub(crate) fn tables(&self) -> [[f32; 256]; 3] {
        [self.table(0), self.table(1), self.table(2)]
    }

    /// Change of a pixel of medium brightness, levels, largest over the channels.
    pub(crate) fn change(&self) -> f64 {
        (0..3).map(|c| ((self.gain[c] - 1.0) * 128.0 + self.offset[c]).abs()).fold(0.0, f64::max)
    }
}

/// Gain and offset of a robust line through `(background, level)`.
fn line(pairs: &[(f64, f64)]) -> (f64, f64) {
    let mut shifts: Vec<f64> = pairs.iter().map(|(x, y)| y - x).collect();
    let (mut gain, mut offset) = (1.0, median(&mut shifts).unwrap_or(0.0));
    for _ in 0..ROUNDS {
        let mut sizes: Vec<f64> = pairs.iter().map(|(x, y)| (y - gain * x - offset).abs()).collect();
        // Levels are integers: a scale below half a level is rounding.
        let scale = (median(&mut sizes).unwrap_or(0.0) * NORMAL_MAD).max(0.5) * BIWEIGHT;
        let mean = pairs.iter().map(|p| p.0).sum::<f64>() / pairs.len() as f64;
        let (mut normal, mut right, mut total) = (Matrix2::zeros(), Vector2::zeros(), 0.0);
        for &(x, y) in pairs {
            let z = (y - gain * x - offset) / scale;
            if z.abs() < 1.0 {
                let weight = (1.0 - z * z).powi(2);
                let row = Vector2::new(x - mean, 1.0);
                normal += weight * row * row.transpose();
                right += weight * row * (y - x);
                total += weight;
            }
        }
        normal[(0, 0)] += GAIN_PRIOR * total;
        let Some(change) = normal.lu().solve(&right) else { break };
        gain = 1.0 + change[0];
        offset = change[1] - change[0] * mean;
    }
    if (0.2..5.0).contains(&gain) { (gain, offset) } else { (1.0, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gain_and_offset_survive_an_object_over_a_quarter_of_the_frame() {
        let background: Vec<f32> = (0..30_000).map(|i| 40.0 + (i / 3 % 151) as f32).collect();
        let frame: Vec<u8> = background
            .iter()
            .enumerate()
            .map(|(i, &b)| if i > 22_500 { 10 } else { (0.9 * b + 6.0).round() as u8 })
            .collect();
        let fitted = Exposure::fit(&frame, &background);
        for channel in 0..3 {
            // Rounding of 2000 samples leaves an error near 0.3 / sqrt(2000) levels; the prior shrinks by 25 / 1900.
            assert!((fitted.gain[channel] - 0.9).abs() < 0.005, "{fitted:?}");
            assert!((fitted.gain[channel] * 115.0 + fitted.offset[channel] - 109.5).abs() < 0.2, "{fitted:?}");
        }
    }

    #[test]
    fn a_flat_background_changes_its_offset_only() {
        let fitted = Exposure::fit(&[110; 3000], &[100.0; 3000]);
        assert!((fitted.gain[0] - 1.0).abs() < 1e-9 && (fitted.offset[0] - 10.0).abs() < 1e-6);
        assert!((fitted.table(0)[110] - 100.0).abs() < 1e-4);
    }
}
