//! Re-centring: moves each template and its positions together, so that separations are true.
//!
//! An autoencoder is as happy with an object whose position is always a little beside it. The fit of the physics tells
//! the offset; here the sprites are shifted by it and the localisation network's output layer is solved anew, by least
//! squares, for the positions without it. Nothing is drawn differently. Not in the original.

use anyhow::Result;
use tch::{Kind, Tensor};

use crate::network::physics_models::PhysicsNet;

/// Weight of staying at the old output layer, against a mean squared logit error of 1.
const RIDGE: f64 = 1e-6;

/// Takes `offsets` (`(x0, y0, ..)`, pixels) off the positions of a model, fitting on `frames`
/// (`[frames, channels, S, S]`). Returns the root mean square of what the least squares leave, pixels.
///
/// # Errors
/// A system that cannot be solved.
pub fn recentre(model: &PhysicsNet, frames: &Tensor, offsets: &[f64]) -> Result<f64> {
    let _guard = tch::no_grad_guard();
    let old = model.encoder.forward(frames).positions;
    let device = old.device();
    let offsets = Tensor::from_slice(offsets).to_device(device).to_kind(Kind::Float);
    let wanted = &old - &offsets;
    model.encoder.solve_localiser(frames, &wanted, RIDGE)?;
    model.decoder.shift_sprites(&offsets);
    let error = model.encoder.forward(frames).positions - wanted;
    Ok(error.square().mean(Kind::Double).sqrt().double_value(&[]))
}
