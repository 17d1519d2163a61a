//! A training as the page follows it: a process of its own that imports the video, learns from its pixels, and notes what it
//! has come to.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::imageops;
use paig::run::{Event, Mode, Observer, Preview, Program, Request, Stage};
use paig::support::run_names::CONFIG;
use paig::training::layers::Overrides;
use paig_video::run::execute;
use serde::{Deserialize, Serialize};

/// Shortest time between two notes, and between two pictures.
const NOTE_EVERY: Duration = Duration::from_millis(700);
const PICTURE_EVERY: Duration = Duration::from_millis(1500);
/// Largest width of the pictures, pixels.
const PICTURE_WIDTH: u32 = 1400;

/// Of the folder of a training.
pub const TASK: &str = "task";
pub const RUN: &str = "run";
/// Arguments of `paig import`, a JSON list.
pub const IMPORT: &str = "import.json";
pub const LIVE: &str = "live.json";
pub const PICTURE: &str = "preview.png";

/// Where a training stands.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Live {
    pub phase: String,
    /// Steps of the phase that are done, and at most to be done; 0 where it takes none.
    pub done: u64,
    pub of: u64,
    pub loss: Option<f64>,
    /// At most, to the end of the training.
    pub seconds_left: Option<f64>,
    /// By their symbols, pixels of a frame and the unit of `dt`.
    pub parameters: BTreeMap<String, f64>,
    /// Pictures that were drawn: the page asks for a new one when it changes.
    pub pictures: u64,
}

/// Imports the video of a training's folder, where that was not done, and trains or goes on to train.
///
/// # Errors
/// A video that cannot be imported, a loss that is not finite, a full disk.
pub fn train(folder: &Path, program: Program, stop: &dyn Fn() -> bool) -> Result<()> {
    let mut live = Notes::new(folder);
    let (task, run) = (folder.join(TASK).join("task.toml"), folder.join(RUN));
    if !task.exists() {
        live.note_phase("import")?;
        let arguments: Vec<String> = serde_json::from_slice(&fs::read(folder.join(IMPORT))?)?;
        let this = std::env::current_exe().context("cannot find this program's own place")?;
        let imported = Command::new(this).args(&arguments).status().context("cannot start the import")?;
        // It has stated why on its own.
        ensure!(imported.success(), "the video was not imported");
    }
    let mode = if run.join(CONFIG).exists() { Mode::Resume } else { Mode::Begin };
    let overrides = Overrides { task: Some(task.display().to_string()), ..Overrides::default() };
    let request = Request { overrides, out: Some(run), mode, ..Request::default() };
    let prepared = request.open()?.prepare(&mut live)?;
    execute(&prepared, program, &mut live, stop)?;
    Ok(())
}

/// Notes of a training, written now and then.
struct Notes<'a> {
    folder: &'a Path,
    live: Live,
    noted: Option<Instant>,
    drawn: Option<Instant>,
}

impl<'a> Notes<'a> {
    fn new(folder: &'a Path) -> Self {
        Notes { folder, live: Live::default(), noted: None, drawn: None }
    }

    fn note_phase(&mut self, phase: &str) -> Result<()> {
        self.live.phase = phase.into();
        self.note()
    }

    fn note(&mut self) -> Result<()> {
        self.noted = Some(Instant::now());
        replace(&self.folder.join(LIVE), &serde_json::to_vec(&self.live)?)
    }

    fn draw(&mut self, preview: &Preview) -> Result<()> {
        let picture = preview.picture()?;
        let shrunk = f64::from(PICTURE_WIDTH.min(picture.width())) / f64::from(picture.width());
        let [width, height] = [picture.width(), picture.height()].map(|it| (f64::from(it) * shrunk).round() as u32);
        let small = imageops::thumbnail(&picture, width.max(1), height.max(1));
        let mut bytes = Vec::new();
        small.write_with_encoder(PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Sub))?;
        replace(&self.folder.join(PICTURE), &bytes)?;
        // From the end, so that drawing that takes long does not fill the time.
        self.drawn = Some(Instant::now());
        self.live.pictures += 1;
        self.note()
    }
}

/// Writes a file in one step. It is not synced, for which the training would wait: the page loses nothing with it.
fn replace(path: &Path, bytes: &[u8]) -> Result<()> {
    let partial = path.with_extension("partial");
    fs::write(&partial, bytes)
        .and_then(|()| fs::rename(&partial, path))
        .with_context(|| format!("cannot write {}", path.display()))
}

fn is_due(last: Option<Instant>, every: Duration) -> bool {
    last.is_none_or(|last| last.elapsed() >= every)
}

impl Observer for Notes<'_> {
    fn observe(&mut self, event: &Event) -> Result<()> {
        match event {
            Event::PhaseBegins { phase, done, of } => {
                (self.live.done, self.live.of) = (*done, *of);
                self.note_phase(phase)
            }
            Event::Step { loss, model, preview, seconds_left } => {
                self.live.done += 1;
                if is_due(self.drawn, PICTURE_EVERY) {
                    self.draw(preview)?;
                }
                if !is_due(self.noted, NOTE_EVERY) {
                    return Ok(());
                }
                (self.live.loss, self.live.seconds_left) = (Some(*loss), *seconds_left);
                self.live.parameters =
                    model.parameter_values().into_iter().map(|(name, value)| (name.into(), value)).collect();
                self.note()
            }
            Event::Recorded { preview: Some(preview), .. } if is_due(self.drawn, PICTURE_EVERY) => self.draw(preview),
            Event::Begun(Stage::Scoring) => self.note_phase("scoring"),
            Event::Begun(Stage::Pictures) => self.note_phase("pictures"),
            Event::Finished { .. } => self.note_phase("measuring"),
            _ => Ok(()),
        }
    }
}
