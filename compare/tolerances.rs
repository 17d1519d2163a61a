//! Every tolerance, with its reason.
//!
//! The golden tensors were computed in float32, so each carries rounding of its own; the port's comes on top. Where
//! the computation is chaotic (bodies that nearly touch; the edge of a sprite's window crossing a pixel, where a mask
//! jumps; steps of an optimizer that follow such gradients) rounding grows without a bug, and by how much depends on
//! the file. It is therefore measured, not guessed: if a tensor misses its tolerance, the port runs again in the
//! other precision, and [`PROBES`] times with every input and weight moved at random by some float32 roundings.
//! An element that this moves by d cannot be told from the original more closely than that, and is held to
//! [`PROBE_MARGIN`] times d, but never to more than the tolerance's `chaotic`. An error of the port moves all its
//! runs alike, so it raises no bound. Physics and drawing are besides held to the plain tolerance from golden state
//! to golden state, where nothing has time to grow.

/// How far a tensor may be off, as a fraction of its scale: the largest magnitude in the golden tensor.
#[derive(Debug)]
pub struct Tolerance {
    pub relative: f64,
    /// The most that measured rounding may raise it to for an element.
    pub chaotic: f64,
}

/// Runs with moved inputs, and the factor on what they show.
pub const PROBES: u64 = 12;
/// Largest relative movement. Single layers already differ by this much from one library to another.
pub const PROBE_STEP: f64 = 4.0 * f32::EPSILON as f64;
/// A few probes do not find the worst case.
pub const PROBE_MARGIN: f64 = 10.0;

/// What is described by a formula: equal but for the last bit of float32.
pub static GIVEN: Tolerance = Tolerance { relative: 2e-7, chaotic: 2e-7 };
/// The goal for all that runs forward: sums in another order. After a near collision a body flies off anywhere.
pub static FORWARD: Tolerance = Tolerance { relative: 1e-5, chaotic: 2.0 };
/// One frame of physics, or one frame drawn, from golden states: no room for chaos.
pub static SINGLE_STEP: Tolerance = Tolerance { relative: 1e-5, chaotic: 1e-3 };
/// The goal for gradients, which pass through the computation twice.
pub static GRADIENT: Tolerance = Tolerance { relative: 1e-4, chaotic: 2.0 };
/// Gradients to a sampled image. TensorFlow adds the cancelling weights of every output point outside the image to
/// its corners; the weights are products of distances, and float32 leaves a rest. Ours is the same in double
/// precision.
pub static SAMPLED_GRADIENT: Tolerance = Tolerance { relative: 1e-3, chaotic: 1e-2 };
/// Variables after some steps, whose length is some per cent of the scale: an element whose gradient is near zero
/// takes a step of either sign under Adam, and any that a window's edge has touched takes a full one.
pub static TRAINED: Tolerance = Tolerance { relative: 5e-5, chaotic: 5e-2 };
