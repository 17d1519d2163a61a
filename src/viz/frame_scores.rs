//! Similarity and error of each predicted frame, with the boundary between T_pred and T_ext.
//!
//! Paper: the figure of SSIM over predicted frames.

use std::path::Path;

use anyhow::Result;
use plotters::chart::SeriesLabelPosition;
use plotters::style::RGBColor;

use super::chart::{Line, Panel, Phase, Stroke};
use super::curves;
use crate::runs::scores::PredictedFrame;
use crate::tasks::Task;

const PANEL_HEIGHT: u32 = 520;
const BLUE: RGBColor = RGBColor(24, 119, 190);
const ORANGE: RGBColor = RGBColor(222, 106, 16);

/// A score of one predicted frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreAt {
    /// Place in the clip, from 0.
    pub frame: usize,
    /// Of one model, or the median of several.
    pub value: f64,
    /// The least and the greatest of several.
    pub range: Option<(f64, f64)>,
}

/// Plots a model's SSIM and squared error over the place of a frame in the clip, averaged over the clips.
///
/// # Errors
/// A file that cannot be written.
pub fn write_frame_scores(path: &Path, task: &Task, frames: &[PredictedFrame]) -> Result<()> {
    let scores = |value: fn(&PredictedFrame) -> f64| -> Vec<ScoreAt> {
        frames.iter().map(|frame| ScoreAt { frame: frame.frame, value: value(frame), range: None }).collect()
    };
    write_frame_bands(path, task, &scores(|frame| frame.ssim), &scores(|frame| frame.squared_error))
}

/// Plots SSIM and squared error over the place of a frame in the clip, with the bands in which several models lie.
///
/// # Errors
/// A file that cannot be written.
pub fn write_frame_bands(path: &Path, task: &Task, ssim: &[ScoreAt], squared_error: &[ScoreAt]) -> Result<()> {
    let (input, boundary) = (task.input_steps as f64, (task.input_steps + task.pred_steps) as f64);
    let end = ssim.last().map_or(input, |score| score.frame as f64 + 1.0);
    let mut parts = vec![("input", 0.0, input), ("T_pred", input, boundary.min(end))];
    if end > boundary {
        parts.push(("T_ext", boundary, end));
    }
    let parts: Vec<_> =
        parts.into_iter().map(|(name, from, to)| Phase { name: name.into(), steps: (from, to) }).collect();
    let panel = |title: &str, colour: RGBColor, scores: &[ScoreAt], legend| Panel {
        title: format!("{}: {title} of the predicted frames", task.key),
        axis: "frame",
        phases: &parts,
        lines: lines(colour, scores),
        log: Some(false),
        legend,
    };
    let panels = vec![
        panel("structural similarity (SSIM)", BLUE, ssim, SeriesLabelPosition::UpperRight),
        panel("squared error", ORANGE, squared_error, SeriesLabelPosition::UpperLeft),
    ];
    curves::write(path, PANEL_HEIGHT * panels.len() as u32, panels)
}

fn lines(colour: RGBColor, scores: &[ScoreAt]) -> Vec<Line> {
    let points = scores.iter().map(|score| (score.frame as f64, score.value)).collect();
    let edge = |score: &ScoreAt| score.range.map(|(low, high)| (score.frame as f64, low, high));
    let edges: Vec<_> = scores.iter().filter_map(edge).collect();
    let mut lines = Vec::new();
    if !edges.is_empty() {
        // Along the least values and back along the greatest.
        let there = edges.iter().map(|(frame, low, _)| (*frame, *low));
        let back = edges.iter().rev().map(|(frame, _, high)| (*frame, *high));
        let pieces = vec![there.chain(back).collect()];
        lines.push(Line { label: "least to greatest", colour, stroke: Stroke::Filled, pieces });
    }
    let label = if edges.is_empty() { "mean over the clips" } else { "median of the runs" };
    lines.push(Line { label, colour, stroke: Stroke::Dotted, pieces: vec![points] });
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_encloses_its_median() {
        let at = |frame, value, range| ScoreAt { frame, value, range };
        let single = lines(BLUE, &[at(4, 0.9, None), at(5, 0.8, None)]);
        assert_eq!((single.len(), &single[0].pieces[0]), (1, &vec![(4.0, 0.9), (5.0, 0.8)]));
        let several = lines(BLUE, &[at(4, 0.9, Some((0.8, 1.0))), at(5, 0.7, Some((0.5, 0.75)))]);
        assert_eq!(several[0].pieces[0], [(4.0, 0.8), (5.0, 0.5), (5.0, 0.75), (4.0, 1.0)]);
        assert_eq!((several[0].stroke, several[1].stroke), (Stroke::Filled, Stroke::Dotted));
    }
}
