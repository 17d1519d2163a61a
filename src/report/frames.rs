//! Squared error and SSIM of every predicted frame, over the runs of a group.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;

use super::groups::Group;
use super::markdown::{row, table};
use super::statistics::{Spread, significant};
use crate::runs::scores::PredictedFrame;
use crate::tasks::Task;
use crate::viz::{self, ScoreAt};

/// The scores of one predicted frame, each run's averaged over its clips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct FrameSpread {
    /// Place in the clip, from 0.
    pub frame: usize,
    /// In T_ext, not in T_pred.
    pub extrapolated: bool,
    pub squared_error: Spread,
    pub ssim: Spread,
}

/// In the order of time; empty if no run's summary holds them.
pub(super) fn of(group: &Group) -> Vec<FrameSpread> {
    let all = || group.finished().flat_map(|(_, summary)| &summary.test.predicted_frames);
    let mut places: Vec<(usize, bool)> = all().map(|frame| (frame.frame, frame.extrapolated)).collect();
    places.sort_unstable();
    places.dedup();
    let spread = |place, number: fn(&PredictedFrame) -> f64| {
        Spread::of(all().filter(|frame| frame.frame == place).map(number)).expect("each place is of some frame")
    };
    let scores = |(frame, extrapolated)| FrameSpread {
        frame,
        extrapolated,
        squared_error: spread(frame, |frame| frame.squared_error),
        ssim: spread(frame, |frame| frame.ssim),
    };
    places.into_iter().map(scores).collect()
}

/// Plots the scores; false (and no file) if there are none.
pub(super) fn draw(path: &Path, task: &Task, frames: &[FrameSpread]) -> Result<bool> {
    let scores = |spread: fn(&FrameSpread) -> Spread| -> Vec<ScoreAt> {
        let at = |frame: &FrameSpread| {
            let Spread { median, min, max } = spread(frame);
            ScoreAt { frame: frame.frame, value: median, range: (min < max).then_some((min, max)) }
        };
        frames.iter().map(at).collect()
    };
    if !frames.is_empty() {
        viz::write_frame_bands(path, task, &scores(|frame| frame.ssim), &scores(|frame| frame.squared_error))?;
    }
    Ok(!frames.is_empty())
}

/// The scores where T_pred and T_ext begin and end, and half-way through T_ext.
pub(super) fn write(page: &mut String, frames: &[FrameSpread]) -> Result<()> {
    let (extrapolated, predicted): (Vec<&FrameSpread>, Vec<&FrameSpread>) =
        frames.iter().partition(|frame| frame.extrapolated);
    let mut shown = vec![predicted.first(), predicted.last(), extrapolated.first()];
    shown.extend([extrapolated.get(extrapolated.len() / 2), extrapolated.last()]);
    let mut shown: Vec<&FrameSpread> = shown.into_iter().flatten().copied().collect();
    shown.dedup();
    let rows: Vec<_> = shown
        .into_iter()
        .map(|scores| {
            let part = if scores.extrapolated { "T_ext" } else { "T_pred" };
            let (error, ssim) = (scores.squared_error.text(significant), scores.ssim.text(|x| format!("{x:.4}")));
            row(&[scores.frame.to_string(), part.into(), error, ssim])
        })
        .collect();
    if rows.is_empty() {
        return Ok(());
    }
    table(page, &["frame", "part", "squared error", "SSIM"], &rows)
}
