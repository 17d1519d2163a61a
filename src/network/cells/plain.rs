//! Cells in plain numbers: many states side by side, without tensors, gradients or allocations in a step. For planning.

use std::fmt::Debug;

/// An equation with its parameters that moves a batch of states on.
///
/// Numbers stand coordinate by coordinate, within it state by state: `[coordinates, batch]`. So several states fit into a
/// register.
pub trait PlainCell: Debug {
    /// All states a time `dt` later, one frame; `action` (`[batch]`) acts meanwhile.
    fn step(&mut self, positions: &mut [f32], velocities: &mut [f32], action: &[f32], dt: f32);
}
