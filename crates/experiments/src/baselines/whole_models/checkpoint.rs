//! How far a training has come, in one file that is replaced in one step: weights, Adam's slots, the step, and the weights of
//! the best validation; and which clips they were learned from.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use tch::{Kind, Tensor};

use super::frame_model::{FrameModel, named_variables};
use super::scores::Validation;
use paig::runs::weights;
use paig::support::storage;
use paig::training::optimizers::{Optimizer, OptimizerKind};

const CHECKPOINT: &str = "checkpoint.safetensors";
/// Checksums of the clips: the letters of their text.
const CLIPS: &str = "clips";
/// Step and seconds, with step and error of the best validation; and what stands before the name of a slot, and of a weight at
/// the best validation.
const PROGRESS: &str = "progress";
const SLOT: &str = "slot/";
const BEST: &str = "best/";

/// How far a training has come.
#[derive(Debug, Default)]
pub(super) struct Progress {
    pub step: u64,
    /// Of computing.
    pub seconds: f64,
    /// None before the first checkpoint, and of a checkpoint of an earlier version.
    pub best: Option<Best>,
    /// Checksums of the clips that it learns from; empty where nobody says them, and in a checkpoint of an earlier version.
    pub clips: String,
}

/// The weights at the least validation error so far.
#[derive(Debug)]
pub(super) struct Best {
    pub validation: Validation,
    weights: Vec<(String, Tensor)>,
}

impl Best {
    /// The weights as they are now.
    pub fn of(validation: Validation, variables: &[(String, Tensor)]) -> Self {
        let weights = variables.iter().map(|(name, variable)| (name.clone(), variable.detach().copy()));
        Best { validation, weights: weights.collect() }
    }

    /// Gives a model's variables, in their order, these weights.
    pub fn fill(&self, variables: &[(String, Tensor)]) {
        let _guard = tch::no_grad_guard();
        variables.iter().zip(&self.weights).for_each(|((_, variable), (_, weight))| {
            variable.shallow_clone().copy_(weight);
        });
    }
}

/// Gives a model the weights of the best validation in a run's folder; of a run of an earlier version those of its last step.
///
/// # Errors
/// No checkpoint, a damaged one, or one of another model.
pub fn load_weights(folder: &Path, model: &dyn FrameModel) -> Result<()> {
    let variables = named_variables(model);
    let mut optimizer = Optimizer::new(OptimizerKind::Adam, None, &variables);
    let progress = read(folder, &variables, &mut optimizer)?;
    progress.best.iter().for_each(|best| best.fill(&variables));
    Ok(())
}

/// Whether a folder holds a checkpoint.
pub(super) fn is_in(folder: &Path) -> bool {
    folder.join(CHECKPOINT).exists()
}

/// Replaces the checkpoint of a folder in one step.
pub(super) fn write(
    folder: &Path,
    progress: &Progress,
    variables: &[(String, Tensor)],
    optimizer: &Optimizer,
) -> Result<()> {
    let Progress { step, seconds, best, clips } = progress;
    let mut numbers = vec![*step as f64, *seconds];
    numbers.extend(best.iter().flat_map(|Best { validation: it, .. }| [it.step as f64, it.error]));
    let kept = best.iter().flat_map(|best| &best.weights);
    let kept = kept.map(|(name, weight)| (format!("{BEST}{name}"), weight.shallow_clone()));
    let slots = optimizer.slots().into_iter().map(|(name, slot)| (format!("{SLOT}{name}"), slot));
    let all = variables.iter().map(|(name, variable)| (name.clone(), variable.detach())).chain(slots);
    let numbers = Tensor::from_slice(&numbers);
    let letters: Vec<i64> = clips.bytes().map(i64::from).collect();
    let clips = (!letters.is_empty()).then(|| (CLIPS.to_string(), Tensor::from_slice(&letters)));
    let all: Vec<_> = all.chain(kept).chain([(PROGRESS.to_string(), numbers)]).chain(clips).collect();
    weights::write(&folder.join(CHECKPOINT), &all)
}

/// Sets variables and slots to what the checkpoint of a folder holds.
///
/// # Errors
/// No checkpoint, a damaged one, or one of another model.
pub(super) fn read(folder: &Path, variables: &[(String, Tensor)], optimizer: &mut Optimizer) -> Result<Progress> {
    let path = folder.join(CHECKPOINT);
    let bytes = storage::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let saved = weights::parse(&bytes).with_context(|| path.display().to_string())?.tensors;
    let restored = restore(saved, variables, optimizer);
    restored.with_context(|| format!("checkpoint {} does not fit the model", path.display()))
}

fn restore(
    saved: Vec<(String, Tensor)>,
    variables: &[(String, Tensor)],
    optimizer: &mut Optimizer,
) -> Result<Progress> {
    let _guard = tch::no_grad_guard();
    let mut saved: BTreeMap<String, Tensor> = saved.into_iter().collect();
    let progress: Vec<f64> = saved.remove(PROGRESS).context("it holds no step")?.to_kind(Kind::Double).try_into()?;
    let letters: Vec<i64> = saved.remove(CLIPS).map_or(Ok(Vec::new()), TryInto::try_into)?;
    let clips = letters.into_iter().map(|letter| char::from(letter as u8)).collect();
    let (step, seconds, validation) = match progress[..] {
        [step, seconds] => (step, seconds, None),
        [step, seconds, at, error] => (step, seconds, Some(Validation { step: at as u64, error })),
        _ => bail!("its step is no step"),
    };
    let mut take = |name: String, variable: &Tensor| -> Result<Tensor> {
        let value = saved.remove(&name).with_context(|| format!("variable {name} is missing"))?;
        ensure!(value.size() == variable.size(), "variable {name} has shape {:?}", value.size());
        Ok(value)
    };
    let best = |validation: Validation| -> Result<Best> {
        let weight = |(name, variable): &(String, Tensor)| Ok((name.clone(), take(format!("{BEST}{name}"), variable)?));
        Ok(Best { validation, weights: variables.iter().map(weight).collect::<Result<_>>()? })
    };
    let best = validation.map(best).transpose()?;
    for (name, variable) in variables {
        variable.shallow_clone().copy_(&take(name.clone(), variable)?);
    }
    let slot = |(name, value): (String, Tensor)| Some((name.strip_prefix(SLOT)?.to_string(), value));
    optimizer.restore(step as u64, saved.into_iter().filter_map(slot).collect())?;
    Ok(Progress { step: step as u64, seconds, best, clips })
}
