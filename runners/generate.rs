//! Makes a task's dataset files. See `generate --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use paig::datasets::generators::{Counts, Plan, generate};
use paig::datasets::scene::Look;
use paig::datasets::sprites::Sprites;
use paig::datasets::variant::{Changes, Variant};
use paig::run::exit_code;
use paig::tasks;

/// Makes the videos of a physical system: a training file of short clips and a test file of long ones.
///
/// Beside each file lie the true positions and velocities (`_states.npz`, used for scoring only) and a picture of a few
/// clips (`.png`). The same seed makes the same files, with any number of threads. Numbers of the scene default to the
/// task's; changed ones appear in the file names.
#[derive(Parser)]
#[command(
    version,
    after_help = "Example:\n  generate --task spring_color --out data/datasets \
                  --train 5000 --valid 500 --test 500 --seed 0"
)]
struct Arguments {
    /// System to film
    #[arg(long, value_parser = tasks::TASKS.iter().map(|task| task.key).collect::<Vec<_>>())]
    task: String,
    /// Datasets folder; files go into the task's folder in it
    #[arg(long, default_value = "data/datasets")]
    out: PathBuf,
    /// Clips in the training array (the test file holds 10 of these)
    #[arg(long, default_value_t = 5000)]
    train: usize,
    /// Clips in the validation array (the test file holds 10 of these)
    #[arg(long, default_value_t = 500)]
    valid: usize,
    /// Clips in the test array of each file
    #[arg(long, default_value_t = 500)]
    test: usize,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Spring constant (springs)
    #[arg(long, help_heading = "Scene")]
    k: Option<f64>,
    /// Half the rest length, pixels (springs)
    #[arg(long, help_heading = "Scene")]
    equil: Option<f64>,
    /// Strength of gravity (three bodies)
    #[arg(long, help_heading = "Scene")]
    g: Option<f64>,
    /// Mass of a body (three bodies)
    #[arg(long, help_heading = "Scene")]
    m: Option<f64>,
    /// Initial speed to the right or left, pixels per time unit
    #[arg(long, help_heading = "Scene")]
    vx: Option<f64>,
    /// Initial speed up or down, pixels per time unit
    #[arg(long, help_heading = "Scene")]
    vy: Option<f64>,
    /// Radius of a ball, pixels (not for digits)
    #[arg(long, help_heading = "Scene")]
    radius: Option<f64>,
    /// Time between two frames
    #[arg(long, help_heading = "Scene")]
    dt: Option<f64>,
    /// Euler steps a frame [default: 10]
    #[arg(long, help_heading = "Scene")]
    substeps: Option<usize>,
    /// Side of the frames, pixels
    #[arg(long, help_heading = "Scene")]
    size: Option<usize>,
    /// Folder with MNIST's train-images-idx3-ubyte, for other digits than the original's
    #[arg(long, help_heading = "Source images (digits)")]
    mnist_dir: Option<PathBuf>,
    /// The two digits, as indices of MNIST training images
    #[arg(long, help_heading = "Source images (digits)", requires = "mnist_dir")]
    #[arg(num_args = 2, default_values_t = [0, 1])]
    mnist_indices: Vec<usize>,
    /// Folder with CIFAR-10's data_batch_1.bin to data_batch_5.bin, for another background than the original's
    #[arg(long, help_heading = "Source images (digits)")]
    cifar_dir: Option<PathBuf>,
    /// The background, as index of a CIFAR-10 training image
    #[arg(long, help_heading = "Source images (digits)", requires = "cifar_dir", default_value_t = 1)]
    cifar_index: usize,
    /// Threads; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
}

fn main() -> ExitCode {
    exit_code(run(Arguments::parse()).map(|()| ExitCode::SUCCESS))
}

fn run(arguments: Arguments) -> Result<()> {
    let task = tasks::find(&arguments.task)?;
    let Arguments { k, equil, g, m, vx, vy, radius, dt, substeps, size, .. } = arguments;
    let changes = Changes { k, equil, g, m, vx, vy, radius, dt, substeps, size };
    let variant = Variant::new(task, arguments.seed).with(&changes)?;
    let threads = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build();
    let threads = threads.with_context(|| format!("cannot start {} threads", arguments.threads))?;
    let plan = Plan {
        variant,
        counts: Counts { train: arguments.train, valid: arguments.valid, test: arguments.test },
        sprites: sprites(&arguments, task.scene.look)?,
        folder: arguments.out,
        force: arguments.force,
    };
    threads.install(|| generate(&plan))
}

fn sprites(arguments: &Arguments, look: Look) -> Result<Sprites> {
    let given = arguments.mnist_dir.is_some() || arguments.cifar_dir.is_some();
    ensure!(look == Look::Digits || !given, "--mnist-dir and --cifar-dir mean nothing for task {}", arguments.task);
    let mut sprites = Sprites::original()?;
    if let (Some(folder), &[first, second]) = (&arguments.mnist_dir, &arguments.mnist_indices[..]) {
        sprites = sprites.with_mnist(folder, [first, second])?;
    }
    if let Some(folder) = &arguments.cifar_dir {
        sprites = sprites.with_cifar(folder, arguments.cifar_index)?;
    }
    Ok(sprites)
}
