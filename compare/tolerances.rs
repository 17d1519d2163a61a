//! The tolerances that cases share, and how rounding is measured, with the reasons. What one case alone needs stands in
//! its own `mod.rs`.
//!
//! The golden tensors were computed in float32, so each carries rounding of its own; the port's comes on top. Where
//! the computation is chaotic (bodies that nearly touch; the edge of a sprite's window crossing a pixel, where a mask
//! jumps; steps of an optimizer that follow such gradients) rounding grows without a bug, and by how much depends on
//! the file. It is therefore measured, not guessed: if a tensor misses its tolerance, libtorch's part of the port runs in
//! both precisions, and the port [`PROBES`] times with every input and weight moved at random by some float32 roundings.
//! While a row fails, up to [`MOST_PROBES`] times: the further movements are [`LARGE_STEP`] times as large, and their effects
//! are divided by that.
//! An element that this moves by d cannot be told from the original more closely than that, and is held to
//! [`PROBE_MARGIN`] times d, but never to more than the tolerance's `chaotic`. An error of the port moves all its
//! runs alike, so it raises no bound.
//!
//! A row that misses its tolerance, and an element of which rounding alone moves by more than [`UNINFORMATIVE`] of the
//! row's scale, says nothing of the port. It is counted as *uninformative*, neither as passed nor as failed. The
//! movement alone decides, never the error; what is not a finite number fails in any case.
//!
//! Physics and drawing are besides compared one step at a time, from golden state to golden state, where nothing has
//! time to grow. These rows are never uninformative, and hold the tensor whose own row is: if the single steps fail, it
//! fails as well. Gradients and trained variables have no such rows; the table says of each uninformative one that no
//! single step holds it. The files in which nothing is chaotic and the submodules' files then have to.

/// How far a tensor may be off, as a fraction of its scale: the largest magnitude in the golden tensor.
#[derive(Debug)]
pub struct Tolerance {
    pub relative: f64,
    /// The most that measured rounding may raise it to for an element.
    pub chaotic: f64,
}

/// Runs with moved inputs.
pub const PROBES: u64 = 12;
/// As many at most, while a row fails.
pub const MOST_PROBES: u64 = 36;
/// How much larger the movements of those are: where a unit of the network is nearly dead, small ones seldom wake it, and on
/// which side it begins depends on the processor. A smooth result follows in proportion; one that jumps is found with a part
/// of its jump, which [`PROBE_MARGIN`] makes up for.
pub const LARGE_STEP: f64 = 8.0;
/// Largest relative movement. Single layers already differ by this much from one library to another.
pub const PROBE_STEP: f64 = 4.0 * f32::EPSILON as f64;
/// The factor on what they show: a few probes do not find the worst case.
pub const PROBE_MARGIN: f64 = 10.0;
/// Of a row's scale. With the margin, an element that rounding moves by more would have the whole scale for a bound: a
/// port that computes nothing but zeros would pass.
pub const UNINFORMATIVE: f64 = 1.0 / PROBE_MARGIN;

/// The goal for all that runs forward: sums in another order. After a near collision a body flies off anywhere, so there
/// is no limit below the one at which the row becomes uninformative.
pub static FORWARD: Tolerance = Tolerance { relative: 1e-5, chaotic: 1.0 };
/// One frame of physics, or one frame drawn, from golden states: no room for chaos.
pub static SINGLE_STEP: Tolerance = Tolerance { relative: 1e-5, chaotic: 1e-3 };
/// The goal for gradients, which pass through the computation twice, and through every near collision.
pub static GRADIENT: Tolerance = Tolerance { relative: 1e-4, chaotic: 1.0 };
