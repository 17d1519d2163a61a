//! Makes datasets: simulates clips, draws them, writes the files. Original: `nn/datasets/generators.py`.
//!
//! Each clip has a random number generator of its own, seeded from the seed, the split and the clip's index: the files
//! do not depend on the number of threads, and a larger dataset begins with the clips of a smaller one.

mod initial;
pub mod render;
mod resize;
mod samples;
pub mod simulate;
pub mod sprites;
pub mod variant;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use ndarray::{Array2, Array3, Array5};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use self::render::Renderer;
use self::samples::write_samples;
use self::simulate::State;
use self::sprites::Sprites;
use self::variant::Variant;
use crate::cli::progress::Progress;
use crate::datasets::files::{ClipShape, DatasetFile, Split};
use crate::datasets::npz;
use crate::datasets::states::{SplitStates, States};
use crate::say;
use crate::support::atomic;
use crate::support::random::fnv1a;
use crate::tasks::Task;
use crate::tasks::scene::{Background, Look};

/// Clips in the training and validation arrays of a long test file; only its test array is used.
const TOKEN_CLIPS: usize = 10;
/// Part of a file's settings text; to be raised whenever the same settings would make other clips.
const GENERATOR_VERSION: u32 = 1;
/// The largest array in an npz without large-file extensions, bytes.
const LARGEST_ARRAY: usize = u32::MAX as usize - 4096;

/// Lines about a file's clips where there is no terminal.
const PLAIN_LINES: usize = 4;

/// Clips in each split.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    pub train: usize,
    pub valid: usize,
    pub test: usize,
}

impl Counts {
    /// Those of the long test file that goes with a training file.
    fn of_test_file(self) -> Self {
        Self { train: self.train.min(TOKEN_CLIPS), valid: self.valid.min(TOKEN_CLIPS), test: self.test }
    }

    fn of(self, split: Split) -> usize {
        match split {
            Split::Train => self.train,
            Split::Valid => self.valid,
            Split::Test => self.test,
        }
    }
}

/// A job for [`generate`].
#[derive(Debug, Clone)]
pub struct Plan {
    pub variant: Variant,
    pub counts: Counts,
    /// Source images of digits and of what lies behind the objects.
    pub sprites: Sprites,
    /// The datasets folder; files go into the task's folder in it.
    pub folder: PathBuf,
    /// Replace files that are there.
    pub force: bool,
}

/// Makes a task's training file and its long test file, each with its true states and a sample picture.
///
/// A file that is there stays, unless the plan forces. Says on standard output what was done.
///
/// # Errors
/// Settings under which no clip can be made, files that cannot be written, or a file in the way that was generated with
/// other settings.
pub fn generate(plan: &Plan) -> Result<()> {
    let task = plan.variant.task;
    for (frames, counts) in [(task.train_frames, plan.counts), (task.test_frames, plan.counts.of_test_file())] {
        let path = plan.folder.join(plan.variant.file(frames));
        let settings = settings(&plan.variant, &plan.sprites, frames, counts);
        if !plan.force && path.exists() {
            keep(plan, &path, frames, &settings)?;
            continue;
        }
        let start = Instant::now();
        npz::make_folder(&path)?;
        atomic::check_place(&path)?;
        let (dataset, states) = generate_clips(&plan.variant, &plan.sprites, frames, counts)
            .with_context(|| format!("cannot make the clips of {path:?}"))?;
        // The dataset comes last: where it is, the rest is, too. It is compressed before, which takes longest: what it
        // replaces stands beside the new states for a moment only.
        let compressed = dataset.compressed(&path)?;
        states.write(&path, &dataset)?;
        write_samples(&path.with_extension("png"), &dataset.test)?;
        npz::write_whole(&path, &compressed)?;
        say!(
            "wrote {} ({} + {} + {} clips of {frames} frames, {:.1} s)",
            path.display(),
            counts.train,
            counts.valid,
            counts.test,
            start.elapsed().as_secs_f64()
        );
    }
    Ok(())
}

/// Decides about a file that is in the way: the same settings, or not generated here (then it is the user's), are fine.
fn keep(plan: &Plan, path: &Path, frames: usize, settings: &str) -> Result<()> {
    let training = ClipShape::training(plan.variant.task);
    let shape = ClipShape { frames, side: plan.variant.side, needed: [false; 3], ..training };
    let advice = || format!("{path:?} is in the way; pass --force to replace it");
    let dataset = DatasetFile::read(path, &shape).with_context(advice)?;
    match States::read(path, &dataset).with_context(advice)? {
        None => say!("kept {}: it is there and was not made by generate; --force replaces it", path.display()),
        Some(states) if states.settings == settings => {
            say!("kept {}: it is there with the same settings; --force makes it again", path.display());
        }
        Some(states) => bail!(
            "{path:?} is there with other settings; pass --force to replace it, or another --out\n  \
             there: {}\n  asked: {settings}",
            states.settings
        ),
    }
    Ok(())
}

/// The settings of a task's test file as it is made with no option but counts (of the training file) and seed.
///
/// # Errors
/// The source images that come with the program are damaged.
pub fn plain_test_settings(task: &'static Task, counts: Counts, seed: u64) -> Result<String> {
    let sprites = Sprites::original()?;
    Ok(settings(&Variant::new(task, seed), &sprites, task.test_frames, counts.of_test_file()))
}

/// All that decides a file's content, as text.
fn settings(variant: &Variant, sprites: &Sprites, frames: usize, counts: Counts) -> String {
    let Variant { task, scene, side, dt, substeps, background, seed } = variant;
    let mut text = format!(
        "generator {GENERATOR_VERSION}, task {}, seed {seed}, clips {}+{}+{} of {frames} frames, side {side}, dt {dt}, \
         substeps {substeps}, {scene:?}",
        task.key, counts.train, counts.valid, counts.test
    );
    // A spring without damping does not speak of it.
    text = text.replace(", damping: 0.0 }", " }");
    if *background != scene.look.background() {
        text += &format!(", background {background:?}");
    }
    if *background != Background::Plain || scene.look == Look::Digits {
        let Sprites { digits: [a, b], pictures } = sprites;
        text += &format!(", source images {:016x}", fnv1a(a.iter().chain(b).chain(pictures)));
    }
    text
}

/// Makes the frames and true states of all three splits, without writing anything, on rayon's current threads.
///
/// # Errors
/// A split without clips or too large for a file, or settings under which no clip can be made.
pub fn generate_clips(
    variant: &Variant,
    sprites: &Sprites,
    frames: usize,
    counts: Counts,
) -> Result<(DatasetFile, States)> {
    for split in Split::ALL {
        let (name, clips) = (split.name(), counts.of(split));
        ensure!(clips > 0, "--{name} must be at least 1");
        let most = LARGEST_ARRAY / (frames * variant.frame_bytes());
        ensure!(clips <= most, "--{name} {clips} makes an array of more than 4 GiB; at most {most} clips fit");
    }
    let renderer = Renderer::new(variant, sprites)?;
    let total = counts.train + counts.valid + counts.test;
    let counter = Counter::new(frames, total);
    let make = |split: Split| make_split(variant, &renderer, split, counts.of(split), frames, &counter);
    let (train, valid, test) = (make(Split::Train)?, make(Split::Valid)?, make(Split::Test)?);
    counter.progress.finish();
    let actions = variant.task.cell.actions.then_some([train.actions, valid.actions, test.actions]);
    let dataset = DatasetFile { train: train.frames, valid: valid.frames, test: test.frames, actions };
    let settings = settings(variant, sprites, frames, counts);
    let truth = Some(variant.truth());
    Ok((dataset, States { train: train.states, valid: valid.states, test: test.states, truth, settings }))
}

/// The clips of one split.
struct Part {
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
) -> Result<Part> {
    let world = variant.world();
    let coordinates = variant.coordinates();
    let clip_bytes = frames * variant.frame_bytes();
    let mut pixels = vec![0; clips * clip_bytes];
    let made: Vec<Vec<State>> = pixels
        .par_chunks_mut(clip_bytes)
        .enumerate()
        .map(|(index, pixels)| {
            let rng = |purpose| clip_rng(variant.seed, purpose, split, index);
            let clip = world.clip(frames, &mut rng(Purpose::Motion))?;
            renderer.draw(&clip, &mut rng(Purpose::Background), pixels);
            counter.advance();
            Ok(clip)
        })
        .collect::<Result<_>>()?;
    let states = || made.iter().flatten();
    let shape = (clips, frames, coordinates);
    let array = |numbers: fn(&State) -> &[f64]| {
        Array3::from_shape_vec(shape, states().flat_map(numbers).map(|&number| number as f32).collect())
    };
    let side = variant.side;
    Ok(Part {
        frames: Array5::from_shape_vec((clips, frames, side, side, variant.task.channels), pixels)?,
        states: SplitStates {
            positions: array(|state| &state.positions)?,
            velocities: array(|state| &state.velocities)?,
        },
        actions: Array2::from_shape_vec((clips, frames), states().map(|state| state.action as f32).collect())?,
    })
}

/// What a clip's random numbers are for.
#[derive(Debug, Clone, Copy)]
enum Purpose {
    Motion,
    /// Apart, so that the same motion is seen before any background.
    Background,
}

/// The random numbers of one clip: a stream of the seed's generator for each (purpose, split, index).
fn clip_rng(seed: u64, purpose: Purpose, split: Split, index: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((purpose as u64) << 60 | (split as u64) << 56 | index as u64);
    rng
}

/// Counts the clips that are ready, on all threads: a bar on a terminal, a line now and then elsewhere.
struct Counter {
    progress: Progress,
    plain: bool,
    total: usize,
    ready: AtomicUsize,
}

impl Counter {
    fn new(frames: usize, total: usize) -> Self {
        let progress = Progress::new(&format!("{frames} frames"), total as u64, 0);
        Self { progress, plain: !std::io::stderr().is_terminal(), total, ready: AtomicUsize::new(0) }
    }

    fn advance(&self) {
        self.progress.step(|| "clips".to_owned());
        let ready = self.ready.fetch_add(1, Ordering::Relaxed) + 1;
        if self.plain && ready * PLAIN_LINES / self.total > (ready - 1) * PLAIN_LINES / self.total {
            self.progress.line(&format!("{ready} of {} clips", self.total));
        }
    }
}
