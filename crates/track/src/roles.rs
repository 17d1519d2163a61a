//! Roles of the movers: objects, their shadows, and hands that reach in.

use crate::candidates::PathCandidate;
use crate::detection::Detection;
use crate::track::Role;

/// Share of shadow-like pixels from which on a region may be a shadow, and below which it may cast one.
const SHADOW: f64 = 0.75;
const NO_SHADOW: f64 = 0.5;
/// Share of a shadow's frames in which its object is seen, too.
const TOGETHER: f64 = 0.6;
/// Correlation of the velocities of an object and its shadow.
const ALIKE: f64 = 0.5;
/// Share of a visitor's frames in which it touches the border.
const AT_BORDER: f64 = 0.6;
/// Largest share of the frames in which a visitor is seen.
const VISIT: f64 = 0.5;

/// Candidates with their roles: objects first, each group by rank.
pub(crate) fn roles(candidates: Vec<PathCandidate>, detections: &[Detection]) -> Vec<(Role, PathCandidate)> {
    let role = |index: usize| {
        let own = &candidates[index];
        let casts = |other: &PathCandidate| other.shadow < NO_SHADOW && moves_with(own, other, detections);
        if own.shadow > SHADOW && candidates.iter().enumerate().any(|(i, other)| i != index && casts(other)) {
            Role::Shadow
        } else if own.border > AT_BORDER && (own.nodes.len() as f64) < VISIT * detections.len() as f64 {
            Role::Visitor
        } else {
            Role::Object
        }
    };
    let roles: Vec<Role> = (0..candidates.len()).map(role).collect();
    let mut found: Vec<(Role, PathCandidate)> = roles.into_iter().zip(candidates).collect();
    found.sort_by_key(|(role, _)| *role != Role::Object);
    found
}

/// Whether a candidate is seen together with another and moves alike.
fn moves_with(own: &PathCandidate, other: &PathCandidate, detections: &[Detection]) -> bool {
    let steps = |candidate: &PathCandidate| -> Vec<(usize, [f64; 2])> {
        let nodes: Vec<_> = candidate.along(detections).map(|(d, blob, _)| (d.frame, blob.centre)).collect();
        nodes
            .windows(2)
            .filter(|w| w[1].0 == w[0].0 + 1)
            .map(|w| (w[0].0, [w[1].1[0] - w[0].1[0], w[1].1[1] - w[0].1[1]]))
            .collect()
    };
    let (mine, theirs) = (steps(own), steps(other));
    let (mut product, mut squares, mut count) = (0.0, [1e-9; 2], 0);
    for (frame, a) in &mine {
        if let Ok(place) = theirs.binary_search_by_key(frame, |step| step.0) {
            let b = theirs[place].1;
            product += a[0] * b[0] + a[1] * b[1];
            squares[0] += a[0] * a[0] + a[1] * a[1];
            squares[1] += b[0] * b[0] + b[1] * b[1];
            count += 1;
        }
    }
    let correlation = product / (squares[0] * squares[1]).sqrt();
    f64::from(count) > TOGETHER * mine.len() as f64 && count > 3 && correlation > ALIKE
}
