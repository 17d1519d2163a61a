//! Background of a moving camera: the median of registered frames.

use rayon::prelude::*;

use crate::exposure::Exposure;
use crate::similarity::Similarity;
use crate::video::Size;
use crate::warp::{Warped, warped};

/// Largest background, in frames.
const MOST_FRAMES: f64 = 8.0;

/// Scene pieced together from frames.
pub(crate) struct Mosaic {
    pub(crate) size: Size,
    /// `[height, width, 3]`.
    pub(crate) levels: Vec<f32>,
    /// Frames that show each pixel.
    pub(crate) covered: Vec<u8>,
    /// Levels, rounded.
    rounded: Vec<u8>,
}

/// Every how many-th row gives the exposure.
const ROWS: usize = 13;
/// Change of exposure, levels, from which on it counts.
const VISIBLE: f64 = 0.7;

/// Box around the frames with these poses (from frame to scene): its size, and the scene's place of its first pixel. `None`
/// where it is too large.
pub(crate) fn outline<'a>(size: Size, poses: impl Iterator<Item = &'a Similarity>) -> Option<(Size, [f64; 2])> {
    let (right, bottom) = (size.width as f64 - 1.0, size.height as f64 - 1.0);
    let (mut first, mut last) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for pose in poses {
        for corner in [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]] {
            let place = pose.apply(corner);
            for axis in 0..2 {
                first[axis] = first[axis].min(place[axis]);
                last[axis] = last[axis].max(place[axis]);
            }
        }
    }
    let [width, height] = [0, 1].map(|axis| last[axis].ceil() - first[axis].floor() + 1.0);
    let fits = width * height <= MOST_FRAMES * size.pixels() as f64;
    fits.then(|| (Size { width: width as usize, height: height as usize }, first.map(f64::floor)))
}

impl Mosaic {
    /// Median of frames `(bytes, pose)`; poses map from the frame to the mosaic.
    pub(crate) fn of(frames: &[(&[u8], Similarity)], from: Size, size: Size) -> Self {
        let warp = |(bytes, pose): &(&[u8], Similarity)| {
            warped(bytes, from, &pose.inverse(), size, vec![0; size.pixels() * 3])
        };
        let views: Vec<Warped> = frames.iter().map(warp).collect();
        let mut mosaic = Self::median(&views, size, &vec![Exposure::default(); views.len()]);
        // Automatic exposure changes while a camera turns.
        let exposures: Vec<Exposure> = views.par_iter().map(|view| mosaic.exposure(view)).collect();
        if exposures.iter().any(|exposure| exposure.change() > 1.0) {
            mosaic = Self::median(&views, size, &exposures);
        }
        mosaic
    }

    /// Mosaic of levels, `[height, width, 3]`.
    pub(crate) fn new(size: Size, levels: Vec<f32>, covered: Vec<u8>) -> Self {
        // The conversion saturates.
        let rounded = levels.iter().map(|level| (level + 0.5) as u8).collect();
        Self { size, levels, covered, rounded }
    }

    fn median(views: &[Warped], size: Size, exposures: &[Exposure]) -> Self {
        let tables: Vec<[[f32; 256]; 3]> = exposures.iter().map(Exposure::tables).collect();
        let mut levels = vec![0.0_f32; size.pixels() * 3];
        let mut covered = vec![0_u8; size.pixels()];
        levels.par_chunks_mut(size.width * 3).zip(covered.par_chunks_mut(size.width)).enumerate().for_each(
            |(y, (levels, covered))| {
                let mut values = Vec::with_capacity(views.len());
                let mut shown = Vec::with_capacity(views.len());
                for x in 0..size.width {
                    shown.clear();
                    shown.extend((0..views.len()).filter(|&i| views[i].spans[y].contains(&x)));
                    covered[x] = shown.len().min(255) as u8;
                    if shown.is_empty() {
                        continue;
                    }
                    for c in 0..3 {
                        values.clear();
                        values.extend(
                            shown.iter().map(|&i| tables[i][c][views[i].bytes[(y * size.width + x) * 3 + c] as usize]),
                        );
                        let middle = values.len() / 2;
                        levels[x * 3 + c] = *values.select_nth_unstable_by(middle, f32::total_cmp).1;
                    }
                }
            },
        );
        Self::new(size, levels, covered)
    }

    /// Exposure of a frame relative to the mosaic, from what the frame shows.
    pub(crate) fn exposure(&self, view: &Warped) -> Exposure {
        let (mut bytes, mut levels) = (Vec::new(), Vec::new());
        for (y, span) in view.spans.iter().enumerate().step_by(ROWS) {
            let row = (y * self.size.width + span.start) * 3..(y * self.size.width + span.end) * 3;
            bytes.extend_from_slice(&view.bytes[row.clone()]);
            levels.extend_from_slice(&self.levels[row]);
        }
        Exposure::fit(&bytes, &levels)
    }

    /// A frame in the frame of the mosaic, `[height, width, 3]`; where it does not reach, the mosaic as the frame's exposure would
    /// show it.
    pub(crate) fn completed(&self, frame: &[u8], from: Size, map: &Similarity) -> Vec<u8> {
        let mut view = warped(frame, from, map, self.size, self.rounded.clone());
        let exposure = self.exposure(&view);
        if exposure.change() < VISIBLE {
            return view.bytes;
        }
        let row = 3 * self.size.width;
        for (y, span) in view.spans.iter().enumerate() {
            for place in (y * row..y * row + 3 * span.start).chain(y * row + 3 * span.end..(y + 1) * row) {
                let channel = place % 3;
                let level = exposure.gain[channel] as f32 * self.levels[place] + exposure.offset[channel] as f32;
                // The conversion saturates.
                view.bytes[place] = (level + 0.5) as u8;
            }
        }
        view.bytes
    }
}
