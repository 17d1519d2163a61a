//! Background and noise: robust statistics of each pixel over sampled frames.

use std::ops::Range;

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use crate::exposure::Exposure;
use crate::mask::Mask;
use crate::options::Region;
use crate::resting::remove_resting;
use crate::statistics::median;
use crate::video::Size;

/// Most frames that are sampled: the median of 35 values has 21 % of one value's noise.
const MOST_SAMPLED: usize = 35;
/// Fewest frames that are sampled, whatever the memory.
const LEAST_SAMPLED: usize = 11;
/// Rank of the absolute deviations that gives the noise. A low one, since objects make the large deviations.
const NOISE_SHARE: f64 = 0.3;
/// Standard deviations of a normal distribution at that rank: 30 % of values lie within 0.385 of them.
const NOISE_RANK: f32 = 0.385;
/// Distance from the median, in units of the noise, of another state of a pixel.
const FAR: f32 = 6.0;
/// Share of the samples in another state from which on it may be the background.
const LEAST_OTHER: f32 = 0.15;
/// Least noise, levels: rounding and compression.
const LEAST_NOISE: f32 = 0.7;

/// Frames kept to estimate the background.
pub(crate) struct Samples {
    size: Size,
    /// Frame indices and bytes, `[height, width, 3]`.
    frames: Vec<(usize, Vec<u8>)>,
    exposures: Vec<Exposure>,
}

/// Scene without its moving objects.
#[derive(Debug, Clone)]
pub struct Background {
    /// Levels, `[height, width, 3]`.
    pub levels: Array3<f32>,
    /// Reciprocal of the noise, 1/levels, `[height, width]`; zero where a region is ignored.
    pub precision: Array2<f32>,
    /// Median noise over the frame, levels.
    pub noise: f32,
}

impl Samples {
    /// Frames of a range to sample, evenly spread.
    pub(crate) fn chosen(range: &Range<usize>, size: Size, bytes: usize) -> Vec<usize> {
        let room = (bytes / (size.pixels() * 3)).clamp(LEAST_SAMPLED, MOST_SAMPLED);
        let count = room.min(range.len());
        (0..count).map(|i| range.start + (2 * i + 1) * range.len() / (2 * count)).collect()
    }

    /// Samples from frame indices and bytes, `[height, width, 3]`.
    pub(crate) fn new(size: Size, frames: Vec<(usize, Vec<u8>)>) -> Self {
        let exposures = vec![Exposure::default(); frames.len()];
        Self { size, frames, exposures }
    }

    /// Frame indices of the samples.
    pub(crate) fn indices(&self) -> impl Iterator<Item = usize> {
        self.frames.iter().map(|(index, _)| *index)
    }

    /// Frame indices and bytes of the samples.
    pub(crate) fn frames(&self) -> &[(usize, Vec<u8>)] {
        &self.frames
    }

    /// Background of all samples. The exposures of the samples are fitted on the way.
    pub(crate) fn background(&mut self, ignore: &[Region]) -> Background {
        let mut background = self.estimate(None);
        self.expose(&background);
        let steady = self.exposures.iter().all(|e| e.change() < 0.5);
        if !steady {
            background = self.estimate(None);
            self.expose(&background);
        }
        background.ignore(ignore);
        background
    }

    fn expose(&mut self, background: &Background) {
        let levels = background.levels.as_slice().expect("levels are contiguous");
        self.exposures = self.frames.par_iter().map(|(_, bytes)| Exposure::fit(bytes, levels)).collect();
    }

    /// Background from the samples in which a pixel is not occupied. A pixel occupied in nearly all samples keeps the
    /// median of all.
    pub(crate) fn unoccupied(&self, occupied: &[Mask], ignore: &[Region]) -> Background {
        let mut background = self.estimate(Some(occupied));
        background.ignore(ignore);
        background
    }

    fn estimate(&self, occupied: Option<&[Mask]>) -> Background {
        let Size { width, height } = self.size;
        let tables: Vec<[[f32; 256]; 3]> = self.exposures.iter().map(Exposure::tables).collect();
        let least = (self.frames.len() / 12).max(3);
        let mut levels = vec![0.0_f32; width * height * 3];
        let mut noise = vec![0.0_f32; width * height];
        levels.par_chunks_mut(width * 3).zip(noise.par_chunks_mut(width)).enumerate().for_each(
            |(y, (levels, noise))| {
                let mut free: Vec<usize> = Vec::with_capacity(self.frames.len());
                let mut values: Vec<f32> = Vec::with_capacity(self.frames.len());
                let rows: Vec<&[(u32, u32, u32)]> =
                    (0..self.frames.len()).map(|i| occupied.map_or(&[][..], |masks| masks[i].row(y))).collect();
                for x in 0..width {
                    let holds = |run: &(u32, u32, u32)| (run.1..run.2).contains(&(x as u32));
                    free.clear();
                    free.extend((0..self.frames.len()).filter(|&i| !rows[i].iter().any(holds)));
                    if free.len() < least {
                        free.clear();
                        free.extend(0..self.frames.len());
                    }
                    let mut spread = 0.0_f32;
                    for channel in 0..3 {
                        let place = (y * width + x) * 3 + channel;
                        values.clear();
                        values.extend(free.iter().map(|&i| tables[i][channel][self.frames[i].1[place] as usize]));
                        let (level, deviation) = level_and_noise(&mut values);
                        levels[x * 3 + channel] = level;
                        spread = spread.max(deviation);
                    }
                    noise[x] = spread;
                }
            },
        );
        let mut sorted: Vec<f64> = noise.iter().step_by(7).map(|&n| f64::from(n)).collect();
        let typical = (median(&mut sorted).unwrap_or(0.0) as f32).max(LEAST_NOISE);
        let precision = noise.iter().map(|&n| 1.0 / n.max(typical)).collect();
        let mut levels = Array3::from_shape_vec((height, width, 3), levels).expect("one level for each sample");
        if occupied.is_none() {
            let limit = FAR * typical.clamp(1.5, 3.0);
            let mut other = self.other_states(&levels, &tables, limit);
            remove_resting(&mut levels, &mut other, 1.5 * limit);
        }
        Background {
            levels,
            precision: Array2::from_shape_vec((height, width), precision).expect("one value for each pixel"),
            noise: typical,
        }
    }

    /// Second state of each pixel, `[height, width, 3]`; NaN where there is none.
    fn other_states(&self, levels: &Array3<f32>, tables: &[[[f32; 256]; 3]], limit: f32) -> Array3<f32> {
        let (height, width, _) = levels.dim();
        let mut other = vec![f32::NAN; height * width * 3];
        other.par_chunks_mut(3).enumerate().for_each(|(place, other)| {
            let pixels = self
                .frames
                .iter()
                .zip(tables)
                .map(|((_, bytes), tables)| [0, 1, 2].map(|c| tables[c][bytes[place * 3 + c] as usize]));
            let level = [0, 1, 2].map(|c| levels[[place / width, place % width, c]]);
            if let Some(state) = other_state(pixels, level, limit) {
                other.copy_from_slice(&state);
            }
        });
        Array3::from_shape_vec((height, width, 3), other).expect("one level for each sample")
    }
}

impl Background {
    /// Size of the frame.
    pub fn size(&self) -> Size {
        Size { width: self.levels.shape()[1], height: self.levels.shape()[0] }
    }

    fn ignore(&mut self, regions: &[Region]) {
        let Size { width, height } = self.size();
        for region in regions {
            for y in region.first[1]..=region.last[1].min(height - 1) {
                for x in region.first[0]..=region.last[0].min(width - 1) {
                    self.precision[[y, x]] = 0.0;
                }
            }
        }
    }
}

/// Median of the pixels that differ from `level` by more than `limit`, where they are many and alike.
fn other_state(pixels: impl Iterator<Item = [f32; 3]>, level: [f32; 3], limit: f32) -> Option<[f32; 3]> {
    let (mut count, mut far) = (0, Vec::new());
    for pixel in pixels {
        count += 1;
        if (0..3).any(|c| (pixel[c] - level[c]).abs() > limit) {
            far.push(pixel);
        }
    }
    if far.len() < 3 || (far.len() as f32) < LEAST_OTHER * count as f32 {
        return None;
    }
    let middle = far.len() / 2;
    let mut state = [0.0; 3];
    for c in 0..3 {
        let mut values: Vec<f32> = far.iter().map(|pixel| pixel[c]).collect();
        state[c] = *values.select_nth_unstable_by(middle, f32::total_cmp).1;
        values.iter_mut().for_each(|value| *value = (*value - state[c]).abs());
        if *values.select_nth_unstable_by(middle, f32::total_cmp).1 > limit {
            return None;
        }
    }
    Some(state)
}

/// Level and noise of one channel of a pixel: mean of the values near the median, and a low rank of the deviations.
fn level_and_noise(values: &mut [f32]) -> (f32, f32) {
    let middle = values.len() / 2;
    let centre = *values.select_nth_unstable_by(middle, f32::total_cmp).1;
    let (mut total, mut count) = (0.0, 0.0);
    for value in values.iter_mut() {
        // Rounded levels repeat, so the mean of near ones is finer than the median.
        if (*value - centre).abs() <= 2.5 {
            total += *value;
            count += 1.0_f32;
        }
        *value = (*value - centre).abs();
    }
    let rank = ((values.len() - 1) as f64 * NOISE_SHARE).round() as usize;
    let deviation = *values.select_nth_unstable_by(rank, f32::total_cmp).1;
    (total / count, deviation / NOISE_RANK)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 4 pixels that rests at x = 2 for 60 % of 30 frames, then at x = 12.
    fn resting() -> Samples {
        let frame = |frame: usize| {
            let left = if frame < 18 { 2 } else { 12 };
            let level = |place: usize| {
                let (x, y) = (place / 3 % 20, place / 60);
                if (left..left + 4).contains(&x) && (6..10).contains(&y) { 200 } else { 50 + (x * 3) as u8 }
            };
            (frame, (0..16 * 20 * 3).map(level).collect())
        };
        Samples::new(Size { width: 20, height: 16 }, (0..30).map(frame).collect())
    }

    #[test]
    fn pixels_are_estimated_from_unoccupied_frames() {
        let mut samples = resting();
        let first = samples.background(&[]);
        assert_eq!(first.levels[[7, 13, 0]], 89.0);
        let masks: Vec<Mask> = samples
            .indices()
            .map(|frame| {
                let left = if frame < 18 { 2 } else { 12 };
                Mask::from_runs((6..10).map(|y| (y, left, left + 4)).collect())
            })
            .collect();
        let second = samples.unoccupied(&masks, &[]);
        for x in 0..20 {
            assert!((second.levels[[7, x, 1]] - (50 + 3 * x) as f32).abs() < 1e-4);
        }
    }

    #[test]
    fn ignored_regions_have_no_precision() {
        let mut samples = resting();
        let background = samples.background(&[Region { first: [0, 0], last: [3, 90] }]);
        assert_eq!(background.precision[[15, 3]], 0.0);
        assert!(background.precision[[15, 4]] > 0.0);
    }
}
