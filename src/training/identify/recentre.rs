//! Re-centring: the localisation network says where its objects were seen, and each template moves by what that changes.
//!
//! An autoencoder is as happy with an object whose position is always a little beside it, and a network that learned from
//! pictures places it only roughly. Its output layer is solved anew, by least squares, for the positions that the motion
//! was explained by; the sprites are shifted by the usual difference, so nothing is drawn elsewhere. Not in the original.

use anyhow::Result;
use tch::{Kind, Tensor};

use crate::network::cells::Coordinates;
use crate::network::physics_models::PhysicsNet;

/// Weight of staying at the old output layer, against a mean squared logit error of 1.
const RIDGE: f64 = 1e-6;

/// Moves the model's positions in `frames` (`[frames, channels, S, S]`) to `positions` (`[frames, 2 * objects]`, pixels),
/// and its sprites by `offsets` (old minus new positions, `(x0, y0, ..)`). Returns the root mean square of what the least
/// squares leave, pixels.
///
/// # Errors
/// A system that cannot be solved.
pub fn recentre(model: &PhysicsNet, frames: &Tensor, positions: &Tensor, offsets: &[f64]) -> Result<f64> {
    let _guard = tch::no_grad_guard();
    let positions = positions.to_device(frames.device()).to_kind(Kind::Float);
    // What was taken from a second look is in an order that the first has not.
    let firsts = model.at_first_look(frames);
    let [frames, positions] = [frames, &positions].map(|x| x.index_select(0, &firsts));
    let solved = model.encoder.solve_localiser(&model.given(&frames), &positions, RIDGE)?;
    // A sprite that turns about the frame's middle has no place of its own.
    if model.system.cell.coordinates == Coordinates::Position {
        model.decoder.shift_sprites(&Tensor::from_slice(offsets).to_device(frames.device()).to_kind(Kind::Float));
    }
    let error = solved - positions;
    Ok(error.square().mean(Kind::Double).sqrt().double_value(&[]))
}
