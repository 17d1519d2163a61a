//! What the frames themselves tell of the objects, before any network has learned: what moves, which blobs it is in, and
//! which blob of one frame is which of another.
//!
//! Read [`motion`], then [`blobs`], then [`names`]. Nothing but training frames is looked at. Not in the original.

pub mod blobs;
pub mod motion;
pub mod names;
pub mod pasting;
pub(crate) mod sprites;
