//! Makes a task's dataset files. See `paig generate --help`.

use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use paig::generators::source_images::SourceImages;
use paig::generators::variant::{Changes, Variant};
use paig::generators::{Counts, DatasetJob, generate};
use paig::support::device;
use paig::tasks;
use paig::tasks::scene::{Background, Look};
use paig::training::layers::usual_data_folder;
use paig_terminal::generate_display::GenerateDisplay;

/// Makes the videos of a physical system: a training file of short clips and a test file of long ones.
///
/// Beside each file lie the true positions and velocities (`_states.npz`, used for scoring only) and a picture of a few
/// clips (`.png`). The same seed makes the same files, with any number of threads. Numbers of the scene default to the
/// task's; changed ones appear in the file names.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example:\n  paig generate --task spring_color --out data/datasets \
                  --train 5000 --valid 500 --test 500 --seed 0"
)]
pub struct GenerateArguments {
    #[arg(long, help = format!("System to film: a task file (.toml), or one of {}", tasks::names()))]
    task: String,
    /// Datasets folder; files go into the task's folder in it [default: data/datasets; the folder of the task's file
    /// where its data.folder is "."]
    #[arg(long)]
    out: Option<PathBuf>,
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
    /// Force that holds a ball or digit back, for a velocity of 1 (springs)
    #[arg(long, help_heading = "Scene")]
    damping: Option<f64>,
    /// Strength of gravity (three bodies; falling balls: pixels per squared time unit; pendulum)
    #[arg(long, help_heading = "Scene")]
    g: Option<f64>,
    /// Mass (three bodies: of each; pendulum)
    #[arg(long, help_heading = "Scene")]
    m: Option<f64>,
    /// Length; the frame shows 2.2 to each side of the hub (pendulum)
    #[arg(long, help_heading = "Scene")]
    length: Option<f64>,
    /// Actuation coefficient: what a torque of 1 acts as (pendulum)
    #[arg(long, help_heading = "Scene")]
    a: Option<f64>,
    /// Largest torque; each frame draws one between minus and plus this (pendulum)
    #[arg(long, help_heading = "Scene")]
    torque: Option<f64>,
    /// Largest initial angle to either side of upright, radians (pendulum)
    #[arg(long, help_heading = "Scene")]
    angle: Option<f64>,
    /// Largest initial angular speed, radians per time unit (pendulum)
    #[arg(long, help_heading = "Scene")]
    spin: Option<f64>,
    /// Initial speed to the right or left, pixels per time unit (not for the pendulum)
    #[arg(long, help_heading = "Scene")]
    vx: Option<f64>,
    /// Initial speed up or down, pixels per time unit (not for the pendulum)
    #[arg(long, help_heading = "Scene")]
    vy: Option<f64>,
    /// Radius of a ball, pixels (balls)
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
    /// What lies behind balls or digits: one level, black by default; a CIFAR-10 image, or another one in each clip;
    /// a texture of discs, or another one in each clip; clouds that change slowly; a picture [default: plain; for
    /// digits: cifar]
    #[arg(long, help_heading = "Scene", value_parser = background())]
    background: Option<Background>,
    /// Folder with MNIST's train-images-idx3-ubyte, for other digits than the original's
    #[arg(long, help_heading = "Source images (digits)")]
    mnist_dir: Option<PathBuf>,
    /// The two digits, as indices of MNIST training images
    #[arg(long, help_heading = "Source images (digits)", requires = "mnist_dir")]
    #[arg(num_args = 2, default_values_t = [0, 1])]
    mnist_indices: Vec<usize>,
    /// Folder with CIFAR-10's data_batch_1.bin to data_batch_5.bin (binary version), for another background than the
    /// original's
    #[arg(long, help_heading = "Source images (backgrounds)")]
    cifar_dir: Option<PathBuf>,
    /// The background, as index of a CIFAR-10 training image [default: 1]
    #[arg(long, help_heading = "Source images (backgrounds)", requires = "cifar_dir")]
    cifar_index: Option<usize>,
    /// PNG or JPEG for --background picture; it is scaled to the frame
    #[arg(long, help_heading = "Source images (backgrounds)")]
    picture: Option<PathBuf>,
    /// Threads; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
}

/// Reads a background by its name.
fn background() -> impl TypedValueParser<Value = Background> {
    PossibleValuesParser::new(Background::NAMED.map(|(name, _)| name)).map(|given| {
        let known = Background::NAMED.into_iter().find(|(name, _)| *name == given);
        known.expect("only these names are possible").1
    })
}

pub fn run(arguments: GenerateArguments) -> Result<()> {
    let task = tasks::find(&arguments.task)?;
    let GenerateArguments { k, equil, damping, g, m, length, a, torque, angle, spin, .. } = arguments;
    let GenerateArguments { vx, vy, radius, dt, substeps, size, .. } = arguments;
    let background = arguments.background;
    let changes = Changes {
        k,
        equil,
        damping,
        g,
        m,
        length,
        a,
        torque,
        angle,
        spin,
        vx,
        vy,
        radius,
        dt,
        substeps,
        size,
        background,
    };
    let variant = Variant::new(&task, arguments.seed)?.with(&changes)?;
    let threads = rayon::ThreadPoolBuilder::new().num_threads(device::threads(arguments.threads)?).build();
    let threads = threads.with_context(|| format!("cannot start {} threads", arguments.threads))?;
    let images = source_images(&arguments, &variant)?;
    // Where a training looks for them.
    let folder = arguments.out.unwrap_or_else(|| usual_data_folder(&task, &arguments.task).into());
    let job = DatasetJob {
        variant,
        counts: Counts { train: arguments.train, valid: arguments.valid, test: arguments.test },
        images,
        folder,
        force: arguments.force,
    };
    let display = GenerateDisplay::default();
    Ok(threads.install(|| generate(&job, &|event| display.show(event)))?)
}

fn source_images(arguments: &GenerateArguments, variant: &Variant) -> Result<SourceImages> {
    let task = &variant.task.name;
    let digits = variant.scene.look == Look::Digits;
    ensure!(digits || arguments.mnist_dir.is_none(), "--mnist-dir means nothing for task {task}; leave it out");
    let mut images = SourceImages::of(variant)?;
    if let (Some(folder), &[first, second]) = (&arguments.mnist_dir, &arguments.mnist_indices[..]) {
        images = images.with_mnist(folder, [first, second])?;
    }
    let GenerateArguments { cifar_dir, cifar_index, picture, .. } = arguments;
    let of_cifar = matches!(variant.background, Background::Cifar | Background::RandomCifar);
    ensure!(of_cifar || cifar_dir.is_none(), "--cifar-dir means nothing for task {task} without --background cifar");
    ensure!(
        picture.is_none() || variant.background == Background::Picture,
        "--picture means nothing for task {task} without --background picture"
    );
    match (variant.background, cifar_dir, cifar_index) {
        (Background::RandomCifar, None, _) => bail!("--background random-cifar needs --cifar-dir"),
        (Background::RandomCifar, _, Some(_)) => bail!("--cifar-index means nothing with --background random-cifar"),
        (Background::RandomCifar, Some(folder), None) => images.with_all_cifar(folder),
        (Background::Cifar, Some(folder), index) => images.with_cifar(folder, index.unwrap_or(1)),
        (Background::Picture, ..) => match picture {
            Some(file) => images.with_picture(file, variant.side),
            None if variant.background_look().file.is_some() => Ok(images),
            None => bail!("--background picture needs --picture"),
        },
        _ => Ok(images),
    }
}
