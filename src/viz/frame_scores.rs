//! Similarity and error of each predicted frame, with the boundary between T_pred and T_ext.
//!
//! Paper: the figure of SSIM over predicted frames.

use std::path::Path;

use anyhow::Result;
use plotters::chart::SeriesLabelPosition;
use plotters::style::RGBColor;

use super::chart::{self, BLUE, Chart, Line, ORANGE, Span, Stroke};
use crate::network::System;
use crate::runs::scores::FrameSpread;
use crate::support::error::Error;
use crate::support::output::FileKind;
use crate::support::picture_file;
use crate::support::statistics::Spread;
use crate::tasks::Task;

/// Height of a chart, pixels.
pub const CHART_HEIGHT: u32 = 520;

/// Title of the plot's file.
const TITLE: &str = "paig: scores of predicted frames";
/// The plot as a file that the program recognizes.
pub const FRAME_SCORES: FileKind =
    FileKind { name: "a plot of `paig evaluate`", recognizes: |png| picture_file::has_title(png, TITLE) };

/// Plots SSIM and squared error over the place of a frame in the clip. False and no file if there are no frames.
///
/// # Errors
/// A file that cannot be written.
pub fn write_frame_scores(path: &Path, task: &Task, frames: &[FrameSpread]) -> Result<bool, Error> {
    let plot = chart::drawing(CHART_HEIGHT, frame_charts(task, frames))?;
    plot.iter().try_for_each(|plot| picture_file::write_titled(path, plot.pixels(), TITLE))?;
    Ok(plot.is_some())
}

/// SSIM and squared error over the place of a frame in the clip, of several runs with the band in which they lie.
pub fn frame_charts(task: &Task, frames: &[FrameSpread]) -> Vec<Chart> {
    let spans = frame_spans(&task.system, frames.last().map_or(0, |scores| scores.frame + 1));
    let chart = |title, lines, legend| Chart {
        title: format!("{}: {title} of the predicted frames", task.name),
        axis: "frame",
        values: "",
        spans: spans.clone(),
        lines,
        level: None,
        log: Some(false),
        legend: Some(legend),
    };
    let (similar, wrong) = (lines(BLUE, frames, |at| at.ssim), lines(ORANGE, frames, |at| at.squared_error));
    let similar = chart("structural similarity (SSIM)", similar, SeriesLabelPosition::UpperRight);
    vec![similar, chart("squared error", wrong, SeriesLabelPosition::UpperLeft)]
}

/// Input, T_pred and, as far as clips of `end` frames reach, T_ext.
pub fn frame_spans(system: &System, end: usize) -> Vec<Span> {
    let (input, boundary) = (system.input_steps as f64, (system.input_steps + system.pred_steps) as f64);
    let end = (end as f64).max(input);
    let span = |name: &str, first, last| Span { name: name.into(), first, last };
    let mut spans = vec![span("input", 0.0, input), span("T_pred", input, boundary.min(end))];
    if end > boundary {
        spans.push(span("T_ext", boundary, end));
    }
    spans
}

/// The medians, and behind them the band of the frames in which the runs differ.
fn lines(colour: RGBColor, frames: &[FrameSpread], score: fn(&FrameSpread) -> Spread) -> Vec<Line> {
    let all = frames.iter().map(|frame| (frame.frame as f64, score(frame)));
    let differ = all.clone().filter(|(_, score)| score.min < score.max);
    // Along the least values and back along the greatest.
    let there = differ.clone().map(|(frame, score)| (frame, score.min));
    let back = differ.rev().map(|(frame, score)| (frame, score.max));
    let band: Vec<_> = there.chain(back).collect();
    let label = if band.is_empty() { "mean over the clips" } else { "median of the runs" };
    let medians = all.map(|(frame, score)| (frame, score.median)).collect();
    vec![
        Line { label: "least to greatest".into(), colour, stroke: Stroke::Filled, pieces: vec![band] },
        Line { label: label.into(), colour, stroke: Stroke::Dotted, pieces: vec![medians] },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runs::scores::PredictedFrame;

    #[test]
    fn a_band_encloses_its_median() {
        let run = |ssim: [f64; 2]| {
            [0, 1].map(|at| PredictedFrame { frame: 4 + at, extrapolated: at > 0, squared_error: 1.0, ssim: ssim[at] })
        };
        let runs = [run([0.9, 0.7]), run([0.8, 0.5]), run([1.0, 0.75])];
        let single = lines(BLUE, &FrameSpread::of([&runs[0][..]]), |at| at.ssim);
        assert_eq!((&single[0].pieces[0], &single[1].pieces[0]), (&vec![], &vec![(4.0, 0.9), (5.0, 0.7)]));
        let several = FrameSpread::of(runs.iter().map(|run| &run[..]));
        assert!(!several[0].extrapolated && several[1].extrapolated);
        let several = lines(BLUE, &several, |at| at.ssim);
        assert_eq!(several[0].pieces[0], [(4.0, 0.8), (5.0, 0.5), (5.0, 0.75), (4.0, 1.0)]);
        assert_eq!(several[1].pieces[0], [(4.0, 0.9), (5.0, 0.7)]);
        assert_eq!((several[0].stroke, several[1].stroke), (Stroke::Filled, Stroke::Dotted));
    }
}
