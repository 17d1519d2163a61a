//! Converts a model's weights to and from PyTorch and TensorFlow. See `paig convert --help`.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use paig::network::physics_models::ModelOptions;
use paig::runs::convert::{check_target, convert};
use paig::support::run_names::CONFIG;
use paig::tasks::{self, Task};
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig_terminal::say;

/// Converts a model's weights between a run's checkpoint or a PyTorch state_dict (.safetensors; both have the same names)
/// and TensorFlow's named variables (.npz). The variables must be exactly those of a model of the task.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  paig convert --task spring_color runs/demo weights.npz\n  \
                  convert --task spring_color weights.npz weights.safetensors")]
pub struct ConvertArguments {
    #[arg(long, help = format!("System that the model was made for: a task file (.toml), or one of {}", tasks::names()))]
    task: String,
    /// The model has the original's other velocity estimator (its --alt_vel)
    #[arg(long)]
    alt_vel: bool,
    /// The model has this parameter fixed and learns the others (model.fixed), for example g=60; may be repeated. A run
    /// folder says by itself what its model is like
    #[arg(long, value_name = "SYMBOL=VALUE")]
    fixed: Vec<String>,
    /// Replace the file to write if it is there
    #[arg(long)]
    force: bool,
    /// What to read: a run folder, a checkpoint, a .safetensors or a .npz file
    from: PathBuf,
    /// File to write: .safetensors or .npz
    to: PathBuf,
}

pub fn run(arguments: &ConvertArguments) -> Result<()> {
    let ConvertArguments { from, to, .. } = arguments;
    let place = check_target(from, to, arguments.force)?;
    let task = tasks::find(&arguments.task)?;
    let count = convert(&task.system, &options(arguments, &task)?, from, &place)?;
    say!("{count} variables from {} to {}", from.display(), to.display());
    Ok(())
}

/// What the model is like: as a run folder's config says, else the original's with what the command line changes.
fn options(arguments: &ConvertArguments, task: &Task) -> Result<ModelOptions> {
    let config = arguments.from.join(CONFIG);
    if !config.exists() {
        let mut set: Vec<_> = arguments.fixed.iter().map(|fixed| format!("model.fixed.{fixed}")).collect();
        set.push(format!("model.alt_vel={}", arguments.alt_vel));
        let overrides = Overrides { recipe: Some("paper".into()), set, ..Overrides::default() };
        return Ok(Config::load_task(task.clone(), None, &overrides)?.model);
    }
    let config = Config::read(&config)?;
    ensure!(config.task.system == task.system, "{} holds a run of task {}", arguments.from.display(), config.task.name);
    ensure!(
        !arguments.alt_vel && arguments.fixed.is_empty(),
        "{} says by itself what its model is like; leave out --alt-vel and --fixed",
        arguments.from.display()
    );
    Ok(config.model)
}
