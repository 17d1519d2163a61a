//! Background and noise: robust statistics of each pixel over sampled frames.

use std::array::from_fn;
use std::ops::Range;

use ndarray::{Array2, Array3};
use rayon::prelude::*;

use crate::covered::{covered, distance, fill};
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
/// Distance from the median of values whose mean is taken, levels.
const NEAR: f32 = 2.5;
/// Values that are sorted side by side.
const LANES: usize = 16;
/// Change of exposure, levels, up to which the samples count as equally exposed.
const STEADY: f64 = 0.5;
/// Change of exposure, levels, that may be taken for another state of a pixel: [`FAR`] times the least noise that counts there.
const ANOTHER_STATE: f64 = 9.0;
/// Least noise, levels: rounding and compression.
const LEAST_NOISE: f32 = 0.7;

/// Frames kept to estimate the background.
pub(crate) struct KeptFrames {
    size: Size,
    /// Frame indices and bytes, `[height, width, 3]`.
    frames: Vec<(usize, Vec<u8>)>,
    exposures: Vec<Exposure>,
    covered: Vec<CoveredPixel>,
}

/// Pixel that an object covers in most frames.
struct CoveredPixel {
    at: [usize; 2],
    /// Level of the object, and what stands in the background instead.
    object: [f32; 3],
    scene: [f32; 3],
}

/// Scene without its moving objects.
#[derive(Debug, Clone)]
pub struct StaticScene {
    /// Levels, `[height, width, 3]`.
    pub levels: Array3<f32>,
    /// Reciprocal of the noise, 1/levels, `[height, width]`; zero where a region is ignored.
    pub precision: Array2<f32>,
    /// Median noise over the frame, levels.
    pub noise: f32,
}

impl KeptFrames {
    /// Frames of a range to sample, evenly spread.
    pub(crate) fn chosen(range: &Range<usize>, size: Size, bytes: usize) -> Vec<usize> {
        let room = (bytes / (size.pixels() * 3)).clamp(LEAST_SAMPLED, MOST_SAMPLED);
        let count = room.min(range.len());
        (0..count).map(|i| range.start + (2 * i + 1) * range.len() / (2 * count)).collect()
    }

    /// Samples from frame indices and bytes, `[height, width, 3]`.
    pub(crate) fn new(size: Size, frames: Vec<(usize, Vec<u8>)>) -> Self {
        let exposures = vec![Exposure::default(); frames.len()];
        Self { size, frames, exposures, covered: Vec::new() }
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
    pub(crate) fn background(&mut self, ignore: &[Region]) -> StaticScene {
        // A large change of exposure looks like a second state of every pixel.
        let mut median = self.estimate(None);
        self.expose(&median);
        if self.exposures.iter().all(|e| e.change() < ANOTHER_STATE) {
            self.exposures.fill(Exposure::default());
        } else {
            self.expose(&self.estimate(None));
            median = self.estimate(None);
        }
        let mut background = self.uncovered(median);
        self.expose(&background);
        if self.exposures.iter().any(|e| e.change() >= STEADY) {
            background = self.uncovered(self.estimate(None));
            self.expose(&background);
        }
        background.ignore(ignore);
        background
    }

    /// The median of all samples without what stays in place or covers the same pixels all the time.
    fn uncovered(&mut self, mut background: StaticScene) -> StaticScene {
        let tables: Vec<[[f32; 256]; 3]> = self.exposures.iter().map(Exposure::tables).collect();
        let limit = FAR * background.noise.clamp(1.5, 3.0);
        let mut other = self.other_states(&background.levels, &tables, limit);
        let places = covered(&background.levels, &other);
        let at = |place: &usize| [place / self.size.width, place % self.size.width];
        self.covered.clear();
        let objects: Vec<[f32; 3]> = places.iter().map(|place| background.level(at(place))).collect();
        fill(&mut background.levels, &places);
        for (place, object) in places.iter().zip(objects) {
            let [y, x] = at(place);
            let (filled, seen) = (background.level([y, x]), [0, 1, 2].map(|c| other[[y, x, c]]));
            // What is seen beside the object is the scene, or another part of the object.
            let is_scene = !seen[0].is_nan() && distance(seen, filled) < distance(seen, object);
            let scene = if is_scene { seen } else { filled };
            background.set([y, x], scene);
            self.covered.push(CoveredPixel { at: [y, x], object, scene });
            (0..3).for_each(|c| other[[y, x, c]] = f32::NAN);
        }
        remove_resting(&mut background.levels, &mut other, 1.5 * limit);
        background
    }

    fn expose(&mut self, background: &StaticScene) {
        let levels = background.levels.as_slice().expect("levels are contiguous");
        self.exposures = self.frames.par_iter().map(|(_, bytes)| Exposure::fit(bytes, levels)).collect();
    }

    /// Background from the samples in which a pixel is not occupied. A pixel occupied in nearly all samples keeps the
    /// median of all.
    pub(crate) fn unoccupied(&self, occupied: &[Mask], ignore: &[Region]) -> StaticScene {
        let mut background = self.estimate(Some(occupied));
        for &CoveredPixel { at, object, scene } in &self.covered {
            // Masks with gaps leave the object in it.
            let found = background.level(at);
            if distance(found, object) < distance(found, scene) {
                background.set(at, scene);
            }
        }
        background.ignore(ignore);
        background
    }

    /// Fewest samples in which a pixel is free that give its level.
    fn least_free(&self) -> usize {
        (self.frames.len() / 12).max(3)
    }

    fn estimate(&self, occupied: Option<&[Mask]>) -> StaticScene {
        let Size { width, height } = self.size;
        let tables: Vec<[[f32; 256]; 3]> = self.exposures.iter().map(Exposure::tables).collect();
        let least = self.least_free();
        let mut levels = vec![0.0_f32; width * height * 3];
        let mut noise = vec![0.0_f32; width * height];
        levels.par_chunks_mut(width * 3).zip(noise.par_chunks_mut(width)).enumerate().for_each(
            |(y, (levels, noise))| {
                let mut spreads = vec![0.0_f32; width * 3];
                self.of_row(y, &tables, levels, &mut spreads);
                let rows: Vec<&[(u32, u32, u32)]> =
                    occupied.map_or(Vec::new(), |masks| masks.iter().map(|mask| mask.row(y)).collect());
                for x in partly_occupied(&rows, width) {
                    let holds = |run: &(u32, u32, u32)| (run.1..run.2).contains(&(x as u32));
                    let free: Vec<usize> = (0..rows.len()).filter(|&i| !rows[i].iter().any(holds)).collect();
                    // One that is occupied nearly always keeps what all samples say.
                    if free.len() < least {
                        continue;
                    }
                    let mut values: Vec<[f32; 3]> = free
                        .iter()
                        .map(|&i| {
                            let bytes = &self.frames[i].1[(y * width + x) * 3..];
                            [0, 1, 2].map(|channel| tables[i][channel][bytes[channel] as usize])
                        })
                        .collect();
                    sort_lanes(&mut values);
                    let (level, noise) = level_and_noise(&values);
                    levels[3 * x..3 * x + 3].copy_from_slice(&level);
                    spreads[3 * x..3 * x + 3].copy_from_slice(&noise);
                }
                for (noise, spreads) in noise.iter_mut().zip(spreads.chunks(3)) {
                    *noise = spreads.iter().copied().fold(0.0, f32::max);
                }
            },
        );
        let mut sorted: Vec<f64> = noise.iter().step_by(7).map(|&n| f64::from(n)).collect();
        let typical = (median(&mut sorted).unwrap_or(0.0) as f32).max(LEAST_NOISE);
        let precision = noise.iter().map(|&n| 1.0 / n.max(typical)).collect();
        StaticScene {
            levels: Array3::from_shape_vec((height, width, 3), levels).expect("one level for each sample"),
            precision: Array2::from_shape_vec((height, width), precision).expect("one value for each pixel"),
            noise: typical,
        }
    }

    /// Levels and their noise in all samples of a row, `[width, 3]`.
    fn of_row(&self, y: usize, tables: &[[[f32; 256]; 3]], levels: &mut [f32], spreads: &mut [f32]) {
        let count = self.frames.len();
        let first = y * levels.len();
        let mut sorted = vec![[0.0_f32; LANES]; count];
        for start in (0..levels.len()).step_by(LANES) {
            let lanes = LANES.min(levels.len() - start);
            for ((values, (_, bytes)), tables) in sorted.iter_mut().zip(&self.frames).zip(tables) {
                let bytes = &bytes[first + start..first + start + lanes];
                for (lane, (value, byte)) in values.iter_mut().zip(bytes).enumerate() {
                    *value = tables[(start + lane) % 3][*byte as usize];
                }
            }
            sort_lanes(&mut sorted);
            let (level, noise) = level_and_noise(&sorted);
            levels[start..start + lanes].copy_from_slice(&level[..lanes]);
            spreads[start..start + lanes].copy_from_slice(&noise[..lanes]);
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

impl StaticScene {
    /// Size of the frame.
    pub fn size(&self) -> Size {
        Size { width: self.levels.shape()[1], height: self.levels.shape()[0] }
    }

    /// Level of a row and column.
    fn level(&self, [y, x]: [usize; 2]) -> [f32; 3] {
        [0, 1, 2].map(|c| self.levels[[y, x, c]])
    }

    /// Sets a level that no sample shows.
    fn set(&mut self, [y, x]: [usize; 2], level: [f32; 3]) {
        (0..3).for_each(|c| self.levels[[y, x, c]] = level[c]);
        self.precision[[y, x]] = 1.0 / self.noise;
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

/// Pixels of a row that are occupied in at least one sample.
fn partly_occupied(rows: &[&[(u32, u32, u32)]], width: usize) -> impl Iterator<Item = usize> {
    let mut occupied = vec![false; if rows.is_empty() { 0 } else { width }];
    for run in rows.iter().copied().flatten() {
        occupied[run.1 as usize..(run.2 as usize).min(width)].fill(true);
    }
    occupied.into_iter().enumerate().filter_map(|(x, occupied)| occupied.then_some(x))
}

/// Sorts each lane by itself: the comparisons of a merge sort by odd and even places (Batcher 1968) depend on no value, so that all
/// lanes go through them together.
fn sort_lanes<const N: usize>(rows: &mut [[f32; N]]) {
    let count = rows.len();
    let mut sorted = 1;
    while sorted < count {
        let mut apart = sorted;
        while apart > 0 {
            for start in (apart % sorted..count.saturating_sub(apart)).step_by(2 * apart) {
                for low in start..(start + apart).min(count - apart) {
                    let high = low + apart;
                    if low / (2 * sorted) == high / (2 * sorted) {
                        let (before, after) = rows.split_at_mut(high);
                        for (a, b) in before[low].iter_mut().zip(&mut after[0]) {
                            // One comparison each: the instructions for minima and maxima.
                            (*a, *b) = (if *a < *b { *a } else { *b }, if *a > *b { *a } else { *b });
                        }
                    }
                }
            }
            apart /= 2;
        }
        sorted *= 2;
    }
}

/// Level and noise of each lane, from its sorted values: mean of the values near the median, and a low rank of the deviations.
fn level_and_noise<const N: usize>(sorted: &[[f32; N]]) -> ([f32; N], [f32; N]) {
    let count = sorted.len();
    let middle = sorted[count / 2];
    let rank = ((count - 1) as f64 * NOISE_SHARE).round() as usize;
    // Rounded levels repeat, so the mean of near ones is finer than the median.
    let (mut total, mut near) = ([0.0_f32; N], [0.0_f32; N]);
    for values in sorted {
        for lane in 0..N {
            let away = values[lane] - middle[lane];
            let weight = if away.abs() <= NEAR { 1.0 } else { 0.0 };
            (total[lane], near[lane]) = (total[lane] + weight * away, near[lane] + weight);
        }
    }
    // The deviation of a rank is the least one within which so many sorted values lie.
    let mut deviation = [f32::INFINITY; N];
    for first in (count / 2).saturating_sub(rank)..=(count / 2).min(count - 1 - rank) {
        for lane in 0..N {
            let (below, above) = (middle[lane] - sorted[first][lane], sorted[first + rank][lane] - middle[lane]);
            let away = if below > above { below } else { above };
            deviation[lane] = if away < deviation[lane] { away } else { deviation[lane] };
        }
    }
    (from_fn(|lane| middle[lane] + total[lane] / near[lane]), deviation.map(|away| away / NOISE_RANK))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 4 pixels that rests at x = 2 for 60 % of 30 frames, then at x = 12.
    fn resting() -> KeptFrames {
        let frame = |frame: usize| {
            let left = if frame < 18 { 2 } else { 12 };
            let level = |place: usize| {
                let (x, y) = (place / 3 % 20, place / 60);
                if (left..left + 4).contains(&x) && (6..10).contains(&y) { 200 } else { 50 + (x * 3) as u8 }
            };
            (frame, (0..16 * 20 * 3).map(level).collect())
        };
        KeptFrames::new(Size { width: 20, height: 16 }, (0..30).map(frame).collect())
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
    fn lanes_of_any_number_of_values_are_sorted() {
        for count in 0..40 {
            let value = |row: usize, lane: usize| ((row * 7919 + lane * 104_729) % 31) as f32;
            let mut rows: Vec<[f32; LANES]> =
                (0..count).map(|row| std::array::from_fn(|lane| value(row, lane))).collect();
            sort_lanes(&mut rows);
            for lane in 0..LANES {
                let mut expected: Vec<f32> = (0..count).map(|row| value(row, lane)).collect();
                expected.sort_by(f32::total_cmp);
                assert_eq!(rows.iter().map(|row| row[lane]).collect::<Vec<_>>(), expected);
            }
        }
    }

    /// Of 0, 10, 11, 11, 12, 30: the median by rank is 11, near it lie 10, 11, 11 and 12, and the second smallest deviation is 0, the
    /// third 1.
    #[test]
    fn level_and_noise_are_those_near_the_median() {
        let values = [0.0, 10.0, 11.0, 11.0, 12.0, 30.0];
        assert_eq!(level_and_noise(&values.map(|value| [value])), ([11.0], [1.0 / NOISE_RANK]));
    }

    #[test]
    fn ignored_regions_have_no_precision() {
        let mut samples = resting();
        let background = samples.background(&[Region { first: [0, 0], last: [3, 90] }]);
        assert_eq!(background.precision[[15, 3]], 0.0);
        assert!(background.precision[[15, 4]] > 0.0);
    }
}
