//! Times the port's computations, for `speed.py`, which puts the references' beside them.

use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use clap::{Parser, ValueEnum};
use paig::cli::ending::exit_code;
use paig::cli::environment;
use paig::network::cells::Actions;
use paig::network::physics_models::PhysicsNet;
use paig::network::physics_models::losses::{Losses, frame_error};
use paig::support::device;
use paig::tasks;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig::training::optimizers::Optimizer;
use serde_json::json;
use tch::{Device, Kind, Tensor};

/// Repetitions before the clock starts: libraries choose and compile their kernels in the first.
const WARM_UP: usize = 2;
/// Frames that are predicted where only inference is timed.
const PREDICTED: usize = 26;

/// What is timed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum What {
    /// A training step of the original's protocol on clips: all losses, gradients, RMSProp
    Step,
    /// A training step of the autoencoder on single frames
    Discover,
    /// Encoder, roll-out over 26 frames and decoder, without gradients
    Inference,
}

/// Times computations; prints JSON: the `seconds` of each repetition, the `processor_seconds` of one on average, and the
/// largest memory in MB.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[arg(long, help = format!("One of {}", tasks::names()))]
    task: String,
    #[arg(long, value_enum, default_value = "step")]
    what: What,
    /// Clips, or frames of `discover`
    #[arg(long, default_value_t = 25)]
    batch: usize,
    /// Repetitions that are timed; 0 only starts
    #[arg(long, default_value_t = 5)]
    steps: usize,
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// A change of the config, as for `run_physics`: `model.kernels="libtorch"`
    #[arg(long)]
    set: Vec<String>,
}

fn main() -> ExitCode {
    exit_code(|| run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Result<ExitCode> {
    environment::set();
    device::set_threads(arguments.threads)?;
    let (task, recipe, set) = (Some(arguments.task.clone()), Some("paper".into()), arguments.set.clone());
    let config = Config::load(None, &Overrides { task, recipe, set, ..Overrides::default() })?;
    let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, 0)?;
    let mut repeat = repetition(arguments, &config, &model);
    let warm_up = if arguments.steps == 0 { 0 } else { WARM_UP };
    for _ in 0..warm_up {
        repeat()?;
    }
    let busy = processor_seconds()?;
    let mut seconds = Vec::new();
    for _ in 0..arguments.steps {
        let began = Instant::now();
        repeat()?;
        seconds.push(began.elapsed().as_secs_f64());
    }
    let busy = (processor_seconds()? - busy) / arguments.steps.max(1) as f64;
    println!("{}", json!({ "seconds": seconds, "processor_seconds": busy, "peak_mb": peak_memory()? }));
    Ok(ExitCode::SUCCESS)
}

/// What is repeated. What the frames show costs nothing: they are noise.
fn repetition<'a>(
    arguments: &Arguments,
    config: &'a Config,
    model: &'a PhysicsNet,
) -> Box<dyn FnMut() -> Result<()> + 'a> {
    let (system, join) = (&config.task.system, &config.join);
    let variables = model.named_variables();
    let mut optimizer = Optimizer::new(join.optimizer, Some(join.clip_gradients), &variables);
    let clips = |frames: usize| {
        let [batch, frames, channels, side] = [arguments.batch, frames, system.channels, system.side].map(|n| n as i64);
        Tensor::rand([batch, frames, channels, side, side], (Kind::Float, Device::Cpu))
    };
    match arguments.what {
        What::Step => {
            let clips = clips(config.task.train_frames);
            Box::new(move || {
                let pass = model.forward(&clips, &Actions::none())?;
                Losses::new(&pass, &clips, system).train(join.alpha).backward();
                optimizer.step(&variables, |_| join.learning_rate);
                Ok(())
            })
        }
        What::Discover => {
            let frames = clips(1);
            Box::new(move || {
                let [drawn] = model.decoder.draw([&model.coordinates(&model.encoder.forward(&frames.select(1, 0)))]);
                frame_error(model.options.kernels, &drawn.unsqueeze(1), &frames).backward();
                optimizer.step(&variables, |_| join.learning_rate);
                Ok(())
            })
        }
        What::Inference => {
            let clips = clips(system.input_steps + PREDICTED);
            Box::new(move || {
                let _guard = tch::no_grad_guard();
                model.forward(&clips, &Actions::none()).map(drop)
            })
        }
    }
}

/// Of all threads of this process so far, in steps of a hundredth.
fn processor_seconds() -> Result<f64> {
    /// The kernel's clock of processes counts in this unit, whatever the machine's.
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").context("/proc/self/stat")?;
    // Fields 14 and 15, counted from behind the name, which stands in brackets and may hold spaces.
    let fields = stat.rsplit_once(") ").map(|(_, rest)| rest.split(' ').skip(11).take(2));
    let ticks = fields.context("/proc/self/stat has no times")?.map(str::parse::<f64>);
    Ok(ticks.sum::<Result<f64, _>>()? / TICKS_PER_SECOND)
}

/// The most memory that this process had at a time, MB.
fn peak_memory() -> Result<f64> {
    let status = std::fs::read_to_string("/proc/self/status").context("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")).context("/proc/self/status has no VmHWM")?;
    Ok(kilobytes.trim().parse::<f64>()? / 1e3)
}
