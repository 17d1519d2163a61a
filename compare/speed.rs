//! Times the port's computations, for `speed.py`, which puts the references' beside them, and for `cost.py`.

use std::process::ExitCode;
use std::slice;
use std::time::Instant;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use nix::time::{ClockId, clock_gettime};
use paig::generators::source_images::SourceImages;
use paig::generators::variant::Variant;
use paig::generators::{Counts, DatasetJob, generate};
use paig::kernels::{Repeated, own_stream};
use paig::network::cells::{Actions, State};
use paig::network::physics_models::PhysicsNet;
use paig::network::physics_models::losses::{Losses, frame_error};
use paig::network::physics_models::refinement::refine;
use paig::support::device;
use paig::tasks::{self, Task};
use paig::training::config::Config;
use paig::training::identify::Identify;
use paig::training::identify::fit::{FitStart, Trust, fit};
use paig::training::layers::Overrides;
use paig::training::optimizers::Optimizer;
use paig_terminal::say;
use serde_json::json;
use tch::{Cuda, Device, Kind, Tensor};

/// Repetitions before the clock starts: libraries choose and compile their kernels in the first.
const WARM_UP: usize = 2;
/// On a GPU also until a repetition is recorded.
const WARM_UP_ON_GPU: usize = 6;
/// Frames that are predicted where only inference is timed.
const PREDICTED: usize = 26;

/// What is timed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum TimedOperation {
    /// A training step of the original's protocol on clips: all losses, gradients, RMSProp
    Step,
    /// A training step of the autoencoder on single frames
    Discover,
    /// Encoder, roll-out over 26 frames and decoder, without gradients
    Inference,
    /// The same, and the losses of what comes out
    Evaluation,
    /// The states of clips, improved under the equation on their input frames, `model.refinement_steps` times
    Refinement,
    /// The fit of the parameters to the positions of clips
    Identify,
    /// Both files of a dataset, drawn and written: training clips, and a tenth as many to validate and to test
    Generation,
}

/// Times computations; prints JSON: the `seconds` of each repetition, the `processor_seconds` of one on average, and the
/// largest memory in MB.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  paig bench --task spring_color --what step --batch 100")]
pub struct SpeedArguments {
    #[arg(long, help = format!("One of {}, or a task file", tasks::names()))]
    task: String,
    #[arg(long, value_enum, default_value = "step")]
    what: TimedOperation,
    /// Clips, or frames of `discover`
    #[arg(long, default_value_t = 25)]
    batch: usize,
    /// Repetitions that are timed; 0 only starts
    #[arg(long, default_value_t = 5)]
    steps: usize,
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// A change of the config, as for `paig train`: `model.kernels="libtorch"`
    #[arg(long)]
    set: Vec<String>,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
}

/// # Errors
/// A task or a device that is not there.
pub fn run(arguments: &SpeedArguments) -> Result<ExitCode> {
    device::set_threads(arguments.threads)?;
    let device = device::parse(&arguments.device)?;
    own_stream(device)?;
    let (task, recipe, set) = (Some(arguments.task.clone()), Some("paper".into()), arguments.set.clone());
    let config = Config::load(None, &Overrides { task, recipe, set, ..Overrides::default() })?;
    device::set_tf32(device, config.model.tf32);
    let model = PhysicsNet::new(&config.task.system, &config.model, device, 0)?;
    let mut repeat = repetition(arguments, &config, &model)?;
    let (warm_up, wait) = match device {
        _ if arguments.steps == 0 => (0, None),
        Device::Cuda(index) => (WARM_UP_ON_GPU, Some(index as i64)),
        _ => (WARM_UP, None),
    };
    for _ in 0..warm_up {
        repeat()?;
    }
    wait.into_iter().for_each(Cuda::synchronize);
    let busy = processor_seconds()?;
    let mut seconds = Vec::new();
    for _ in 0..arguments.steps {
        let began = Instant::now();
        repeat()?;
        wait.into_iter().for_each(Cuda::synchronize);
        seconds.push(began.elapsed().as_secs_f64());
    }
    let busy = (processor_seconds()? - busy) / arguments.steps.max(1) as f64;
    say!("{}", json!({ "seconds": seconds, "processor_seconds": busy, "peak_mb": peak_memory()? }));
    Ok(ExitCode::SUCCESS)
}

/// What is repeated. What the frames show costs nothing: they are noise.
fn repetition<'a>(
    arguments: &'a SpeedArguments,
    config: &'a Config,
    model: &'a PhysicsNet,
) -> Result<Box<dyn FnMut() -> Result<()> + 'a>> {
    let (system, join) = (&config.task.system, &config.join);
    let variables = model.named_variables();
    let mut optimizer = Optimizer::of_config(join.optimizer, join.clip_gradients, &variables);
    let rates = vec![join.learning_rate; variables.len()];
    let device = model.variables.device();
    let mut repeated = Repeated::on(device);
    let clips = |frames: usize| {
        let [batch, frames, channels, side] = [arguments.batch, frames, system.channels, system.side].map(|n| n as i64);
        Tensor::rand([batch, frames, channels, side, side], (Kind::Float, device))
    };
    Ok(match arguments.what {
        TimedOperation::Step => {
            let clips = clips(config.task.train_frames);
            Box::new(move || {
                optimizer.begin_step(&rates);
                repeated.call(slice::from_ref(&clips), |inputs| {
                    let pass = model.forward(&inputs[0], &Actions::none())?;
                    optimizer.descend(&Losses::new(&pass, &inputs[0], system).train(join.alpha), &variables);
                    Ok(Vec::new())
                })?;
                Ok(())
            })
        }
        TimedOperation::Discover => {
            let frames = clips(1);
            Box::new(move || {
                optimizer.begin_step(&rates);
                repeated.call(slice::from_ref(&frames), |inputs| {
                    let frames = &inputs[0];
                    let [drawn] = model.decoder.draw([&model.coordinates(&model.first_look(&frames.select(1, 0)))]);
                    let loss = frame_error(model.options.kernels, &drawn.unsqueeze(1), frames);
                    optimizer.descend(&loss, &variables);
                    Ok(Vec::new())
                })?;
                Ok(())
            })
        }
        TimedOperation::Refinement => {
            // In single precision, as in a training.
            let positions = trajectories(&config.task, arguments.batch, system.input_steps).to_kind(Kind::Float);
            let numbers: Vec<_> = true_numbers(&config.task).iter().map(|number| number.to_kind(Kind::Float)).collect();
            let (cell, steps) = (system.build_cell(&numbers), config.model.refinement_steps);
            let [before, last] = [2, 1].map(|back| positions.select(1, positions.size()[1] - back));
            let vel = (&last - before) / system.dt;
            Box::new(move || {
                let estimate = State { pos: last.shallow_clone(), vel: vel.shallow_clone() };
                refine(cell.as_ref(), system.dt, &positions, &Actions::none(), estimate, steps);
                Ok(())
            })
        }
        TimedOperation::Identify => {
            let frames = config.task.train_frames;
            let positions = trajectories(&config.task, arguments.batch, frames);
            let identify = Identify { clips: arguments.batch, ..Identify::usual(frames) };
            Box::new(move || {
                let start = FitStart::of(model);
                fit(&identify, system, &positions, &Actions::none(), &start, &Trust::default()).map(drop)
            })
        }
        TimedOperation::Inference | TimedOperation::Evaluation => {
            let clips = clips(system.input_steps + PREDICTED);
            Box::new(move || {
                let _guard = tch::no_grad_guard();
                repeated.call(slice::from_ref(&clips), |inputs| {
                    let pass = model.forward(&inputs[0], &Actions::none())?;
                    let losses = matches!(arguments.what, TimedOperation::Evaluation)
                        .then(|| Losses::new(&pass, &inputs[0], system));
                    let losses = losses.map(|losses| [losses.reconstruction, losses.prediction]);
                    Ok([pass.reconstructions, pass.predictions]
                        .into_iter()
                        .chain(losses.into_iter().flatten())
                        .collect())
                })?;
                Ok(())
            })
        }
        TimedOperation::Generation => {
            let variant = Variant::new(&config.task, 0)?;
            let tenth = arguments.batch.div_ceil(10);
            let folder = tempfile::tempdir().context("a folder for the dataset")?;
            let job = DatasetJob {
                images: SourceImages::of(&variant)?,
                variant,
                counts: Counts { train: arguments.batch, valid: tenth, test: tenth },
                folder: folder.path().into(),
                force: true,
            };
            let threads = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build();
            let threads = threads.context("threads that draw")?;
            Box::new(move || {
                // Kept as long as this is repeated.
                let _folder = &folder;
                Ok(threads.install(|| generate(&job, &|_| ()))?)
            })
        }
    })
}

/// Unconstrained parameters of a task's true values.
fn true_numbers(task: &Task) -> Vec<Tensor> {
    let parameters = task.system.cell.parameters.iter();
    parameters.map(|kind| Tensor::from(kind.bounds.unconstrained(task.truth_of(&kind.name).unwrap_or(1.0)))).collect()
}

/// Positions `[clips, frames, coordinates]`, pixels, float64, of objects that begin on a ring and obey the task's equation.
/// They are seen with an error of a twentieth of a pixel at most. `torch_reference/fit_speed.py` makes the same.
fn trajectories(task: &Task, clips: usize, frames: usize) -> Tensor {
    let system = &task.system;
    let (side, objects) = (system.side as f64, system.objects);
    let place = |object: usize| {
        let (sine, cosine) = (std::f64::consts::TAU * object as f64 / objects as f64).sin_cos();
        [side / 2.0 + side / 4.0 * sine, side / 2.0 + side / 4.0 * cosine]
    };
    let ring: Vec<f64> = (0..objects).flat_map(place).collect();
    let state = [clips, ring.len()];
    let first = State {
        pos: Tensor::from_slice(&ring) + scattered(0, &state) * (side / 20.0),
        vel: scattered(1, &state) * (side / 10.0),
    };
    let cell = system.build_cell(&true_numbers(task));
    let rolled = cell.roll_out(&first, &Actions::none(), system.dt, frames - 1);
    let seen: Vec<_> = std::iter::once(&first).chain(&rolled).map(|state| &state.pos).collect();
    Tensor::stack(&seen, 1) + scattered(2, &[clips, frames, ring.len()]) / 20.0
}

/// Numbers between -1 and 1 without an order, the same in each run and in the reference.
fn scattered(purpose: usize, size: &[usize]) -> Tensor {
    let number = |i: usize| {
        let wide = 43758.5453 * ((1_000_000 * purpose + i + 1) as f64).sin();
        2.0 * (wide - wide.floor()) - 1.0
    };
    let numbers: Vec<_> = (0..size.iter().product()).map(number).collect();
    Tensor::from_slice(&numbers).reshape(size.iter().map(|&length| length as i64).collect::<Vec<_>>())
}

/// Of all threads of this process so far.
fn processor_seconds() -> Result<f64> {
    let spent = clock_gettime(ClockId::CLOCK_PROCESS_CPUTIME_ID).context("the processor's clock")?;
    Ok(spent.tv_sec() as f64 + spent.tv_nsec() as f64 * 1e-9)
}

/// The most memory that this process had at a time, MB.
fn peak_memory() -> Result<f64> {
    let status = std::fs::read_to_string("/proc/self/status").context("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")).context("/proc/self/status has no VmHWM")?;
    Ok(kilobytes.trim().parse::<f64>()? / 1e3)
}
