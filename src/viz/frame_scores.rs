//! Similarity and error of each predicted frame, with the boundary between T_pred and T_ext.
//!
//! Paper: the figure of SSIM over predicted frames.

use std::path::Path;

use anyhow::Result;
use plotters::chart::SeriesLabelPosition;
use plotters::style::RGBColor;

use super::chart::{Line, Panel, Phase, Stroke};
use super::curves;
use crate::evaluation::PredictedFrame;
use crate::tasks::Task;

const PANEL_HEIGHT: u32 = 520;
const BLUE: RGBColor = RGBColor(24, 119, 190);
const ORANGE: RGBColor = RGBColor(222, 106, 16);

/// Plots SSIM and squared error over the place of a frame in the clip, averaged over the clips.
///
/// # Errors
/// A file that cannot be written.
pub fn write_frame_scores(path: &Path, task: &Task, frames: &[PredictedFrame]) -> Result<()> {
    let (input, boundary) = (task.input_steps as f64, (task.input_steps + task.pred_steps) as f64);
    let end = frames.last().map_or(input, |frame| frame.frame as f64 + 1.0);
    let mut parts = vec![("input", 0.0, input), ("T_pred", input, boundary.min(end))];
    if end > boundary {
        parts.push(("T_ext", boundary, end));
    }
    let parts: Vec<_> =
        parts.into_iter().map(|(name, from, to)| Phase { name: name.into(), steps: (from, to) }).collect();
    let panel = |title: &str, label: &'static str, colour: RGBColor, value: fn(&PredictedFrame) -> f64, legend| Panel {
        title: format!("{}: {title}", task.key),
        axis: "frame",
        phases: &parts,
        lines: vec![Line {
            label,
            colour,
            stroke: Stroke::Dotted,
            pieces: vec![frames.iter().map(|frame| (frame.frame as f64, value(frame))).collect()],
        }],
        log: Some(false),
        legend,
    };
    let panels = vec![
        panel(
            "structural similarity of the predicted frames",
            "SSIM",
            BLUE,
            |f| f.ssim,
            SeriesLabelPosition::UpperRight,
        ),
        panel(
            "squared error of the predicted frames",
            "squared error",
            ORANGE,
            |frame| frame.squared_error,
            SeriesLabelPosition::UpperLeft,
        ),
    ];
    curves::write(path, PANEL_HEIGHT * panels.len() as u32, panels)
}
