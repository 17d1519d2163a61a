//! Alignment: encoded positions are improved on the picture itself, by Gauss-Newton steps of the decoder's drawing towards
//! the frame (Lucas and Kanade 1981).
//!
//! The encoder reads a position from a noisy frame less well than the frame would allow; under noise that error of the start
//! state is most of the prediction's error. Not in the original.

use tch::{Kind, Tensor};

use super::Decoder;
use crate::network::cells::Coordinates;

/// Half the span of the difference quotients: a part of a pixel on which a sprite's edge varies. Radians for angles.
const PROBE_PIXELS: f64 = 0.25;
const PROBE_RADIANS: f64 = 0.02;
/// Farthest that a coordinate is taken from where it was encoded, in probes. What is farther off was not seen by the encoder,
/// and the picture says nothing about it.
const REACH: f64 = 6.0;
/// How well the encoder places an object where the picture cannot (out of sight, behind another), in probes.
const ENCODED: f64 = 1.0;

/// Positions `[frames, coordinates * objects]` in the equation's coordinates, after `steps` steps towards what `frames`
/// (`[frames, channels, S, S]`) show.
///
/// Gradients pass to the encoded positions as if nothing had been added.
pub fn align(decoder: &Decoder, kind: Coordinates, frames: &Tensor, positions: &Tensor, steps: usize) -> Tensor {
    if steps == 0 {
        return positions.shallow_clone();
    }
    let probe = match kind {
        Coordinates::Position => PROBE_PIXELS,
        Coordinates::Angle => PROBE_RADIANS,
    };
    let moved = tch::no_grad(|| {
        let encoded = positions.detach();
        let Some((drawn, jacobian)) = decoder.with_derivative(&encoded, probe) else { return encoded.zeros_like() };
        let fit = AlignmentProblem::new(frames, &drawn, &jacobian, probe);
        let mut moved = fit.step(&fit.drawn, &encoded.zeros_like());
        for _ in 1..steps {
            let [drawn] = decoder.draw([&(&encoded + &moved)]);
            moved = fit.step(&drawn.flatten(1, 3), &moved);
        }
        moved
    });
    positions + moved
}

/// Least squares of the picture's error and of the way from the encoded positions, each weighted by its own variance. The
/// drawing's derivative is that at the encoded positions.
struct AlignmentProblem {
    /// `[frames, values]`.
    frames: Tensor,
    /// At the encoded positions, `[frames, values]`.
    drawn: Tensor,
    /// `[frames, coordinates * objects, values]`.
    jacobian: Tensor,
    /// What one squared step away from the encoded positions costs, in squared errors of a picture's value, `[frames, 1, 1]`.
    prior: Tensor,
    /// The matrix of the normal equations, `[frames, coordinates * objects, coordinates * objects]`.
    normal: Tensor,
    reach: f64,
}

impl AlignmentProblem {
    fn new(frames: &Tensor, drawn: &Tensor, jacobian: &Tensor, probe: f64) -> Self {
        let [frames, drawn] = [frames.flatten(1, 3), drawn.flatten(1, 3)];
        // The variance of one value of a picture, from what is not explained; it is never exactly none.
        let variance = (&frames - &drawn).square().mean_dim([1i64].as_slice(), true, Kind::Double) + 1e-8;
        let prior = (variance / (ENCODED * probe).powi(2)).unsqueeze(2);
        let jacobian = jacobian.flatten(2, 4);
        let unit = Tensor::eye(jacobian.size()[1], (Kind::Double, jacobian.device()));
        let normal = jacobian.bmm(&jacobian.transpose(1, 2)).to_kind(Kind::Double) + &prior * unit;
        AlignmentProblem { frames, drawn, jacobian, prior, normal, reach: REACH * probe }
    }

    /// How far in all from the encoded positions, after a step from what is `drawn` there where they are `moved` to.
    fn step(&self, drawn: &Tensor, moved: &Tensor) -> Tensor {
        let error = (&self.frames - drawn).unsqueeze(2);
        let explained = self.jacobian.bmm(&error).to_kind(Kind::Double);
        let towards = explained - &self.prior * moved.to_kind(Kind::Double).unsqueeze(2);
        let step = Tensor::linalg_solve_ex(&self.normal, &towards, true, false).0.squeeze_dim(2);
        (moved + step.to_kind(moved.kind())).clamp(-self.reach, self.reach)
    }
}
