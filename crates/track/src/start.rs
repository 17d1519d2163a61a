//! Expected positions of a mover: what the registration starts from.

use std::ops::Range;

use crate::candidates::PathCandidate;
use crate::detection::Detection;
use crate::statistics::median;

/// Shares of shadow-like pixels between which the rest of a region is taken as the object.
const PARTLY_SHADOW: Range<f64> = 0.12..0.75;
/// Factor of the typical weight within which a frame is typical.
const TYPICAL: f64 = 1.6;

/// Expected positions of a mover from the first to the last frame of its path.
pub(crate) struct ExpectedPath {
    /// First frame.
    pub(crate) first: usize,
    /// Positions `[x, y]`, pixels.
    pub(crate) positions: Vec<[f64; 2]>,
    /// Whether the region in a frame looks as in most frames.
    pub(crate) typical: Vec<bool>,
    /// How much the object moves in a frame, 0..=1. A resting object cannot be told from the background.
    pub(crate) moving: Vec<f64>,
    /// Reach of the object from its position along x and y, pixels.
    pub(crate) reach: [f64; 2],
}

impl ExpectedPath {
    /// Frames of the course.
    pub(crate) fn frames(&self) -> Range<usize> {
        self.first..self.first + self.positions.len()
    }
}

/// Region of one frame, without its shadow where the mover has one.
struct FrameRegion {
    frame: usize,
    centre: [f64; 2],
    reach: [f64; 2],
    weight: f64,
}

/// Expected positions of a candidate; frames without a region are interpolated.
pub(crate) fn course(candidate: &PathCandidate, detections: &[Detection]) -> ExpectedPath {
    let without_shadow = PARTLY_SHADOW.contains(&candidate.shadow);
    let regions: Vec<FrameRegion> = candidate
        .along(detections)
        .map(|(detection, blob, core)| {
            let [left, top, right, bottom] = blob.bounds.map(|b| b as f64);
            let whole = ([right - left, bottom - top].map(|side| 0.5 * side), blob.centre);
            let (reach, centre) = match core.centre {
                Some(centre) if without_shadow => (core.reach, centre),
                _ => whole,
            };
            FrameRegion { frame: detection.frame, centre, reach, weight: blob.weight }
        })
        .collect();
    let moves = speeds(&regions, candidate.diameter);
    let weight = weighted_median(&regions, &moves, |region| region.weight);
    let reach = [0, 1].map(|axis| weighted_median(&regions, &moves, |region| region.reach[axis]));
    let first = regions[0].frame;
    let mut positions = Vec::new();
    let mut typical = Vec::new();
    let mut moving = Vec::new();
    for (pair, moves) in regions.windows(2).zip(&moves) {
        let frames = pair[1].frame - pair[0].frame;
        for step in 0..frames {
            let share = step as f64 / frames as f64;
            positions.push([0, 1].map(|axis| pair[0].centre[axis] * (1.0 - share) + pair[1].centre[axis] * share));
            typical.push(step == 0 && is_typical(&pair[0], weight));
            moving.push(if step == 0 { *moves } else { 0.0 });
        }
    }
    let last = &regions[regions.len() - 1];
    positions.push(last.centre);
    typical.push(is_typical(last, weight));
    moving.push(moves[moves.len() - 1]);
    if typical.iter().filter(|&&t| t).count() < 4 {
        typical.fill(true);
    }
    ExpectedPath { first, positions, typical, moving, reach }
}

fn is_typical(region: &FrameRegion, weight: f64) -> bool {
    (weight / TYPICAL..weight * TYPICAL).contains(&region.weight)
}

/// How much the mover moves in each region's frame, between 0.02 and 1: an object in a hand moves less than a free one.
fn speeds(regions: &[FrameRegion], diameter: f64) -> Vec<f64> {
    (0..regions.len())
        .map(|i| {
            let (a, b) = (&regions[i.saturating_sub(1)], &regions[(i + 1).min(regions.len() - 1)]);
            let frames = (b.frame - a.frame).max(1) as f64;
            let step = (b.centre[0] - a.centre[0]).hypot(b.centre[1] - a.centre[1]) / frames;
            (step / (0.1 * diameter)).clamp(0.02, 1.0)
        })
        .collect()
}

fn weighted_median(regions: &[FrameRegion], weights: &[f64], value: impl Fn(&FrameRegion) -> f64) -> f64 {
    let mut pairs: Vec<(f64, f64)> = regions.iter().zip(weights).map(|(r, &w)| (value(r), w)).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * weights.iter().sum::<f64>();
    let mut below = 0.0;
    for &(value, weight) in &pairs {
        below += weight;
        if below >= half {
            return value;
        }
    }
    median(&mut pairs.into_iter().map(|p| p.0).collect::<Vec<_>>()).unwrap_or(0.0)
}
