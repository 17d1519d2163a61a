//! A run's model, read back from its folder.

use std::path::Path;

use anyhow::anyhow;
use tch::Device;

use super::config::Config;
use crate::network::cells::Equations;
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::{self, SavedWeights};
use crate::runs::weights;
use crate::support::error::{Error, ErrorKind, Result};
use crate::support::run_names::CONFIG;

/// A run's config and its model with the weights that it saved.
///
/// # Errors
/// A folder that holds no run or no such weights, or weights of another model.
pub fn load_model(folder: &Path, which: SavedWeights, device: Device) -> Result<(Config, PhysicsNet)> {
    load_model_with(folder, which, device, &Equations::default())
}

/// The same, where these equations have names.
///
/// # Errors
/// As for [`load_model`].
pub fn load_model_with(
    folder: &Path,
    which: SavedWeights,
    device: Device,
    known: &Equations,
) -> Result<(Config, PhysicsNet)> {
    Ok(load(folder, which, device, known)?)
}

fn load(folder: &Path, which: SavedWeights, device: Device, known: &Equations) -> anyhow::Result<(Config, PhysicsNet)> {
    let path = folder.join(CONFIG);
    if !path.exists() {
        let missing = anyhow!("{} is not a run folder: there is no {CONFIG} in it", folder.display());
        return Err(Error::new(ErrorKind::Missing, missing).into());
    }
    let config = Config::read_with(&path, known)?;
    let model = PhysicsNet::new(&config.task.system, &config.model, device, config.seed)?;
    weights::load(&checkpoint::find_own_weights(folder, which)?, &model)?;
    Ok((config, model))
}
