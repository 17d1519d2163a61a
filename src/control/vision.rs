//! From the last frames to the state that is planned from: what the model does with its input.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use tch::{Kind, Tensor};

use super::environment::{CHANNELS, SIDE, STEP};
use super::reward::PendulumState;
use crate::network::cells::{Actions, Coordinates};
use crate::network::physics_models::PhysicsNet;

/// An object that is seen nearer than this to the point that it turns about, pixels, is lost: its direction says nothing.
const NEAREST: f64 = 1.0;

/// A trained model that sees one pendulum.
#[derive(Debug, Clone, Copy)]
pub struct Vision<'a> {
    pub model: &'a PhysicsNet,
}

impl<'a> Vision<'a> {
    /// # Errors
    /// A model of another system than one pendulum that is driven from outside, or of other frames than the environment's.
    pub fn new(model: &'a PhysicsNet) -> Result<Self> {
        let system = &model.system;
        let cell = system.cell;
        ensure!(
            cell.actions && cell.coordinates == Coordinates::Angle && system.objects == 1,
            "equation {} moves no single angle under a torque; control needs a run of such a task (pendulum)",
            cell.name
        );
        ensure!(model.black_box.is_none(), "control plans with the equation; the run's model.dynamics is not physics");
        ensure!(
            (system.side, system.channels) == (SIDE, CHANNELS),
            "the model sees frames of {0} x {0} with {1} channels; the environment draws {SIDE} x {SIDE} with {CHANNELS}",
            system.side,
            system.channels
        );
        ensure!(
            (system.dt - STEP).abs() < 1e-9,
            "the model has {} time units from frame to frame, the environment {STEP}: velocities would not agree",
            system.dt
        );
        Ok(Vision { model })
    }

    /// Frames that are needed for a state.
    pub fn input_frames(&self) -> usize {
        self.model.system.input_steps
    }

    /// Where the pendulum is seen in frames `[time, channels, S, S]`: angles `[1, time, 1]`. None if it is lost in one of
    /// them.
    fn angles(&self, frames: &Tensor) -> Option<Tensor> {
        let frames = frames.unsqueeze(0).to_device(self.model.variables.device());
        let (encoding, angles) = self.model.encode(&frames);
        let from_middle = encoding.positions.to_kind(Kind::Double) - SIDE as f64 / 2.0;
        let nearest = from_middle.square().sum_dim_intlist([1i64].as_slice(), false, None).sqrt().min();
        // False, too, if it is not a number.
        let seen = nearest.double_value(&[]) >= NEAREST && angles.isfinite().all().int64_value(&[]) == 1;
        seen.then(|| self.model.aligned(&frames, &angles))
    }

    /// The state at the last of the L input frames `[L, channels, S, S]`, as the model estimates and refines it; `torques`
    /// (L - 1 of them) acted from each frame to the next. None if the pendulum is lost or the state is no finite number.
    pub fn state(&self, frames: &Tensor, torques: &[f64]) -> Option<PendulumState> {
        let _guard = tch::no_grad_guard();
        let angles = self.angles(frames)?;
        let torques: Vec<f32> = torques.iter().map(|torque| *torque as f32).collect();
        let actions = Actions::new(Some(Tensor::from_slice(&torques).unsqueeze(0).to_device(angles.device())));
        let state = self.model.initial_state(&angles, &actions);
        let state = PendulumState { angle: state.pos.double_value(&[0, 0]), rate: state.vel.double_value(&[0, 0]) };
        state.is_finite().then_some(state)
    }

    /// The angle at which a picture shows the pendulum, radians.
    ///
    /// # Errors
    /// A file that is no picture or of another size than the frames, or in which the pendulum is not found.
    pub fn goal(&self, file: &Path) -> Result<f64> {
        let _guard = tch::no_grad_guard();
        let picture = image::open(file).with_context(|| format!("cannot read the picture {}", file.display()))?;
        let picture = picture.to_rgb8();
        let (width, height) = picture.dimensions();
        ensure!(
            (width as usize, height as usize) == (SIDE, SIDE),
            "{} has {width} x {height} pixels; a goal must be a frame of {SIDE} x {SIDE}",
            file.display()
        );
        let side = SIDE as i64;
        let pixels = Tensor::from_slice(picture.as_raw()).reshape([1, side, side, CHANNELS as i64]);
        let frame = pixels.permute([0, 3, 1, 2]).to_kind(Kind::Float) / 255.0;
        let lost = || format!("the model finds no pendulum in {}", file.display());
        Ok(self.angles(&frame).with_context(lost)?.double_value(&[0, 0, 0]))
    }
}
