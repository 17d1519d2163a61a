//! Makes datasets: simulates clips, draws them, writes the files. Original: `nn/datasets/generators.py`.
//!
//! Each clip has a random number generator of its own, seeded from the seed, the split and the clip's index: the files
//! do not depend on the number of threads, and a larger dataset begins with the clips of a smaller one.
//!
//! Clips in memory:
//!
//! ```
//! use paig::datasets::files::Split;
//! use paig::datasets::settings::Counts;
//! use paig::generators::{generate_clips, source_images::SourceImages, variant::Variant};
//!
//! let task = paig::tasks::find("spring_color")?;
//! let counts = Counts { train: 2, valid: 1, test: 1 };
//! let variant = Variant::new(&task, 0)?;
//! let (made, _true_states) =
//!     generate_clips(&variant, &SourceImages::original()?, task.train_frames, counts, &|_| {})?;
//! assert_eq!(made.split(Split::Train).dim(), (2, 12, 32, 32, 3));
//! # Ok::<(), anyhow::Error>(())
//! ```

pub mod effects;
pub mod film;
pub(crate) mod forecast;
mod initial;
pub mod noise_floor;
pub mod render;
mod resize;
mod samples;
pub mod simulate;
pub mod source_images;
pub mod streams;
pub mod variant;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use ndarray::{Array2, Array3, Array5};
use rayon::prelude::*;

use self::effects::{develop, expose};
use self::noise_floor::noise_floor;
use self::render::Renderer;
use self::samples::write_samples;
use self::simulate::SceneState;
use self::source_images::SourceImages;
use self::streams::{Purpose, Streams};
use self::variant::Variant;
use crate::datasets::files::{ClipShape, DatasetFile, Split};
use crate::datasets::npz;
pub use crate::datasets::settings::Counts;
use crate::datasets::settings::{self, GENERATOR_VERSION, GeneratorSettings, Provenance};
use crate::datasets::states::{SplitStates, States};
use crate::support::error::Error;
use crate::support::random::fnv1a;
use crate::support::{atomic, guard, memory};
use crate::tasks::Task;

/// Clips in the training and validation arrays of a long test file; only its test array is used.
const TOKEN_CLIPS: usize = 10;
/// The largest array in an npz without large-file extensions, bytes.
const LARGEST_ARRAY: usize = u32::MAX as usize - 4096;

/// Clips in each split of the long test file that goes with a training file of these.
fn of_test_file(counts: Counts) -> Counts {
    Counts { train: counts.train.min(TOKEN_CLIPS), valid: counts.valid.min(TOKEN_CLIPS), test: counts.test }
}

fn of_split(counts: Counts, split: Split) -> usize {
    match split {
        Split::Train => counts.train,
        Split::Valid => counts.valid,
        Split::Test => counts.test,
    }
}

/// What [`generate`] tells while it works; clips are counted on all threads.
#[derive(Debug)]
pub enum GeneratorEvent<'a> {
    /// The clips of a file are begun, `total` in all splits.
    Begins { frames: usize, total: usize },
    /// So many clips are ready.
    Ready { clips: usize, total: usize },
    /// A file was written.
    Wrote { path: &'a Path, clips: Counts, frames: usize, seconds: f64 },
    /// A file that was there was kept; `ours` if it was generated with the same settings.
    Kept { path: &'a Path, ours: bool },
}

/// Who is told.
pub type Watcher<'a> = &'a (dyn Fn(GeneratorEvent) + Sync);

/// What [`generate`] makes.
#[derive(Debug, Clone)]
pub struct DatasetJob {
    pub variant: Variant,
    pub counts: Counts,
    /// Source images of digits and of what lies behind the objects.
    pub images: SourceImages,
    /// The datasets folder; files go into the task's folder in it.
    pub folder: PathBuf,
    /// Replace files that are there.
    pub force: bool,
}

impl DatasetJob {
    /// A task's plain dataset: its scene as it stands, 5000 training clips, 500 each for validation and test, seed 0.
    ///
    /// # Errors
    /// A task without a scene, or one that cannot be filmed.
    pub fn plain(task: &Task, folder: PathBuf) -> Result<Self> {
        let variant = Variant::new(task, 0)?;
        let images = SourceImages::of(&variant)?;
        Ok(DatasetJob { variant, counts: Counts { train: 5000, valid: 500, test: 500 }, images, folder, force: false })
    }
}

/// Makes a task's training file and its long test file, each with its true states and a sample picture.
///
/// A file that is there stays, unless the job forces.
///
/// # Errors
/// Settings under which no clip can be made, a folder that cannot be written, or a file in the way that was generated with
/// other settings.
pub fn generate(job: &DatasetJob, watcher: Watcher) -> Result<(), Error> {
    let begun = AtomicBool::new(false);
    let watch = |event: GeneratorEvent| {
        begun.fetch_or(matches!(event, GeneratorEvent::Begins { .. }), Ordering::Relaxed);
        watcher(event);
    };
    let made = make(job, &watch);
    if begun.into_inner() { made.map_err(Error::of_work) } else { Ok(made?) }
}

fn make(job: &DatasetJob, watcher: Watcher) -> Result<()> {
    guard::check_folder(&job.folder)?;
    for (_, file) in job.variant.files() {
        let path = job.folder.join(file);
        if job.force || !path.exists() {
            check_replaceable(&path)?;
        }
    }
    for ((frames, file), counts) in job.variant.files().into_iter().zip([job.counts, of_test_file(job.counts)]) {
        let path = job.folder.join(file);
        let settings = settings(&job.variant, &job.images, frames, counts);
        if !job.force && path.exists() {
            keep(job, &path, frames, &settings, watcher)?;
            continue;
        }
        let start = Instant::now();
        check_counts(&job.variant, frames, counts)?;
        npz::make_folder(&path)?;
        atomic::check_place(&path)?;
        let (dataset, states) = generate_clips(&job.variant, &job.images, frames, counts, watcher)
            .with_context(|| format!("cannot make the clips of {path:?}"))?;
        // The dataset comes last: where it is, the rest is, too. It is compressed before, which takes longest: what it
        // replaces stands beside the new states for a moment only.
        let compressed = dataset.compressed(&path)?;
        states.write(&path, &dataset)?;
        write_samples(&path.with_extension("png"), &dataset.test)?;
        npz::write_whole(&path, &compressed)?;
        watcher(GeneratorEvent::Wrote { path: &path, clips: counts, frames, seconds: start.elapsed().as_secs_f64() });
    }
    Ok(())
}

/// Refuses to replace what was not generated: a dataset has its true states beside it, with the settings it was made by.
fn check_replaceable(path: &Path) -> Result<()> {
    let strange = || format!("{path:?} was not generated by this program; move it away, or choose another --out");
    let there = [path.to_path_buf(), States::path_beside(path), path.with_extension("png")];
    match there.iter().any(|path| path.exists()) {
        true => States::settings_beside(path).with_context(strange)?.map(drop).with_context(strange),
        false => Ok(()),
    }
}

/// Decides about a file that is in the way: the same settings, or not generated here (then it is the user's), are fine.
fn keep(job: &DatasetJob, path: &Path, frames: usize, settings: &GeneratorSettings, watcher: Watcher) -> Result<()> {
    let training = ClipShape::training(&job.variant.task);
    let shape = ClipShape { frames, side: job.variant.side, needed: [false; 3], ..training };
    let advice = || format!("{path:?} is in the way; pass --force to replace it");
    let dataset = DatasetFile::read(path, &shape).with_context(advice)?;
    let states = States::read(path, &dataset).with_context(advice)?;
    if let Some(difference) = states.as_ref().and_then(|states| states.settings.difference(settings)) {
        bail!("{path:?} is there with other settings; pass --force to replace it, or another --out: {difference}");
    }
    watcher(GeneratorEvent::Kept { path, ours: states.is_some() });
    Ok(())
}

/// The line of a task's test file as it is made with no option but counts (of the training file) and seed; none of a task
/// that is not generated.
///
/// # Errors
/// The source images that come with the program are damaged, or the scene's picture cannot be read.
pub fn plain_test_settings(task: &Task, counts: Counts, seed: u64) -> Result<Option<String>> {
    let Ok(variant) = Variant::new(task, seed) else { return Ok(None) };
    Ok(Some(settings(&variant, &SourceImages::of(&variant)?, task.test_frames, of_test_file(counts)).text()))
}

/// All that decides a file's content; what its noise floor is comes later.
fn settings(variant: &Variant, images: &SourceImages, frames: usize, clips: Counts) -> GeneratorSettings {
    let &Variant { ref task, ref scene, side, dt, substeps, background, seed } = variant;
    let SourceImages { digits: [a, b], pictures } = images;
    let checksum = || fnv1a(a.iter().chain(b).chain(pictures));
    GeneratorSettings {
        format: settings::FORMAT,
        generator: GENERATOR_VERSION,
        task: task.name.clone(),
        seed,
        clips,
        frames,
        side,
        channels: task.system.channels,
        objects: task.system.objects,
        dt,
        substeps,
        scene: scene.clone(),
        background,
        equation: variant.equation_checksum(),
        source_images: GeneratorSettings::draws_pictures(scene.look, background).then(checksum),
        noise_floor: None,
    }
}

/// Makes the frames and true states of all three splits, without writing anything, on rayon's current threads.
///
/// # Errors
/// A split without clips or too large for a file, or settings under which no clip can be made.
pub fn generate_clips(
    variant: &Variant,
    images: &SourceImages,
    frames: usize,
    counts: Counts,
    watcher: Watcher,
) -> Result<(DatasetFile, States)> {
    check_counts(variant, frames, counts)?;
    let renderer = Renderer::new(variant, images)?;
    let total = counts.train + counts.valid + counts.test;
    watcher(GeneratorEvent::Begins { frames, total });
    let counter = Counter { total, ready: AtomicUsize::new(0), watcher };
    let make = |split: Split| make_split(variant, &renderer, split, of_split(counts, split), frames, &counter);
    let (train, valid, test) = (make(Split::Train)?, make(Split::Valid)?, make(Split::Test)?);
    let actions = variant.task.system.cell.actions.then_some([train.actions, valid.actions, test.actions]);
    let dataset = DatasetFile { train: train.frames, valid: valid.frames, test: test.frames, actions };
    let noise_floor = noise_floor(variant, images, frames)?;
    let settings = GeneratorSettings { noise_floor, ..settings(variant, images, frames, counts) };
    let settings = Provenance::Settings(Box::new(settings));
    let truth = Some(variant.truth());
    Ok((dataset, States { train: train.states, valid: valid.states, test: test.states, truth, settings }))
}

/// Refuses what is empty or does not fit into an array or into memory, where it is held together with its frames'
/// compressed form.
fn check_counts(variant: &Variant, frames: usize, counts: Counts) -> Result<()> {
    let clip_bytes = frames * variant.frame_bytes();
    for split in Split::ALL {
        let (name, clips) = (split.name(), of_split(counts, split));
        ensure!(clips > 0, "the {name} split must have at least one clip");
        let most = LARGEST_ARRAY / clip_bytes;
        ensure!(
            clips <= most,
            "{clips} clips in the {name} split make an array of more than 4 GiB; at most {most} fit"
        );
    }
    let clips = counts.train + counts.valid + counts.test;
    memory::ensure_free(2 * (clips * clip_bytes) as u64).with_context(|| format!("{clips} clips of {frames} frames"))
}

/// The clips of one split.
struct SplitClips {
    frames: Array5<u8>,
    states: SplitStates,
    /// `[clips, frames]`.
    actions: Array2<f32>,
}

fn make_split(
    variant: &Variant,
    renderer: &Renderer,
    split: Split,
    clips: usize,
    frames: usize,
    counter: &Counter,
) -> Result<SplitClips> {
    let world = variant.world();
    let camera = &variant.scene.camera;
    let coordinates = variant.coordinates();
    let clip_bytes = frames * variant.frame_bytes();
    let mut pixels = vec![0; clips * clip_bytes];
    let made: Vec<Vec<SceneState>> = pixels
        .par_chunks_mut(clip_bytes)
        .enumerate()
        .map(|(index, pixels)| {
            let streams = Streams { seed: variant.seed, split, index, take: 0 };
            let clip = world.clip(frames, &mut streams.of(Purpose::Motion))?;
            let mut film = renderer.draw(&clip, &streams)?;
            expose(camera, &mut film, &streams);
            develop(camera, &film, pixels)?;
            counter.advance();
            Ok(clip)
        })
        .collect::<Result<_>>()?;
    let states = || made.iter().flatten();
    let shape = (clips, frames, coordinates);
    let array = |numbers: fn(&SceneState) -> &[f64]| {
        Array3::from_shape_vec(shape, states().flat_map(numbers).map(|&number| number as f32).collect())
    };
    let side = variant.side;
    Ok(SplitClips {
        frames: Array5::from_shape_vec((clips, frames, side, side, variant.task.system.channels), pixels)?,
        states: SplitStates {
            positions: array(|state| &state.positions)?,
            velocities: array(|state| &state.velocities)?,
        },
        actions: Array2::from_shape_vec((clips, frames), states().map(|state| state.action as f32).collect())?,
    })
}

/// Counts the clips that are ready, on all threads.
struct Counter<'a> {
    total: usize,
    ready: AtomicUsize,
    watcher: Watcher<'a>,
}

impl Counter<'_> {
    fn advance(&self) {
        let clips = self.ready.fetch_add(1, Ordering::Relaxed) + 1;
        (self.watcher)(GeneratorEvent::Ready { clips, total: self.total });
    }
}
