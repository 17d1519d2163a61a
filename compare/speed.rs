//! Times training steps of the port, for `speed.py`, which puts the references' beside them.

use std::process::ExitCode;
use std::time::Instant;

use anyhow::Result;
use clap::Parser;
use paig::cli::ending::exit_code;
use paig::cli::environment;
use paig::network::cells::Actions;
use paig::network::physics_models::PhysicsNet;
use paig::network::physics_models::losses::Losses;
use paig::support::device;
use paig::tasks;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig::training::optimizers::Optimizer;
use tch::{Device, Kind, Tensor};

/// Steps before the clock starts: libraries choose and compile their kernels in the first.
const WARM_UP: usize = 2;

/// Times training steps of the original's protocol (all losses, RMSProp) on one thread; prints the seconds of each as a JSON
/// list.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[arg(long, help = format!("One of {}", tasks::names()))]
    task: String,
    /// Clips in a step
    #[arg(long, default_value_t = 25)]
    batch: usize,
    /// Steps that are timed
    #[arg(long, default_value_t = 5)]
    steps: usize,
}

fn main() -> ExitCode {
    exit_code(|| run(&Arguments::parse()))
}

fn run(arguments: &Arguments) -> Result<ExitCode> {
    environment::set();
    device::set_threads(1)?;
    let (task, recipe) = (Some(arguments.task.clone()), Some("paper".into()));
    let config = Config::load(None, &Overrides { task, recipe, ..Overrides::default() })?;
    let (task, join) = (&config.task, &config.join);
    let model = PhysicsNet::new(&task.system, &config.model, Device::Cpu, 0)?;
    let variables = model.named_variables();
    let mut optimizer = Optimizer::new(join.optimizer, Some(join.clip_gradients), &variables);
    let [batch, frames, channels, side] =
        [arguments.batch, task.train_frames, task.system.channels, task.system.side].map(|n| n as i64);
    // What the frames show costs nothing.
    let clips = Tensor::rand([batch, frames, channels, side, side], (Kind::Float, Device::Cpu));
    let mut seconds = Vec::new();
    for _ in 0..WARM_UP + arguments.steps {
        let began = Instant::now();
        Losses::new(&model.forward(&clips, &Actions::none())?, &clips, &task.system).train(join.alpha).backward();
        optimizer.step(&variables, |_| join.learning_rate);
        seconds.push(began.elapsed().as_secs_f64());
    }
    println!("{}", serde_json::to_string(&seconds[WARM_UP..])?);
    Ok(ExitCode::SUCCESS)
}
