//! The report's figures: scores of every predicted frame, validation losses of the end-to-end baselines, traces of the
//! parameters, and the gallery of future frames.

use std::path::Path;

use anyhow::{Context, Result};
use plotters::style::RGBColor;
use tch::Tensor;

use super::list::{BaselineEntry, Comparison};
use super::results::{BaselineRow, FRAMES, PredictedFrames, VALIDATION_ERROR};
use paig::datasets::npz;
use paig::runs::scores::{FrameSpread, PredictedFrame};
use paig::support::statistics::Spread;
use paig::tasks::Task;
use paig::viz;
use paig::viz::chart::{self, Chart, GREEN, Line, Span, Stroke};

/// One for each model, in the order of the list.
const COLOURS: [RGBColor; 11] = [
    RGBColor(20, 20, 20),
    RGBColor(120, 128, 140),
    RGBColor(24, 119, 190),
    RGBColor(105, 180, 230),
    RGBColor(196, 40, 58),
    RGBColor(222, 106, 16),
    RGBColor(240, 178, 60),
    RGBColor(120, 80, 170),
    RGBColor(200, 110, 190),
    RGBColor(36, 145, 84),
    RGBColor(110, 90, 60),
];
/// Height of a chart, pixels.
const HEIGHT: u32 = 620;
/// Columns of a gallery, at most.
const COLUMNS: usize = 9;
/// Stands for the model, and for its label, where the frames are the true ones.
const TRUTH: &str = "truth";

/// What a task's figures show.
#[derive(Debug, Clone, Copy)]
pub struct OfTask<'a> {
    pub list: &'a Comparison,
    pub task: &'a Task,
    /// Finished trainings of the task on all clips.
    pub rows: &'a [BaselineRow],
}

/// A model in a task's figures.
struct FigureModel<'a> {
    entry: &'a BaselineEntry,
    colour: RGBColor,
    rows: Vec<&'a BaselineRow>,
}

impl OfTask<'_> {
    /// Each model that has any rows.
    fn models(&self) -> impl Iterator<Item = FigureModel<'_>> {
        let models = self.list.models.iter().zip(COLOURS.iter().cycle());
        models.filter_map(|(entry, &colour)| {
            let rows: Vec<_> = self.rows.iter().filter(|row| row.model == entry.name).collect();
            (!rows.is_empty()).then_some(FigureModel { entry, colour, rows })
        })
    }

    /// SSIM and squared error of every predicted frame, a line for each model and a band over its seeds.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn frame_scores(&self, path: &Path) -> Result<bool> {
        let system = &self.task.system;
        let similar = |at: &FrameSpread| at.ssim;
        let wrong = |at: &FrameSpread| at.squared_error;
        let chart = |title: &'static str, score: fn(&FrameSpread) -> Spread, log| Chart {
            title: format!("{}: {title} of the predicted frames", self.task.name),
            axis: "frame",
            values: title,
            spans: viz::frame_spans(system, self.task.test_frames),
            lines: self.models().flat_map(|model| self.lines(&model, score)).collect(),
            level: None,
            log: Some(log),
            legend: None,
        };
        let charts = vec![chart("structural similarity (SSIM)", similar, false), chart("squared error", wrong, true)];
        chart::write(path, HEIGHT, charts)
    }

    fn lines(&self, shown: &FigureModel, score: fn(&FrameSpread) -> Spread) -> Vec<Line> {
        let FigureModel { entry, colour, rows } = shown;
        let system = &self.task.system;
        let frames: Vec<Vec<PredictedFrame>> =
            rows.iter().map(|row| row.frame_scores(system.input_steps, system.pred_steps)).collect();
        let spreads = FrameSpread::of(frames.iter().map(Vec::as_slice));
        let all = spreads.iter().map(|frame| (frame.frame as f64, score(frame)));
        let there = all.clone().map(|(frame, score)| (frame, score.min));
        let back = all.clone().rev().map(|(frame, score)| (frame, score.max));
        let band = if rows.len() > 1 { there.chain(back).collect() } else { Vec::new() };
        let medians = all.map(|(frame, score)| (frame, score.median)).collect();
        let (label, colour) = (format!("{} ({})", entry.label, rows.len()), *colour);
        let line = Line { label, colour, stroke: Stroke::Dotted, pieces: vec![medians] };
        match band.is_empty() {
            true => vec![line],
            false => vec![Line { label: String::new(), colour, stroke: Stroke::Filled, pieces: vec![band] }, line],
        }
    }

    /// L_pred of the black boxes on validation clips over the steps: whether they were done.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn black_boxes(&self, path: &Path) -> Result<bool> {
        self.errors(path, "L_pred of validation clips of every run", |entry| entry.whole.is_none())
    }

    /// Validation error over the steps of the end-to-end baselines: whether they were done.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn end_to_end(&self, path: &Path) -> Result<bool> {
        self.errors(path, "squared error of all predicted frames of validation clips, every run", |entry| {
            entry.whole.is_some()
        })
    }

    /// The error on validation clips over the steps, of every run of these models.
    fn errors(&self, path: &Path, error: &str, shown: impl Fn(&BaselineEntry) -> bool) -> Result<bool> {
        let lines = self.courses(VALIDATION_ERROR, shown);
        let title = format!("{}: {error}", self.task.name);
        let chart = Chart { log: Some(true), ..over_steps(title, "squared error", lines) };
        chart::write(path, HEIGHT, vec![chart])
    }

    /// The course of each physical parameter, a line for each run: of the models that begin with found objects, and, over more
    /// steps, of those that find their own.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn parameters(&self, path: &Path) -> Result<bool> {
        let mut charts = Vec::new();
        for parameter in &*self.task.system.cell.parameters {
            for (own_objects, which) in [(false, "begun with found objects"), (true, "with objects of its own")] {
                let lines = self.courses(&parameter.name, |entry| entry.own_objects == own_objects);
                let title = format!("{}: {} of every run {which}", self.task.name, parameter.name);
                let level = self.task.truth_of(&parameter.name).map(|truth| ("true value", GREEN, truth));
                charts.push(Chart { level, ..over_steps(title, "value", lines) });
            }
        }
        chart::write(path, HEIGHT, charts)
    }

    /// The course of one number over the steps, a line for each run in the colour of its model; of these models.
    fn courses(&self, number: &str, shown: impl Fn(&BaselineEntry) -> bool) -> Vec<Line> {
        let lines = self.models().filter(|model| shown(model.entry)).map(|FigureModel { entry, colour, rows }| {
            let courses = rows.iter().filter_map(|row| row.courses.get(number).cloned());
            Line { label: entry.label.clone(), colour, stroke: Stroke::Dotted, pieces: courses.collect() }
        });
        lines.filter(|line| !line.pieces.is_empty()).collect()
    }

    /// Future frames of the first test clip that a gallery shows.
    fn columns(&self) -> Vec<usize> {
        let future = self.task.test_frames - self.task.system.input_steps;
        (0..future).step_by(future.div_ceil(COLUMNS)).collect()
    }

    /// Rows of the gallery, `[columns, C, S, S]` under their labels: the true frames, then those of each model's first seed.
    /// Each row is also written into the folder `strips`, from where a later report takes it.
    ///
    /// # Errors
    /// A training without its frames, a file that cannot be written.
    pub fn gallery_rows(&self, strips: &Path) -> Result<Vec<(String, Tensor)>> {
        let columns = self.columns();
        let mut rows: Vec<(String, Tensor)> = Vec::new();
        for FigureModel { entry, rows: of_model, .. } in self.models() {
            let first = of_model[0];
            let Some(source) = &first.frames else { continue };
            let truth = rows.is_empty().then_some((TRUTH, TRUTH));
            for (label, name) in truth.into_iter().chain([(entry.label.as_str(), entry.name.as_str())]) {
                let frames = self.shown(source, name, &columns)?;
                viz::write_strip(&strips.join(self.strip(name)), &frames)?;
                rows.push((label.into(), frames));
            }
        }
        Ok(rows)
    }

    /// Future frames of the first test clip, those of each model below the true ones.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn gallery(&self, path: &Path, rows: &[(String, Tensor)]) -> Result<bool> {
        if rows.is_empty() {
            return Ok(false);
        }
        let system = &self.task.system;
        let places: Vec<usize> = self.columns().iter().map(|column| system.input_steps + column).collect();
        viz::write_gallery(path, system, rows, &places)?;
        Ok(true)
    }

    fn strip(&self, name: &str) -> String {
        format!("{}-{name}.png", self.task.name)
    }

    /// The frames of these columns, `[columns, C, S, S]`: a model's, or the true ones.
    fn shown(&self, source: &PredictedFrames, name: &str, columns: &[usize]) -> Result<Tensor> {
        let folder = match source {
            PredictedFrames::Report(report) => {
                return viz::read_strip(&report.join(FRAMES).join(self.strip(name)), columns.len());
            }
            PredictedFrames::Run(folder) => folder,
        };
        // The true frames begin with the input, the predicted ones after it.
        let (array, before) = if name == TRUTH { ("input", self.task.system.input_steps) } else { ("output", 0) };
        let frames = first_clip(&folder.join("outputs.npz"), array)?;
        let columns: Vec<i64> = columns.iter().map(|column| (before + column) as i64).collect();
        Ok(frames.index_select(0, &Tensor::from_slice(&columns)))
    }
}

/// A chart of lines over the steps to the last of them.
fn over_steps(title: String, values: &'static str, lines: Vec<Line>) -> Chart {
    let steps = lines.iter().flat_map(|line| line.pieces.iter().flatten()).map(|(step, _)| *step);
    let spans = vec![Span { name: String::new(), first: 0.0, last: steps.fold(1.0, f64::max) }];
    Chart { title, axis: "step", values, spans, lines, level: None, log: None, legend: None }
}

/// The first clip of an array `[clips, frames, S, S, C]`, `[frames, C, S, S]`.
fn first_clip(path: &Path, name: &str) -> Result<Tensor> {
    let array = npz::Archive::open(path)?.floats(name)?;
    let shape: Vec<i64> = array.shape().iter().map(|&n| n as i64).collect();
    let array = array.as_standard_layout();
    let values = array.as_slice().with_context(|| format!("{}: array {name}", path.display()))?;
    Ok(Tensor::from_slice(values).reshape(&shape).get(0).permute([0, 3, 1, 2]))
}
