//! The `meta` text of a whole-model file: which task, which overrides, which optimizer.

use std::collections::BTreeMap;
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};
use paig::network::blocks::side_multiple;
use paig::network::cells::Walls;
use paig::tasks::{self, Task};
use paig::training::optimizers::OptimizerKind;

/// How a whole-model file was made.
#[derive(Debug)]
pub struct Meta {
    /// The task, with the file's side, numbers of frames, learning rate and alpha.
    pub task: Task,
    pub weight_seed: u64,
    pub batch: usize,
    pub alt_vel: bool,
    pub rule: OptimizerKind,
}

impl Meta {
    /// Parses `key=value` pairs with spaces between.
    ///
    /// # Errors
    /// A pair that is missing, unknown, twice there, or out of range.
    pub fn parse(text: &str) -> Result<Self> {
        let mut pairs = BTreeMap::new();
        for pair in text.split_whitespace() {
            let (key, value) = pair.split_once('=').with_context(|| format!("{pair:?} has no ="))?;
            ensure!(pairs.insert(key, value).is_none(), "{key} stands twice");
        }
        let mut take = |key: &'static str| pairs.remove(key).with_context(|| format!("{key} is missing"));
        let mut task = tasks::find(take("task")?)?;
        let weight_seed = number("seed", take("seed")?)?;
        let batch = at_least_one("batch", take("batch")?)?;
        let alt_vel = match take("alt_vel")? {
            "True" => true,
            "False" => false,
            other => bail!("alt_vel is {other:?}, neither True nor False"),
        };
        task.alpha = finite("ae", take("ae")?)?;
        task.base_lr = finite("lr", take("lr")?)?;
        let rule = match take("opt")? {
            "rmsprop" => OptimizerKind::RmsProp,
            "adam" => OptimizerKind::Adam,
            "momentum" => OptimizerKind::Momentum,
            "sgd" => OptimizerKind::Sgd,
            other => bail!("opt {other:?} is none of rmsprop, adam, momentum, sgd"),
        };
        task.train_frames = at_least_one("seq_len", take("seq_len")?)?;
        task.system.input_steps = at_least_one("input_steps", take("input_steps")?)?;
        task.system.pred_steps = at_least_one("pred_steps", take("pred_steps")?)?;
        task.system.side = at_least_one("size", take("size")?)?;
        task.system.walls = Walls::new(task.system.side, task.system.walls.near);
        let multiple = side_multiple(task.system.side);
        ensure!(task.system.side % multiple == 0, "size {} is not a multiple of {multiple}", task.system.side);
        let encoded = task.system.input_steps.saturating_add(task.system.pred_steps);
        ensure!(
            task.train_frames >= encoded,
            "seq_len {} is less than input_steps + pred_steps, {encoded}",
            task.train_frames
        );
        if let Some(key) = pairs.keys().next() {
            bail!("{key} is not known");
        }
        Ok(Meta { task, weight_seed, batch, alt_vel, rule })
    }
}

fn number<T: FromStr>(key: &str, value: &str) -> Result<T>
where
    T::Err: std::error::Error + Send + Sync + 'static,
{
    value.parse().with_context(|| format!("{key}={value}"))
}

fn at_least_one(key: &str, value: &str) -> Result<usize> {
    let parsed: usize = number(key, value)?;
    ensure!(parsed > 0, "{key} is 0");
    Ok(parsed)
}

fn finite(key: &str, value: &str) -> Result<f64> {
    let parsed: f64 = number(key, value)?;
    ensure!(parsed.is_finite(), "{key}={value} is not finite");
    Ok(parsed)
}
