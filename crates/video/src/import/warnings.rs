//! What a person should look at before training.

use std::ops::Range;

use super::crop::Square;
use super::hold_out::Cut;
use super::motion::{MovingArea, Patch};
use super::reel::{Reel, VideoTake};
use super::request::ImportRequest;
use super::time_base::FrameSpacing;
use paig::support::statistics::upper_median;

/// Share of the moving pixels from which on it is rather the camera that moves.
const ALMOST_ALL: f64 = 0.5;
/// Training clips of one step of the recipe.
const FEW_CLIPS: usize = 25;
/// Clips of validation or test below which their scores are chance.
const FEW_HELD_OUT: usize = 3;
/// Pixels by which what moves should be displaced over the frames that the encoder sees.
const LEAST_WAY: f64 = 1.0;
/// A patch counts as an object where it has this share of the pixels of its frame's largest one.
const LARGE: f64 = 0.25;
/// Pixels that an object should be wide.
const LEAST_WIDTH: f64 = 2.0;
/// Frames a second that cameras have.
const USUAL_RATES: [f64; 12] = [12.5, 15.0, 23.976, 24.0, 25.0, 29.97, 30.0, 48.0, 50.0, 59.94, 60.0, 120.0];
const SAME_RATE: f64 = 0.01;
/// Distance of a frame from an even clock, in intervals, that is more than the rounding of a gif's stamps.
const NOTICED: f64 = 0.16;
/// Part of a video's frames that may be shown twice or left out by a regular clock.
const FEW_CHANGES: f64 = 0.1;

/// `moving` is measured in the frames of each video as a model sees them; `counts` are the clips of each split.
pub(super) fn of(
    request: &ImportRequest,
    reel: &Reel,
    square: Square,
    cut: &Cut,
    moving: &[MovingArea],
    counts: [usize; 3],
) -> Vec<String> {
    let mut warnings = Vec::new();
    for VideoTake { video, kept, .. } in &reel.takes {
        let (name, rate) = (video.name(), request.step as f64 / kept.interval);
        warnings.extend(video.remarks.iter().map(|remark| format!("{name}: {remark}")));
        match kept.clock {
            FrameSpacing::Given => {}
            FrameSpacing::Regular => {
                let interval = kept.interval / request.step as f64;
                if kept.off > NOTICED * interval {
                    warnings.push(format!(
                        "{name}: its frames stand up to {:.1} ms off an even clock of {rate:.3} a second and are taken as even; \
                         `paig measure` takes each at its own time",
                        1e3 * kept.off
                    ));
                }
                if !USUAL_RATES.iter().any(|usual| (rate / usual - 1.0).abs() <= SAME_RATE) {
                    warnings.push(format!(
                        "{name}: {rate:.2} frames a second are unusual; 1 % in the time is 2 % in an acceleration: say \
                         with --fps at how many it was filmed, if you know"
                    ));
                }
            }
            FrameSpacing::Resampled { repeated, left_out } => {
                let changed = (repeated + left_out) as f64 / kept.frames.len() as f64;
                let advice = if changed > FEW_CHANGES { "; film at a constant rate if you can" } else { "" };
                warnings.push(format!(
                    "{name}: its frame rate varies; frames were put onto a clock of {rate:.3} a second, up to {:.1} ms off it, \
                     {repeated} shown twice, {left_out} left out{advice}; `paig measure` takes each frame at its own time",
                    1e3 * kept.off
                ));
            }
        }
    }
    for VideoTake { video, parts, .. } in &reel.takes {
        let short = |part: &Range<usize>, clip: usize| !part.is_empty() && part.len() < clip;
        if short(&parts.train, cut.train_frames)
            || short(&parts.valid, cut.train_frames)
            || short(&parts.test, cut.test_frames)
        {
            warnings.push(format!(
                "{}: a take of {} frames is too short for clips of its own",
                video.name(),
                parts.frames()
            ));
        }
    }
    for (VideoTake { video, .. }, moving) in reel.takes.iter().zip(moving) {
        let (name, share) = (video.name(), moving.typical_share());
        if !moving.any() {
            warnings.push(format!("{name}: nothing moves in the frames as a model sees them"));
        } else if share > ALMOST_ALL {
            warnings.push(format!(
                "{name}: {:.0} % of a typical frame moves; the camera must stand still and the light must not change",
                100.0 * share
            ));
        }
    }
    let ways: Vec<f64> = moving.iter().filter_map(|moving| way(moving, request.input_steps)).collect();
    let furthest = ways.iter().copied().fold(0.0, f64::max);
    if !ways.is_empty() && furthest < LEAST_WAY {
        let step = (LEAST_WAY / furthest.max(0.05)).ceil() as usize * request.step;
        warnings.push(format!(
            "what moves goes only {furthest:.2} pixels over the {} frames that the encoder sees; its velocity is hard to \
             tell: try --step {step}",
            request.input_steps
        ));
    }
    let widest = moving.iter().filter_map(width).fold(0.0, f64::max);
    if widest > 0.0 && widest < LEAST_WIDTH {
        warnings.push(format!(
            "what moves is only about {widest:.1} pixels wide as a model sees it: a smaller --crop or a larger --side than \
             {} shows more of it",
            request.side
        ));
    }
    if counts[0] < FEW_CLIPS {
        warnings.push(format!(
            "{} training clips are few (a step of the recipe takes {FEW_CLIPS}); use more or longer videos",
            counts[0]
        ));
    }
    if counts[1].min(counts[2]) < FEW_HELD_OUT {
        warnings.push(format!(
            "{} validation and {} test clips say little of how good a model is; use more or longer videos",
            counts[1], counts[2]
        ));
    }
    let small = square.side < request.side as u32;
    if small {
        warnings.push(format!(
            "the crop has only {0} x {0} pixels and was enlarged to {1} x {1}; choose a smaller --side",
            square.side, request.side
        ));
    }
    warnings
}

/// Median way of what moves over so many frames, pixels: from each large patch to the nearest one that is seen then. None
/// where too little moves.
fn way(moving: &MovingArea, frames: usize) -> Option<f64> {
    let between = moving.frames.windows(frames.max(2)).map(|seen| (&seen[0].patches, &seen[seen.len() - 1].patches));
    upper_median(between.flat_map(|(first, last)| {
        // The small ones are rather flicker, which stays where it is.
        let largest = first.iter().map(|patch| patch.pixels).max().unwrap_or(0);
        let large = first.iter().filter(move |patch| patch.pixels as f64 >= LARGE * largest as f64);
        large.filter_map(|patch| patch.way_to_nearest(last))
    }))
}

/// Width of the largest thing that moves in a typical frame, pixels; none where nothing moves.
fn width(moving: &MovingArea) -> Option<f64> {
    upper_median(moving.frames.iter().filter_map(|frame| frame.patches.iter().map(Patch::width).max_by(f64::total_cmp)))
}
