//! What the other parts of a video say of the equation's parameters, where one of several parts is measured alone.
//!
//! Parts that one equation explains, each by itself and with another value, are no two scenes of one motion: the object comes nearer,
//! the time base changes, or a force is missing. Intervals see nothing of that, for each holds for its own part.

use std::sync::Arc;

use super::recording::{Observation, RecordedSystem, whole};
use super::results::{Quantity, QuantityKind};
use paig::network::cells::CellKind;

/// Shortest part that counts, as a share of the frames of the one that is measured.
const AS_LONG: f64 = 0.6;

/// A part of the videos that is not measured.
#[derive(Debug, Clone)]
pub(super) struct OtherPart {
    pub scene: RecordedSystem,
    pub observation: Observation,
}

/// What one of them says by itself.
#[derive(Debug, Clone, PartialEq)]
pub struct PartEstimate {
    /// Its name.
    pub part: String,
    /// Quantities that drive the motion, with their intervals.
    pub quantities: Vec<Quantity>,
}

impl OtherPart {
    /// What the part says; none where it is much shorter than `frames`, or the equation does not explain it.
    pub(super) fn estimate(&self, cell: &Arc<CellKind>, frames: usize, seed: u64) -> Option<PartEstimate> {
        let recording = &self.scene.recordings[0];
        if (recording.times.len() as f64) < AS_LONG * frames as f64 {
            return None;
        }
        let fits =
            self.scene.fits(cell, std::slice::from_ref(&self.observation), &[]).ok().filter(|it| it.explain())?;
        let mut quantities = self.scene.quantities_alone(&whole(&fits.tracks), &fits.whole, seed).ok()?;
        quantities.retain(|quantity| quantity.kind == QuantityKind::Force && quantity.low.is_some());
        Some(PartEstimate { part: recording.name.clone(), quantities })
    }
}
