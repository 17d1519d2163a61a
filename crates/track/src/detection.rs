//! Moving regions of every frame.

use std::ops::Range;

use rayon::prelude::*;

use crate::background::{KeptFrames, StaticScene};
use crate::components::{Blob, components};
use crate::difference::{difference, gaussian};
use crate::error::TrackError;
use crate::exposure::Exposure;
use crate::options::TrackingOptions;
use crate::shadow::{Core, core};
use crate::statistics::{median, quantile};
use crate::video::{FrameSource, map_frames};

/// Fewest pixels of a region.
const LEAST_AREA: usize = 5;
/// Share of the largest peak below which a frame shows nothing.
const EMPTY: f64 = 0.25;

/// Moving regions of one frame.
#[derive(Debug, Clone)]
pub(crate) struct Detection {
    pub(crate) frame: usize,
    pub(crate) exposure: Exposure,
    /// Regions by descending weight, each with its part that is no shadow.
    pub(crate) blobs: Vec<(Blob, Core)>,
    /// Share of the frame's pixels above the threshold.
    pub(crate) share: f64,
}

/// Threshold of moving regions in units of the noise, from the peaks of the samples' differences.
///
/// # Errors
/// [`TrackError::NothingMoves`] where no peak exceeds `least_peak`.
pub(crate) fn threshold(
    samples: &KeptFrames,
    background: &StaticScene,
    options: &TrackingOptions,
) -> Result<f32, TrackError> {
    let kernel = gaussian(options.blur);
    let peaks: Vec<f64> = samples
        .frames()
        .par_iter()
        .map(|(_, bytes)| {
            let exposure = exposure(bytes, background);
            let image = difference(bytes, background, &exposure, &kernel);
            f64::from(image.into_iter().fold(0.0, f32::max))
        })
        .collect();
    // One frame with a flash or a cut does not decide.
    let high = quantile(&mut peaks.clone(), 0.95).unwrap_or(0.0);
    if high < f64::from(options.least_peak) {
        return Err(TrackError::NothingMoves { peak: high as f32 });
    }
    let mut moving: Vec<f64> = peaks.into_iter().filter(|&peak| peak > EMPTY * high).collect();
    let typical = median(&mut moving).unwrap_or(high);
    Ok((options.threshold * typical as f32).max(0.7 * options.least_peak))
}

/// Moving regions of a range of frames.
///
/// # Errors
/// Errors of the source.
pub(crate) fn detect(
    video: &dyn FrameSource,
    range: Range<usize>,
    background: &StaticScene,
    threshold: f32,
    options: &TrackingOptions,
) -> Result<Vec<Detection>, TrackError> {
    let kernel = gaussian(options.blur);
    let width = background.size().width;
    let work = |frame: usize, bytes: &[u8]| {
        let exposure = exposure(bytes, background);
        let image = difference(bytes, background, &exposure, &kernel);
        let moving = image.iter().filter(|&&value| value > threshold).count();
        let blobs = components(&image, width, threshold, LEAST_AREA, options.most_movers())
            .into_iter()
            .map(|blob| {
                let core = core(bytes, background, &exposure, &blob.mask);
                (blob, core)
            })
            .collect();
        Detection { frame, exposure, blobs, share: moving as f64 / image.len() as f64 }
    };
    let found = map_frames(video, &|frame| range.contains(&frame), work)?;
    if found.len() < range.len() {
        return Err(TrackError::MissingFrame { frame: range.start + found.len() });
    }
    Ok(found.into_iter().map(|(_, detection)| detection).collect())
}

fn exposure(bytes: &[u8], background: &StaticScene) -> Exposure {
    Exposure::fit(bytes, background.levels.as_slice().expect("levels are contiguous"))
}
