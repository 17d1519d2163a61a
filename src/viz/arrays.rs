//! `outputs.npz` and `extra_outputs.npz`: the numbers behind the pictures, channels last as the original saves them.

use std::path::Path;

use anyhow::{Context, Result};
use ndarray::ArrayD;
use tch::{Device, Kind, Tensor};

use crate::datasets::iterators::Clips;
use crate::datasets::npz;
use crate::evaluation::outputs::Outputs;
use crate::network::physics_models::PhysicsNet;
use crate::support::error::Error;

/// Clips of which the layers are written.
const LAYERS_OF: usize = 25;

/// Writes what [`super::write_artifacts`] says of the first `count` clips.
pub(super) fn write_outputs(path: &Path, outputs: &Outputs, count: usize) -> Result<()> {
    let count = outputs.count().min(count) as i64;
    let first = |x: &Tensor| x.narrow(0, 0, count);
    write(
        path,
        &[
            ("input", channels_last(&first(&outputs.clips))),
            ("output", channels_last(&first(&outputs.predictions))),
            ("recons", channels_last(&first(&outputs.reconstructions))),
            ("enc_pos", first(&outputs.positions)),
            ("pos_vel_seq", first(&outputs.states)),
        ],
    )
}

/// Writes clips (`[clips, T, C, S, S]`) and what is predicted after their input (`[clips, T - L, C, S, S]`) as a model without
/// positions has them: `input` and `output` of `outputs.npz`.
///
/// # Errors
/// A file that cannot be written.
pub fn write_predictions(path: &Path, clips: &Tensor, predictions: &Tensor) -> Result<(), Error> {
    Ok(write(path, &[("input", channels_last(clips)), ("output", channels_last(predictions))])?)
}

/// Writes the decoder's and the encoder's layers for the first clips, each frame as it is reconstructed.
pub(super) fn write_extra_outputs(path: &Path, model: &PhysicsNet, test: &Clips) -> Result<()> {
    let clips: Vec<i64> = (0..test.len().min(LAYERS_OF) as i64).collect();
    let frames = test.batch(&clips, model.system.input_steps + model.system.pred_steps);
    let encoding = model.look(&frames.flatten(0, 1));
    let rendering = model.decoder.forward(&model.coordinates(&encoding));
    let mut arrays = vec![
        ("enc_masks", channels_last(&encoding.masks)),
        ("masked_objs", channels_last(&encoding.masked)),
        ("transf_masks", rendering.masks.unsqueeze(-1)),
    ];
    if let Some(sprites) = model.decoder.sprites() {
        let background = sprites.background.unsqueeze(0).expand_as(&rendering.contents.narrow(0, 0, 1));
        arrays.extend([
            ("contents", channels_last(&sprites.contents)),
            ("templates", channels_last(&sprites.template)),
            ("background_content", channels_last(&sprites.background)),
            ("transf_contents", channels_last(&Tensor::cat(&[&rendering.contents, &background], 0))),
        ]);
    }
    write(path, &arrays)
}

/// `[.., C, h, w]` to `[.., h, w, C]`.
pub(super) fn channels_last(x: &Tensor) -> Tensor {
    x.movedim_int(-3, -1)
}

/// Writes tensors as float32 arrays of a compressed npz.
pub(super) fn write(path: &Path, arrays: &[(&str, Tensor)]) -> Result<()> {
    npz::write_floats(path, |npz| {
        for (name, tensor) in arrays {
            let tensor = tensor.to_device(Device::Cpu).to_kind(Kind::Float).contiguous();
            let shape: Vec<usize> = tensor.size().iter().map(|&n| n as usize).collect();
            let array = ArrayD::from_shape_vec(shape, Vec::<f32>::try_from(tensor.flatten(0, -1))?)?;
            npz.add_array(*name, &array).with_context(|| format!("array {name}"))?;
        }
        Ok(())
    })
}
