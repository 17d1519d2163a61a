//! The best weights of a run in its folder, also of runs of earlier versions, which had a file of their own for all of a
//! checkpoint.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use tch::Tensor;

use super::descent::PHASE;
use super::frame_model::{FrameModel, named_variables};
use super::scores::SCORES;
use paig::runs::checkpoint::{BestOf, Store};
use paig::runs::weights;
use paig::support::run_names::CHECKPOINTS;
use paig::support::storage;

/// The checkpoint of earlier versions: the last weights by name, and besides them much else.
const EARLIER: &str = "checkpoint.safetensors";
/// Before the name of a weight of the best validation in it; it has none of these in the earliest ones.
const BEST: &str = "best/";

/// Gives a model the weights of the best validation in a run's folder; where there are none, of the run's last step.
///
/// # Errors
/// No checkpoint, a damaged one, or one of another model.
pub fn load_weights(folder: &Path, model: &dyn FrameModel) -> Result<()> {
    let variables = named_variables(model);
    if !is_earlier(folder) {
        return Store::new(folder).load_best(variables, BestOf::Earlier(PHASE));
    }
    let path = folder.join(EARLIER);
    let bytes = storage::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let saved = weights::parse(&bytes).with_context(|| path.display().to_string())?.tensors;
    let best: Vec<(String, Tensor)> = saved
        .iter()
        .filter_map(|(name, weight)| Some((name.strip_prefix(BEST)?.to_string(), weight.shallow_clone())))
        .collect();
    let known = |(name, _): &(String, Tensor)| variables.iter().any(|(variable, _)| variable == name);
    let chosen = if best.is_empty() { saved.into_iter().filter(known).collect() } else { best };
    weights::fill(variables, &chosen).with_context(|| format!("checkpoint {} does not fit the model", path.display()))
}

/// Whether a folder holds a checkpoint of an earlier version alone.
fn is_earlier(folder: &Path) -> bool {
    folder.join(EARLIER).exists() && !folder.join(CHECKPOINTS).exists()
}

/// # Errors
/// A run that an earlier version has not finished.
pub(super) fn ensure_current(folder: &Path) -> Result<()> {
    ensure!(
        !is_earlier(folder) || folder.join(SCORES).exists(),
        "{} was begun by an earlier version, whose trainings this one cannot continue; begin again in another folder",
        folder.display()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use tch::Device;

    use super::super::config::EndToEndModel;
    use super::*;
    use paig::network::System;
    use paig::tasks;
    use paig_kernels::Kernels;

    /// A checkpoint of an earlier version holds the last weights, those of the best validation, and the optimizer's slots.
    #[test]
    fn the_best_weights_of_earlier_versions_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let system = System { side: 16, ..tasks::builtin("spring_color").unwrap().system };
        let build = |seed: u64| EndToEndModel::VideoLstm.build(&system, Kernels::Own, seed, Device::Cpu);
        let [last, best, read] = [1, 2, 3].map(build);
        let mut saved = named_variables(last.as_ref());
        for (name, slot) in named_variables(last.as_ref()) {
            saved.push((format!("slot/{name}/m"), slot.zeros_like()));
        }
        saved.push(("progress".into(), Tensor::from_slice(&[6.0, 1.0])));
        let same = |one: &dyn FrameModel, other: &dyn FrameModel| {
            named_variables(one).iter().zip(named_variables(other)).all(|(one, other)| one.1.equal(&other.1))
        };
        weights::write(&folder.path().join(EARLIER), &saved).unwrap();
        load_weights(folder.path(), read.as_ref()).unwrap();
        assert!(same(read.as_ref(), last.as_ref()) && !same(read.as_ref(), best.as_ref()));
        saved.extend(named_variables(best.as_ref()).into_iter().map(|(name, it)| (format!("{BEST}{name}"), it)));
        weights::write(&folder.path().join(EARLIER), &saved).unwrap();
        load_weights(folder.path(), read.as_ref()).unwrap();
        assert!(same(read.as_ref(), best.as_ref()));
        let refused = ensure_current(folder.path()).unwrap_err().to_string();
        assert!(refused.contains("earlier version"), "{refused}");
    }
}
