//! Tensors in safetensors files with a checksum, and the weights of a model among them.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use safetensors::tensor::{TensorView, serialize};
use safetensors::{Dtype, SafeTensors};
use tch::{Device, Kind, Tensor};

use crate::network::physics_models::{PhysicsNet, VariableGroup};
use crate::support::error::{ErrorKind, OfKind};
use crate::support::random::fnv1a;
use crate::support::{atomic, storage};

/// Tensors by name.
pub type NamedTensors = Vec<(String, Tensor)>;

/// The key of the checksum in the file's header.
const CHECKSUM: &str = "checksum";
/// Stands in its value between the checksum of the tensors and that of the run's config: keys have no order.
const OF_CONFIG: char = '/';
/// The key that PyTorch writes there.
const OF_PYTORCH: &str = "format";
/// Types that a model or an optimizer holds.
const TYPES: [(Kind, Dtype); 3] = [(Kind::Float, Dtype::F32), (Kind::Double, Dtype::F64), (Kind::Int64, Dtype::I64)];

/// Writes tensors, whole or not at all, with a checksum of names, types, shapes and values.
///
/// # Errors
/// A full disk, a tensor of another type than float32, float64 or int64.
pub fn write(path: &Path, tensors: &[(String, Tensor)]) -> Result<()> {
    write_of_run(path, tensors, "")
}

/// The same with the checksum of the config of their run.
pub(super) fn write_of_run(path: &Path, tensors: &[(String, Tensor)], config: &str) -> Result<()> {
    let bytes = to_bytes(tensors, config).with_context(|| format!("cannot write {}", path.display()))?;
    atomic::write_file(path, |file| Ok(file.write_all(&bytes)?))
}

/// Checksum of the config of the run that a file is of; empty where the file does not have it.
pub(super) fn run_of(path: &Path) -> Result<String> {
    let bytes = storage::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let header = SafeTensors::read_metadata(&bytes).ok();
    let sums = header.and_then(|(_, header)| header.metadata().as_ref()?.get(CHECKSUM).cloned());
    Ok(sums.and_then(|sums| Some(sums.split_once(OF_CONFIG)?.1.to_string())).unwrap_or_default())
}

/// The bytes of a file of tensors; `config` is the checksum of their run's config, or empty.
pub(super) fn to_bytes(tensors: &[(String, Tensor)], config: &str) -> Result<Vec<u8>> {
    let parts = tensors.iter().map(|(name, tensor)| {
        let tensor = tensor.detach().to_device(Device::Cpu).contiguous();
        let known = TYPES.iter().find(|(kind, _)| *kind == tensor.kind());
        let (_, dtype) = known.with_context(|| format!("tensor {name} is of type {:?}", tensor.kind()))?;
        let shape: Vec<usize> = tensor.size().iter().map(|&n| n as usize).collect();
        let bytes: Vec<u8> = Vec::try_from(tensor.reshape([-1]).view_dtype(Kind::Uint8))?;
        Ok((name.as_str(), *dtype, shape, bytes))
    });
    let parts: Vec<_> = parts.collect::<Result<_>>()?;
    let views = parts.iter().map(|(name, dtype, shape, bytes)| {
        let view = TensorView::new(*dtype, shape.clone(), bytes);
        Ok((*name, view.with_context(|| format!("tensor {name}"))?))
    });
    let views: Vec<_> = views.collect::<Result<_>>()?;
    let sum = checksum(views.clone());
    let sums = if config.is_empty() { sum } else { format!("{sum}{OF_CONFIG}{config}") };
    let header = HashMap::from([(CHECKSUM.to_string(), sums)]);
    serialize(views, Some(header)).map_err(|error| anyhow!("{error}"))
}

/// Of all tensors in the order of their names.
fn checksum<'a>(mut tensors: Vec<(&'a str, TensorView<'a>)>) -> String {
    tensors.sort_by(|a, b| a.0.cmp(b.0));
    let sums = tensors.iter().flat_map(|(name, view)| {
        let what = format!("{name} {:?} {:?}", view.dtype(), view.shape());
        [fnv1a(what.as_bytes()), fnv1a(view.data())]
    });
    let sums: Vec<u8> = sums.flat_map(u64::to_le_bytes).collect();
    format!("{:016x}", fnv1a(&sums))
}

/// What a file of tensors held.
#[derive(Debug)]
pub struct Saved {
    /// In the order of their names.
    pub tensors: NamedTensors,
    /// Whether it had a checksum, which fitted; files of PyTorch and of earlier versions have none.
    pub checked: bool,
}

/// Tensors from the bytes of a file.
///
/// # Errors
/// Bytes that are no whole safetensors file, that do not fit their checksum, a tensor of another type.
pub fn parse(bytes: &[u8]) -> Result<Saved> {
    parsed(bytes).of_kind(ErrorKind::Corrupt)
}

fn parsed(bytes: &[u8]) -> Result<Saved> {
    let file = SafeTensors::deserialize(bytes)
        .map_err(|error| anyhow!("it is cut short, or no safetensors file ({error})"))?;
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|error| anyhow!("{error}"))?;
    let checked = match header.metadata() {
        Some(keys) if keys.contains_key(CHECKSUM) => {
            let views: Vec<_> = file.iter().collect();
            let sums = &keys[CHECKSUM];
            let sum = sums.split_once(OF_CONFIG).map_or(sums.as_str(), |(sum, _)| sum);
            ensure!(sum == checksum(views), "it was changed or damaged: its checksum does not fit");
            true
        }
        Some(keys) if !keys.is_empty() && !keys.contains_key(OF_PYTORCH) => {
            bail!("its header is damaged: it has no checksum")
        }
        _ => false,
    };
    let tensor = |(name, view): (&str, TensorView)| {
        let known = TYPES.iter().find(|(_, dtype)| *dtype == view.dtype());
        let (kind, _) = known.with_context(|| format!("tensor {name} is of type {:?}", view.dtype()))?;
        let shape: Vec<i64> = view.shape().iter().map(|&n| n as i64).collect();
        Ok((name.to_string(), Tensor::f_from_data_size(view.data(), &shape, *kind)?))
    };
    let mut tensors: NamedTensors = file.iter().map(tensor).collect::<Result<_>>()?;
    tensors.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(Saved { tensors, checked })
}

/// Loads a weights file into a model, strictly: the same names, shapes and types, and every value a number.
///
/// # Errors
/// A missing or damaged file, a name, shape or type that differs from the model's, a NaN or an infinity.
pub fn load(path: &Path, model: &PhysicsNet) -> Result<()> {
    load_into(path, model.named_variables())
}

/// The same into all variables of any model.
///
/// # Errors
/// As for [`load`].
pub fn load_into(path: &Path, variables: NamedTensors) -> Result<()> {
    let bytes = storage::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    parse(&bytes).and_then(|saved| fill(variables, &saved.tensors)).with_context(|| path.display().to_string())
}

/// Gives all variables of a model these values, once all fit.
///
/// # Errors
/// As for [`load`].
pub fn fill(variables: NamedTensors, saved: &[(String, Tensor)]) -> Result<()> {
    let _guard = tch::no_grad_guard();
    for (name, _) in saved {
        ensure!(
            variables.iter().any(|(known, _)| known == name),
            "variable {name} is unknown to a model of this task (or fixed there, see model.fixed)"
        );
    }
    set(saved, variables)
}

/// Loads encoder and decoder alone, from the weights of a model whose other parts may be different ones.
///
/// # Errors
/// A missing or damaged file, a variable of encoder or decoder that is missing, of another shape or no number.
pub(crate) fn load_vision(path: &Path, model: &PhysicsNet) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let bytes = storage::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let sees = |name: &str| matches!(model.group(name), VariableGroup::Encoder | VariableGroup::Decoder);
    let variables = model.named_variables().into_iter().filter(|(name, _)| sees(name)).collect();
    parse(&bytes).and_then(|saved| set(&saved.tensors, variables)).with_context(|| path.display().to_string())
}

/// Sets variables to the saved values of their names, once all fit.
fn set(saved: &[(String, Tensor)], variables: NamedTensors) -> Result<()> {
    let mut values = Vec::new();
    for (name, variable) in variables {
        let (_, value) = saved
            .iter()
            .find(|(saved, _)| *saved == name)
            .with_context(|| format!("variable {name} is missing (a model of this task needs it)"))?;
        ensure!(
            value.size() == variable.size() && value.kind() == variable.kind(),
            "variable {name}: found {:?} {:?}, expected {:?} {:?}",
            value.kind(),
            value.size(),
            variable.kind(),
            variable.size()
        );
        ensure!(is_finite(value), "variable {name} holds a NaN or an infinity; such a model predicts nothing");
        values.push((variable, value));
    }
    values.into_iter().for_each(|(variable, value)| variable.shallow_clone().copy_(value));
    Ok(())
}

/// The name of the first that holds a NaN or an infinity.
pub fn first_not_finite(variables: &[(String, Tensor)]) -> Option<&str> {
    variables.iter().find(|(_, variable)| !is_finite(variable)).map(|(name, _)| name.as_str())
}

/// Whether bytes are a file that [`write()`] wrote, by its header alone.
pub(super) fn is_written_here(bytes: &[u8]) -> bool {
    let header = SafeTensors::read_metadata(bytes);
    header.is_ok_and(|(_, header)| header.metadata().as_ref().is_some_and(|keys| keys.contains_key(CHECKSUM)))
}

/// Whether every element is a number.
pub(crate) fn is_finite(tensor: &Tensor) -> bool {
    tensor.to_kind(Kind::Double).isfinite().all().int64_value(&[]) == 1
}
