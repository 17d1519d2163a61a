//! Converts the weights of a model between this port, the PyTorch reference and TensorFlow.
//!
//! | form | file | names | kernels |
//! |---|---|---|---|
//! | checkpoint of a run | folder or `.safetensors` | `encoder.conv2d_3.weight` | `[out, in, kh, kw]`, `[out, in]` |
//! | PyTorch `state_dict` | `.safetensors` | the same | the same |
//! | named variables of TensorFlow | `.npz` | `net/encoder/conv2d_3/kernel` | `[kh, kw, in, out]`, `[in, out]` |
//!
//! Our names and layouts are those of a PyTorch `state_dict`, so the first two forms are one. The names and layouts of
//! TensorFlow are translated by [`crate::network::variable_names`], and by nothing else. All values are float32 and are moved,
//! never computed with: a file that goes there and back is the same to the bit. What is no variable is not converted:
//! the choices of [`ModelOptions`] with which a model was trained have to be made again by whoever computes with it.

use std::collections::BTreeMap;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use ndarray::{ArrayD, IxDyn};
use ndarray_npy::NpzWriter;
use tch::{Device, Tensor};

use super::checkpoint::{self, SavedWeights};
use super::weights::{self, is_finite};
use crate::datasets::npz;
use crate::network::System;
use crate::network::physics_models::{ModelOptions, PhysicsNet};
use crate::network::variable_names::{from_tensorflow, layout_from_tensorflow, layout_to_tensorflow, to_tensorflow};
use crate::support::atomic::{self, is_stream};
use crate::support::output::FileKind;
use crate::support::run_names::CHECKPOINTS;

/// Form of a weights file, told by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Ours and PyTorch's; a folder is a run's or a checkpoint's.
    Safetensors,
    /// TensorFlow's named variables.
    Npz,
}

impl Form {
    /// # Errors
    /// A file that is neither `.safetensors` nor `.npz`.
    pub fn of(path: &Path) -> Result<Self> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("safetensors") => Ok(Form::Safetensors),
            Some("npz") => Ok(Form::Npz),
            _ if path.is_dir() => Ok(Form::Safetensors),
            _ => bail!("{}: neither .safetensors, nor .npz, nor a run folder", path.display()),
        }
    }
}

/// Reads `from`, checks it against a model of the task with these options and writes `to`; gives the number of
/// variables.
///
/// # Errors
/// A file that cannot be read or written, or whose variables are not exactly those of a model of the task: the same
/// names, shapes and float32.
pub fn convert(system: &System, options: &ModelOptions, from: &Path, to: &Path) -> Result<usize> {
    let target = Form::of(to)?;
    ensure!(!to.is_dir(), "{} is a folder; a file is written", to.display());
    let model = PhysicsNet::new(system, options, Device::Cpu, 0)?;
    match Form::of(from)? {
        Form::Safetensors => weights::load(&checkpoint::find_own_weights(from, SavedWeights::Last)?, &model)?,
        Form::Npz => load_npz(from, &model)?,
    }
    let variables = model.named_variables();
    for (name, variable) in &variables {
        ensure!(is_finite(variable), "{}: variable {name} holds a NaN or an infinity", from.display());
    }
    match target {
        Form::Safetensors => weights::write(to, &variables)?,
        Form::Npz => save_npz(to, &variables)?,
    }
    Ok(variables.len())
}

/// Checks that converted weights may be written to a file: a new one, or converted weights if `force` is given. Returns the place that
/// links lead to.
///
/// # Errors
/// An unknown ending, a file that is there, what was converted, a place that cannot be written.
pub fn check_target(from: &Path, to: &Path, force: bool) -> Result<PathBuf> {
    let kind = match Form::of(to)? {
        Form::Safetensors => SAFETENSORS,
        Form::Npz => NPZ,
    };
    ensure!(force || !to.exists() || is_stream(to), "{} is there already; --force replaces it", to.display());
    ensure!(!to.is_dir(), "{} is a folder; a file is written", to.display());
    let of_run = from.join(CHECKPOINTS);
    kind.check(to, &[if of_run.exists() { &of_run } else { from }])
}

const SAFETENSORS: FileKind = FileKind { name: "weights of `paig`", recognizes: weights::is_written_here };
const NPZ: FileKind = FileKind {
    name: "weights of `paig convert`",
    recognizes: |bytes| {
        let archive = zip::ZipArchive::new(Cursor::new(bytes));
        let is_variable = |name: &str| from_tensorflow(name.trim_end_matches(".npy")).is_ok();
        archive.is_ok_and(|archive| archive.file_names().all(is_variable))
    },
};

/// Fills a model from TensorFlow's named variables.
fn load_npz(path: &Path, model: &PhysicsNet) -> Result<()> {
    let archive = npz::Archive::open(path)?;
    fill(archive, model).with_context(|| path.display().to_string())
}

fn fill(mut archive: npz::Archive, model: &PhysicsNet) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let mut variables: BTreeMap<String, Tensor> = model.named_variables().into_iter().collect();
    for original_name in archive.names().to_vec() {
        let name = from_tensorflow(&original_name)?;
        let variable = variables
            .remove(&name)
            .with_context(|| format!("variable {original_name} is unknown to a model of this task, or twice there"))?;
        let array = archive.array::<f32>(&original_name, "float32")?;
        let shape: Vec<i64> = array.shape().iter().map(|&n| n as i64).collect();
        let expected = layout_to_tensorflow(&name, &variable)?.size();
        ensure!(shape == expected, "variable {original_name}: found shape {shape:?}, expected {expected:?}");
        let values: Vec<f32> = array.iter().copied().collect();
        let values = Tensor::from_slice(&values).reshape(&shape);
        variable.shallow_clone().copy_(&layout_from_tensorflow(&name, &values)?);
    }
    match variables.keys().next() {
        Some(name) => {
            bail!("variable {} is missing (a model of this task needs it)", to_tensorflow(name)?)
        }
        None => Ok(()),
    }
}

fn save_npz(path: &Path, variables: &[(String, Tensor)]) -> Result<()> {
    let mut archive = NpzWriter::new(Cursor::new(Vec::new()));
    for (name, variable) in variables {
        let (shape, values) = shape_and_values(&layout_to_tensorflow(name, &variable.detach())?)?;
        archive.add_array(to_tensorflow(name)?, &ArrayD::from_shape_vec(IxDyn(&shape), values)?)?;
    }
    let bytes = archive.finish()?.into_inner();
    atomic::write_file(path, |file| Ok(file.write_all(&bytes)?))
}

/// Values in row-major order.
fn shape_and_values(tensor: &Tensor) -> Result<(Vec<usize>, Vec<f32>)> {
    let shape = tensor.size().iter().map(|&n| n as usize).collect();
    Ok((shape, Vec::try_from(tensor.reshape([-1]))?))
}
