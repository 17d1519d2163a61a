//! Movers of a video: paths through the detections, ranked.

use crate::background::{KeptFrames, StaticScene};
use crate::components::Blob;
use crate::detection::Detection;
use crate::error::TrackError;
use crate::linking::{LinkNode, missed, paths};
use crate::mask::Mask;
use crate::options::TrackingOptions;
use crate::pieces::{Stop, pieces};
use crate::quality;
use crate::shadow::Core;
use crate::statistics::{median, quantile};
use crate::video::Size;

/// Fewest regions of a mover.
const LEAST_NODES: usize = 5;
/// Longest plausible step of one frame, as a share of the frame's diagonal.
const LONGEST_STEP: f64 = 0.25;
/// Extent of a path over the object's diameter from which on the path counts fully.
const MOVING: f64 = 1.5;
/// Extent from which on the pixels of a path count as occupied.
const OCCUPIES: f64 = 0.5;
/// Pixels around a moving region that count as occupied.
const OCCUPIED_MARGIN: u32 = 3;

/// Path of one mover.
#[derive(Debug, Clone)]
pub(crate) struct PathCandidate {
    /// Index of the detection and of its blob, in order of time.
    pub(crate) nodes: Vec<(usize, usize)>,
    pub(crate) score: f64,
    /// Extent of the path over the diameter of the object.
    pub(crate) extent: f64,
    /// Median second difference of the positions over that in shuffled order, at most 1.
    pub(crate) chance: f64,
    /// Median diameter, pixels.
    pub(crate) diameter: f64,
    /// Median share of shadow-like pixels.
    pub(crate) shadow: f64,
    /// Share of the nodes that touch the border of the frame.
    pub(crate) border: f64,
}

impl PathCandidate {
    /// Score that counts movement and smoothness.
    pub(crate) fn rank(&self) -> f64 {
        self.score * (self.extent / MOVING).min(1.0) * (1.0 - self.chance).max(0.05)
    }

    /// Detections, blobs and cores along the path.
    pub(crate) fn along<'a>(
        &'a self,
        detections: &'a [Detection],
    ) -> impl Iterator<Item = (&'a Detection, &'a Blob, &'a Core)> + 'a {
        self.nodes.iter().map(|&(detection, blob)| {
            let detection = &detections[detection];
            let (blob, core) = &detection.blobs[blob];
            (detection, blob, core)
        })
    }
}

/// Paths through the detections by descending rank.
///
/// # Errors
/// [`TrackError::HintOnNothing`].
pub(crate) fn candidates(
    detections: &[Detection],
    size: Size,
    options: &TrackingOptions,
) -> Result<Vec<PathCandidate>, TrackError> {
    let mut places = Vec::new();
    let mut nodes = Vec::new();
    for (index, detection) in detections.iter().enumerate() {
        for (blob_index, (blob, core)) in detection.blobs.iter().enumerate() {
            places.push((index, blob_index));
            nodes.push(LinkNode {
                frame: detection.frame,
                centre: blob.centre,
                weight: blob.weight,
                diameter: blob.diameter(),
                preference: 1.0 - 0.5 * core.shadow.powi(2),
            });
        }
    }
    let frames = detections.first().map_or(0..0, |first| first.frame..first.frame + detections.len());
    if let Some((hint, nearest)) = missed(&nodes, &options.hints, &frames) {
        return Err(TrackError::HintOnNothing { hint, nearest });
    }
    let scale = LONGEST_STEP * (size.width as f64).hypot(size.height as f64);
    let mut found: Vec<PathCandidate> = paths(&nodes, &options.hints, scale, options.most_movers())
        .into_iter()
        .flat_map(|path| {
            let stop = |&node: &usize| {
                let core = &detections[places[node].0].blobs[places[node].1].1;
                let LinkNode { frame, centre, diameter, .. } = nodes[node];
                Stop { frame, centre, diameter, colour: core.colour }
            };
            let stops: Vec<Stop> = path.nodes.iter().map(stop).collect();
            pieces(&stops).into_iter().filter(|group| group.len() >= LEAST_NODES).map(move |group| {
                let share = group.len() as f64 / path.nodes.len() as f64;
                (group.into_iter().map(|index| path.nodes[index]).collect::<Vec<_>>(), share * path.score)
            })
        })
        .map(|(nodes, score)| candidate(nodes.iter().map(|&node| places[node]).collect(), score, detections, size))
        .collect();
    found.sort_by(|a, b| b.rank().total_cmp(&a.rank()));
    Ok(found)
}

fn candidate(nodes: Vec<(usize, usize)>, score: f64, detections: &[Detection], size: Size) -> PathCandidate {
    let blobs: Vec<&(Blob, Core)> = nodes.iter().map(|&(d, b)| &detections[d].blobs[b]).collect();
    let middle = |value: &dyn Fn(&(Blob, Core)) -> f64| {
        let mut values: Vec<f64> = blobs.iter().map(|b| value(b)).collect();
        median(&mut values).unwrap_or(0.0)
    };
    let diameter = middle(&|b| b.0.diameter()).max(1.0);
    let range = |axis: usize| {
        let values: Vec<f64> = blobs.iter().map(|b| b.0.centre[axis]).collect();
        let rank = |share| quantile(&mut values.clone(), share).unwrap_or(0.0);
        rank(0.95) - rank(0.05)
    };
    let positions: Vec<Option<[f64; 2]>> = blobs.iter().map(|b| Some(b.0.centre)).collect();
    let at_border = blobs.iter().filter(|b| b.0.touches_border(size.width, size.height)).count();
    PathCandidate {
        score,
        extent: range(0).hypot(range(1)) / diameter,
        chance: quality::chance(&positions).unwrap_or(0.5).min(1.0),
        diameter,
        shadow: middle(&|b| b.1.shadow),
        border: at_border as f64 / blobs.len() as f64,
        nodes,
    }
}

/// Pixels of each sample that a mover occupies.
///
/// An object that rests in most frames is part of the median background: while it is away, a region that never moves
/// shows where it rested. Frames without the first mover count as occupied there.
pub(crate) fn occupied(samples: &KeptFrames, detections: &[Detection], candidates: &[PathCandidate]) -> Vec<Mask> {
    let first = detections.first().map_or(0, |d| d.frame);
    let moves = |c: &&PathCandidate| c.extent >= OCCUPIES;
    let mut resting = Mask::default();
    for candidate in candidates.iter().filter(|c| !moves(c) && c.nodes.len() > 2) {
        for (_, blob, _) in candidate.along(detections) {
            resting.join(&blob.mask);
        }
    }
    let resting = resting.widened(OCCUPIED_MARGIN);
    let main = candidates.iter().find(moves);
    samples
        .indices()
        .map(|frame| {
            let index = frame - first;
            let mut mask = Mask::default();
            for candidate in candidates.iter().filter(moves) {
                for &(_, blob) in candidate.nodes.iter().filter(|node| node.0 == index) {
                    mask.join(&detections[index].blobs[blob].0.mask);
                }
            }
            let mut mask = mask.widened(OCCUPIED_MARGIN);
            if main.is_some_and(|main| main.nodes.iter().all(|node| node.0 != index)) {
                mask.join(&resting);
            }
            mask
        })
        .collect()
}

/// Pixels in which two backgrounds differ by more than four times the noise.
pub(crate) fn changed(one: &StaticScene, other: &StaticScene) -> usize {
    let differs = |(a, b): (&f32, &f32)| (a - b).abs() > 4.0 * one.noise;
    let pairs = one.levels.iter().zip(other.levels.iter()).collect::<Vec<_>>();
    pairs.chunks_exact(3).filter(|pixel| pixel.iter().any(|&pair| differs(pair))).count()
}
