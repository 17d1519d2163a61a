//! What the model draws at a moment of the training.

use anyhow::Result;
use image::RgbImage;

use crate::datasets::iterators::Clips;
use crate::evaluation::outputs::Outputs;
use crate::network::physics_models::PhysicsNet;
use crate::viz::examples;

/// A picture of a validation clip that is drawn when it is asked for: it costs a pass of the model.
#[derive(Debug, Clone, Copy)]
pub struct Preview<'a> {
    model: &'a PhysicsNet,
    clips: &'a Clips,
}

impl<'a> Preview<'a> {
    pub(super) fn new(model: &'a PhysicsNet, clips: &'a Clips) -> Self {
        Preview { model, clips }
    }

    /// The first validation clip. Rows: input and prediction, truth, reconstruction.
    ///
    /// # Errors
    /// Frames with neither 1 nor 3 channels.
    pub fn picture(&self) -> Result<RgbImage> {
        let _guard = tch::no_grad_guard();
        examples::picture(&self.model.system, &Outputs::of(self.model, self.clips, 1)?, 0)
    }
}
