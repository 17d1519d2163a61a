//! What moves in a video: pixels that differ from what stands behind them by more than the noise.

use std::f64::consts::PI;

use image::RgbImage;

use super::crop::CropRectangle;
use super::scaling::scaled;
use paig::support::statistics::upper_median;

/// Frames from which what stands still is measured.
const COMPARED_FRAMES: usize = 200;
/// Longest side at which whole frames are looked at, pixels.
const SEEN_SIDE: u32 = 160;
/// A frame's noise is the median difference of its pixels; what moves differs by more than this many of them, and by so
/// many grey levels, summed over the colours.
const NOISE_LEVELS: u32 = 3;
const LEAST_DIFFERENCE: u32 = 30;
/// Per mille of what moves that may lie outside of the proposed crop, at each side: a hand at the start, a passing shadow.
const OUTSIDE: usize = 5;
/// Margin of the proposed crop, in sides of the box around what moves, on each side.
const MARGIN: f64 = 0.15;
/// Least side of a proposed crop, pixels of the small frames.
const LEAST_SIDE: u32 = 12;

/// Where a frame moves.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingArea {
    width: u32,
    height: u32,
    /// How often each pixel moves, row by row, over all frames looked at.
    times: Vec<u32>,
    pub frames: Vec<MovingFrame>,
}

/// What moves in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingFrame {
    /// Part of all pixels.
    pub share: f64,
    pub patches: Vec<Patch>,
}

/// Moving pixels that touch each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Pixels.
    pub middle: [f64; 2],
    pub pixels: usize,
}

impl Patch {
    /// Pixels from its middle to that of the nearest of others; none without others.
    pub fn way_to_nearest(&self, others: &[Patch]) -> Option<f64> {
        let way = |other: &Patch| (other.middle[0] - self.middle[0]).hypot(other.middle[1] - self.middle[1]);
        others.iter().map(way).min_by(f64::total_cmp)
    }

    /// Diameter of a disc that shows as such a patch, pixels: one is smeared by a pixel to each side.
    pub fn width(&self) -> f64 {
        (2.0 * (self.pixels as f64 / PI).sqrt() - 2.0).max(1.0)
    }
}

/// The places of at most so many of `count` things, evenly spread.
pub fn spread(count: usize, most: usize) -> Vec<usize> {
    let chosen = count.min(most);
    (0..chosen).map(|place| if chosen < 2 { 0 } else { place * (count - 1) / (chosen - 1) }).collect()
}

/// The frames of a video of which a crop is proposed.
pub fn looked_at(count: usize) -> Vec<usize> {
    spread(count, COMPARED_FRAMES)
}

/// A whole frame, small enough to be looked at.
pub fn small(frame: &RgbImage) -> RgbImage {
    let (width, height) = frame.dimensions();
    let scale = f64::from(SEEN_SIDE) / f64::from(width.max(height));
    if scale >= 1.0 {
        return frame.clone();
    }
    let side = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
    scaled(frame, (0, 0), (width, height), (side(width), side(height)))
}

impl MovingArea {
    /// Compares frames of one size with the median over them.
    pub fn measure(frames: &[RgbImage]) -> Self {
        let compared = spread(frames.len(), COMPARED_FRAMES).into_iter().map(|place| &frames[place]);
        let Some(still) = median_frame(compared) else {
            return MovingArea { width: 0, height: 0, times: Vec::new(), frames: Vec::new() };
        };
        let (width, height) = still.dimensions();
        let mut times = vec![0; (width * height) as usize];
        let of_frames = frames.iter().map(|frame| {
            let moves = moving(frame, &still);
            times.iter_mut().zip(&moves).for_each(|(times, moves)| *times += u32::from(*moves));
            let count = moves.iter().filter(|moves| **moves).count();
            let share = count as f64 / f64::from(width * height);
            MovingFrame { share, patches: patches(moves, width as usize) }
        });
        let frames = of_frames.collect();
        MovingArea { width, height, times, frames }
    }

    /// Whether anything moves.
    pub fn any(&self) -> bool {
        self.frames.iter().any(|frame| frame.share > 0.0)
    }

    /// Share of the pixels that move in a typical frame in which any does.
    pub fn typical_share(&self) -> f64 {
        upper_median(self.frames.iter().map(|frame| frame.share).filter(|share| *share > 0.0)).unwrap_or(0.0)
    }

    /// A rectangle around what moves with a margin, in pixels of frames of `width` x `height`; none if nothing moves.
    pub fn rectangle(&self, width: u32, height: u32) -> Option<CropRectangle> {
        let columns: Vec<usize> =
            (0..self.width).map(|x| (0..self.height).map(|y| self.times_at(x, y)).sum()).collect();
        let rows: Vec<usize> = (0..self.height).map(|y| (0..self.width).map(|x| self.times_at(x, y)).sum()).collect();
        let ((left, right), (top, bottom)) = (middle_of(&columns)?, middle_of(&rows)?);
        let margin = MARGIN * f64::from((right - left).max(bottom - top));
        let grown = |start: u32, end: u32, all: u32, full: u32| {
            let lacking = (f64::from(LEAST_SIDE) - f64::from(end - start)).max(0.0) / 2.0;
            let scale = f64::from(full) / f64::from(all);
            let start = ((f64::from(start) - margin.max(lacking)) * scale).max(0.0) as u32;
            let end = ((f64::from(end) + margin.max(lacking)) * scale).ceil().min(f64::from(full)) as u32;
            (start, end)
        };
        let (left, right) = grown(left, right, self.width, width);
        let (top, bottom) = grown(top, bottom, self.height, height);
        Some(CropRectangle { x: left, y: top, width: right - left, height: bottom - top })
    }

    fn times_at(&self, x: u32, y: u32) -> usize {
        self.times[(y * self.width + x) as usize] as usize
    }
}

/// First place and the one after the last between which all but [`OUTSIDE`] at each end lies.
fn middle_of(counts: &[usize]) -> Option<(u32, u32)> {
    let total: usize = counts.iter().sum();
    if total == 0 {
        return None;
    }
    let outside = total * OUTSIDE / 1000;
    let first = |counts: &mut dyn Iterator<Item = &usize>| {
        let mut sum = 0;
        counts
            .take_while(|count| {
                sum += **count;
                sum <= outside
            })
            .count()
    };
    let (start, end) = (first(&mut counts.iter()), counts.len() - first(&mut counts.iter().rev()));
    Some((start as u32, end as u32))
}

/// The median of each level over frames of one size; none without frames.
pub fn median_frame<'a>(frames: impl IntoIterator<Item = &'a RgbImage>) -> Option<RgbImage> {
    let frames: Vec<&RgbImage> = frames.into_iter().collect();
    let (width, height) = frames.first()?.dimensions();
    let mut levels = vec![0; frames.len()];
    let middle = frames.len() / 2;
    let still = (0..frames[0].as_raw().len()).map(|place| {
        levels.iter_mut().zip(&frames).for_each(|(level, frame)| *level = frame.as_raw()[place]);
        *levels.select_nth_unstable(middle).1
    });
    RgbImage::from_raw(width, height, still.collect())
}

/// Which pixels of a frame move. Averaged over 3 x 3 pixels noise falls to a third, an object stays.
fn moving(frame: &RgbImage, still: &RgbImage) -> Vec<bool> {
    let (width, height) = (frame.width() as i64, frame.height() as i64);
    let differences: Vec<i32> =
        frame.as_raw().iter().zip(still.as_raw()).map(|(a, b)| i32::from(*a) - i32::from(*b)).collect();
    let size = |x: i64, y: i64| -> u32 {
        let mut sums = [0_i32; 3];
        let mut count = 0;
        for (x, y) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy))) {
            if (0..width).contains(&x) && (0..height).contains(&y) {
                let place = 3 * (y * width + x) as usize;
                sums.iter_mut().zip(&differences[place..]).for_each(|(sum, difference)| *sum += difference);
                count += 1;
            }
        }
        sums.iter().map(|sum| sum.unsigned_abs()).sum::<u32>() / count
    };
    let sizes: Vec<u32> = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| size(x, y)).collect();
    let mut sorted = sizes.clone();
    let middle = sorted.len() / 2;
    let noise = *sorted.select_nth_unstable(middle).1;
    sizes.iter().map(|size| *size > LEAST_DIFFERENCE.max(NOISE_LEVELS * noise)).collect()
}

/// Moving pixels that touch each other, at a side or a corner.
fn patches(mut moves: Vec<bool>, width: usize) -> Vec<Patch> {
    let mut patches = Vec::new();
    for start in 0..moves.len() {
        if !std::mem::take(&mut moves[start]) {
            continue;
        }
        let (mut pixels, mut sum, mut reached) = (0, [0.0, 0.0], vec![start]);
        while let Some(place) = reached.pop() {
            let (x, y) = (place % width, place / width);
            pixels += 1;
            sum[0] += x as f64 + 0.5;
            sum[1] += y as f64 + 0.5;
            let rows = y.saturating_sub(1)..(y + 2).min(moves.len() / width);
            for beside in rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x)) {
                if std::mem::take(&mut moves[beside]) {
                    reached.push(beside);
                }
            }
        }
        patches.push(Patch { middle: sum.map(|sum| sum / pixels as f64), pixels });
    }
    patches
}
