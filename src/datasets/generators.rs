//! Makes datasets: simulates clips, draws them, writes the files. Original: `nn/datasets/generators.py`.
//!
//! Each clip has a random number generator of its own, seeded from the seed, the split and the clip's index: the files
//! do not depend on the number of threads, and a larger dataset begins with the clips of a smaller one.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use ndarray::{Array3, Array5};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::files::{ClipShape, DatasetFile, Split, checksum};
use super::render::{Balls, CHANNELS, Digits, Renderer, Scratch};
use super::samples::write_samples;
use super::scene::Look;
use super::sprites::Sprites;
use super::states::{SplitStates, States};
use super::variant::Variant;
use crate::progress::Progress;

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
    /// Source images; used by digits only.
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
        let (dataset, states) = generate_clips(&plan.variant, &plan.sprites, frames, counts)
            .with_context(|| format!("cannot make the clips of {path:?}"))?;
        // The dataset comes last: where it is, the rest is, too.
        states.write(&path, &dataset)?;
        write_samples(&path.with_extension("png"), &dataset.test)?;
        dataset.write(&path)?;
        println!(
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
    let shape = ClipShape { task: plan.variant.task.key, frames, side: plan.variant.side, channels: CHANNELS };
    let advice = || format!("{path:?} is in the way; pass --force to replace it");
    let dataset = DatasetFile::read(path, &shape).with_context(advice)?;
    match States::read(path, &dataset).with_context(advice)? {
        None => println!("kept {}: it is there and was not made by generate; --force replaces it", path.display()),
        Some(states) if states.settings == settings => {
            println!("kept {}: it is there with the same settings; --force makes it again", path.display());
        }
        Some(states) => bail!(
            "{path:?} is there with other settings; pass --force to replace it, or another --out\n  \
             there: {}\n  asked: {settings}",
            states.settings
        ),
    }
    Ok(())
}

/// All that decides a file's content, as text.
fn settings(variant: &Variant, sprites: &Sprites, frames: usize, counts: Counts) -> String {
    let Variant { task, scene, side, dt, substeps, seed } = variant;
    let mut text = format!(
        "generator {GENERATOR_VERSION}, task {}, seed {seed}, clips {}+{}+{} of {frames} frames, side {side}, dt {dt}, \
         substeps {substeps}, {scene:?}",
        task.key, counts.train, counts.valid, counts.test
    );
    if scene.look == Look::Digits {
        let Sprites { digits: [a, b], background } = sprites;
        text += &format!(", source images {:016x}", checksum(a.iter().chain(b).chain(background)));
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
    let renderer = match variant.scene.look {
        Look::Balls => Renderer::Balls(Balls::new(variant.side, variant.scene.radius)),
        Look::Digits => Renderer::Digits(Digits::new(variant.side, sprites)?),
    };
    let total = counts.train + counts.valid + counts.test;
    let counter = Counter::new(frames, total);
    let make = |split: Split| make_split(variant, &renderer, split, counts.of(split), frames, &counter);
    let (train, valid, test) = (make(Split::Train)?, make(Split::Valid)?, make(Split::Test)?);
    counter.progress.finish();
    let dataset = DatasetFile { train: train.0, valid: valid.0, test: test.0 };
    let states =
        States { train: train.1, valid: valid.1, test: test.1, settings: settings(variant, sprites, frames, counts) };
    Ok((dataset, states))
}

fn make_split(
    variant: &Variant,
    renderer: &Renderer,
    split: Split,
    clips: usize,
    frames: usize,
    counter: &Counter,
) -> Result<(Array5<u8>, SplitStates)> {
    let world = variant.world();
    let (numbers, frame_bytes) = (2 * variant.objects(), variant.frame_bytes());
    let mut pixels = vec![0; clips * frames * frame_bytes];
    let mut positions = vec![0.0; clips * frames * numbers];
    let mut velocities = positions.clone();
    pixels
        .par_chunks_mut(frames * frame_bytes)
        .zip(positions.par_chunks_mut(frames * numbers))
        .zip(velocities.par_chunks_mut(frames * numbers))
        .enumerate()
        .try_for_each_init(Scratch::default, |scratch, (index, ((pixels, positions), velocities))| {
            let clip = world.clip(frames, &mut clip_rng(variant.seed, split, index))?;
            for (frame, state) in clip.iter().enumerate() {
                renderer.draw(&state.positions, scratch, &mut pixels[frame * frame_bytes..(frame + 1) * frame_bytes]);
                let entries = frame * numbers..(frame + 1) * numbers;
                for (to, from) in positions[entries.clone()].iter_mut().zip(state.positions.iter().flatten()) {
                    *to = *from as f32;
                }
                for (to, from) in velocities[entries].iter_mut().zip(state.velocities.iter().flatten()) {
                    *to = *from as f32;
                }
            }
            counter.advance();
            Ok::<_, anyhow::Error>(())
        })?;
    let pixels = Array5::from_shape_vec((clips, frames, variant.side, variant.side, CHANNELS), pixels)?;
    let shape = (clips, frames, numbers);
    let states = SplitStates {
        positions: Array3::from_shape_vec(shape, positions)?,
        velocities: Array3::from_shape_vec(shape, velocities)?,
    };
    Ok((pixels, states))
}

/// The random numbers of one clip: a stream of the seed's generator for each (split, index).
fn clip_rng(seed: u64, split: Split, index: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((split as u64) << 56 | index as u64);
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
