//! A step of Adam in one pass over the memory of a variable, its gradient and its slots.

use super::simd::{Instructions, Lanes, dispatched};
use super::threads::in_parallel;

/// Elements that a thread takes at a time.
const PART: usize = 1 << 15;

/// What is the same for all elements.
#[derive(Debug, Clone, Copy)]
pub struct AdamStep {
    /// Decay of the mean of gradients and of that of their squares.
    pub betas: [f32; 2],
    /// The learning rate, with the correction for the first steps.
    pub rate: f32,
    pub epsilon: f32,
}

/// A variable, its gradient, and the means of gradients and of their squares.
#[derive(Debug)]
pub struct Slices<'a> {
    pub variable: &'a mut [f32],
    pub gradient: &'a [f32],
    pub mean: &'a mut [f32],
    pub square: &'a mut [f32],
}

/// Changes the variable and the means.
pub fn step(instructions: Instructions, step: AdamStep, slices: Slices) {
    let Slices { variable, gradient, mean, square } = slices;
    assert!([gradient.len(), mean.len(), square.len()].iter().all(|length| *length == variable.len()));
    let variables = variable.chunks_mut(PART).zip(gradient.chunks(PART));
    let means = mean.chunks_mut(PART).zip(square.chunks_mut(PART));
    let parts = variables.zip(means);
    let parts = parts.map(|((variable, gradient), (mean, square))| Slices { variable, gradient, mean, square });
    in_parallel(parts.collect(), |mut part| step_of_part(instructions, step, &mut part));
}

dispatched! {
    fn step_of_part(step: AdamStep, slices: &mut Slices) = step_of_part_lanes
}

/// Written for single numbers: the compiler makes vectors of them, of the width that the caller is compiled for.
#[inline(always)]
fn step_of_part_lanes<L: Lanes>(step: AdamStep, slices: &mut Slices) {
    let [of_mean, of_square] = step.betas.map(|beta| 1.0 - beta);
    let Slices { variable, gradient, mean, square } = slices;
    let variables = variable.iter_mut().zip(gradient.iter());
    for ((variable, gradient), (mean, square)) in variables.zip(mean.iter_mut().zip(square.iter_mut())) {
        *mean += of_mean * (*gradient - *mean);
        *square += of_square * (*gradient * *gradient - *square);
        *variable -= step.rate * *mean / (square.sqrt() + step.epsilon);
    }
}
