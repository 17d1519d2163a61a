//! Paths through the blobs of all frames: a shortest-path search with a penalty on acceleration.
//!
//! A node is a blob, an edge joins blobs of different frames, and the score of a path is the sum of its nodes' rewards
//! less the penalties of its edges and of the change of velocity between two edges. The search over edges is exact, so
//! one wrong blob cannot lead a path astray.

use std::ops::Range;

use crate::options::Hint;

/// Earlier frames with blobs from which an edge may come.
const REACH: usize = 3;
/// Largest penalty for a change of velocity: a bounce costs no more than two frames' rewards.
const MOST_TURN: f64 = 2.0;
/// Share of the speed by which a step may differ from a constant velocity without much penalty.
const SPEED_SHARE: f64 = 0.35;
/// Share of the diameter by which a step may differ from a constant velocity without much penalty.
const SIZE_SHARE: f64 = 0.4;
/// Penalty per frame without a blob, and its limit.
const GAP: f64 = 0.25;
const MOST_GAP: f64 = 2.0;
/// Penalty for a change of weight by a factor e, and its limit.
const CHANGE: f64 = 0.3;
const MOST_CHANGE: f64 = 1.0;
/// Reward of a node at a hint, in frames.
const HINT: f64 = 1000.0;
/// Distance within which a hint is on a small node, pixels.
const LEAST_AIM: f64 = 4.0;

/// What linking needs of a blob.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LinkNode {
    pub(crate) frame: usize,
    pub(crate) centre: [f64; 2],
    pub(crate) weight: f64,
    /// Pixels.
    pub(crate) diameter: f64,
    /// Share of the reward that the node's looks leave, 0..=1.
    pub(crate) preference: f64,
}

impl LinkNode {
    /// Whether a hint is on it.
    fn is_at(&self, hint: &Hint) -> bool {
        hint.frame == self.frame && distance(hint.position, self.centre) < self.diameter.max(LEAST_AIM)
    }
}

/// Path through nodes.
#[derive(Debug, Clone)]
pub(crate) struct LinkPath {
    /// Indices of the nodes, one a frame at most, in order of time.
    pub(crate) nodes: Vec<usize>,
    pub(crate) score: f64,
}

#[derive(Clone, Copy)]
struct Link {
    from: usize,
    score: f64,
    /// Edge of `from` on the best path before this one.
    before: Option<usize>,
}

/// Up to `most` disjoint paths by descending score. `nodes` are sorted by frame. `scale` is the longest plausible step
/// of one frame, pixels.
pub(crate) fn paths(nodes: &[LinkNode], hints: &[Hint], scale: f64, most: usize) -> Vec<LinkPath> {
    let rewards = rewards(nodes, hints);
    let mut free = vec![true; nodes.len()];
    let mut found = Vec::new();
    while found.len() < most {
        let Some(path) = best(nodes, &rewards, &free, scale) else { break };
        path.nodes.iter().for_each(|&node| free[node] = false);
        found.push(path);
    }
    found
}

/// Median over the frames of the heaviest weight.
fn heaviest(nodes: &[LinkNode]) -> f64 {
    let mut weights: Vec<f64> = nodes
        .chunk_by(|a, b| a.frame == b.frame)
        .map(|frame| frame.iter().map(|node| node.weight).fold(0.0, f64::max))
        .collect();
    crate::statistics::median(&mut weights).unwrap_or(1.0)
}

/// Reward of every node: its weight against the heaviest ones, or its likeness to the hinted nodes where there are any.
fn rewards(nodes: &[LinkNode], hints: &[Hint]) -> Vec<f64> {
    let hinted = |node: &LinkNode| hints.iter().any(|hint| node.is_at(hint));
    let mut chosen: Vec<f64> = nodes.iter().filter(|node| hinted(node)).map(|node| node.weight).collect();
    let (typical, heavy) = crate::statistics::median(&mut chosen).map_or((heaviest(nodes), false), |w| (w, true));
    let reward = |node: &LinkNode| {
        let ratio = node.weight / typical;
        let likeness = if heavy && ratio > 1.0 { 1.0 / ratio } else { ratio };
        likeness.clamp(0.01, 1.0).sqrt() * node.preference + if hinted(node) { HINT } else { 0.0 }
    };
    nodes.iter().map(reward).collect()
}

/// The first hint in a tracked frame that is on no node, with the middle of the nearest one in its frame.
pub(crate) fn missed(nodes: &[LinkNode], hints: &[Hint], frames: &Range<usize>) -> Option<(Hint, Option<[f64; 2]>)> {
    let on_none = |hint: &&Hint| frames.contains(&hint.frame) && !nodes.iter().any(|node| node.is_at(hint));
    hints.iter().find(on_none).map(|hint| {
        let away = |node: &&LinkNode| distance(hint.position, node.centre);
        let nearest = nodes.iter().filter(|node| node.frame == hint.frame).min_by(|a, b| away(a).total_cmp(&away(b)));
        (*hint, nearest.map(|node| node.centre))
    })
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn best(nodes: &[LinkNode], rewards: &[f64], free: &[bool], scale: f64) -> Option<LinkPath> {
    let frames: Vec<std::ops::Range<usize>> = nodes
        .chunk_by(|a, b| a.frame == b.frame)
        .scan(0, |start, frame| {
            let range = *start..*start + frame.len();
            *start = range.end;
            Some(range)
        })
        .collect();
    let mut edges: Vec<Vec<Link>> = vec![Vec::new(); nodes.len()];
    let mut end: Option<(usize, usize)> = None;
    for (place, frame) in frames.iter().enumerate() {
        for to in frame.clone().filter(|&to| free[to]) {
            let earlier = frames[place.saturating_sub(REACH)..place].iter().flat_map(Clone::clone);
            for from in earlier.filter(|&from| free[from]) {
                let own = rewards[to] - step(&nodes[from], &nodes[to], scale);
                let fresh = Link { from, score: own + rewards[from], before: None };
                let edge = edges[from].iter().enumerate().fold(fresh, |best, (index, before)| {
                    let score = before.score + own - turn(&nodes[before.from], &nodes[from], &nodes[to]);
                    if score > best.score { Link { from, score, before: Some(index) } } else { best }
                });
                edges[to].push(edge);
                if end.is_none_or(|(node, index)| edges[node][index].score < edge.score) {
                    end = Some((to, edges[to].len() - 1));
                }
            }
        }
    }
    let (mut node, mut index) = end?;
    let score = edges[node][index].score;
    let mut path = vec![node];
    loop {
        let edge = edges[node][index];
        path.push(edge.from);
        let Some(before) = edge.before else { break };
        (node, index) = (edge.from, before);
    }
    path.reverse();
    Some(LinkPath { nodes: path, score })
}

/// Penalty of an edge: missing frames, change of weight, and steps beyond `scale`.
fn step(from: &LinkNode, to: &LinkNode, scale: f64) -> f64 {
    let frames = (to.frame - from.frame) as f64;
    let gap = (GAP * (frames - 1.0)).min(MOST_GAP);
    let change = (CHANGE * (from.weight / to.weight).ln().abs()).min(MOST_CHANGE);
    let far = (distance(from.centre, to.centre) / (scale * frames.min(4.0))).powi(2).min(4.0);
    gap + change + far
}

/// Penalty for the difference of a step from the velocity of the step before.
fn turn(first: &LinkNode, second: &LinkNode, third: &LinkNode) -> f64 {
    let (before, after) = ((second.frame - first.frame) as f64, (third.frame - second.frame) as f64);
    let velocity = [0, 1].map(|axis| (second.centre[axis] - first.centre[axis]) / before);
    let expected = [0, 1].map(|axis| second.centre[axis] + velocity[axis] * after);
    let free = 1.5 + SIZE_SHARE * third.diameter + SPEED_SHARE * velocity[0].hypot(velocity[1]) * after;
    (0.5 * (distance(expected, third.centre) / free).powi(2)).min(MOST_TURN)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(frame: usize, x: f64, y: f64, weight: f64) -> LinkNode {
        LinkNode { frame, centre: [x, y], weight, diameter: 6.0, preference: 1.0 }
    }

    #[test]
    fn two_crossing_movers_keep_their_straight_paths() {
        let mut nodes = Vec::new();
        for frame in 0..21 {
            let t = frame as f64;
            nodes.push(node(frame, 10.0 + 5.0 * t, 50.0, 100.0));
            nodes.push(node(frame, 110.0 - 5.0 * t, 50.5, 90.0));
        }
        let found = paths(&nodes, &[], 100.0, 2);
        for path in &found {
            assert_eq!(path.nodes.len(), 21);
            assert!(path.nodes.iter().all(|&n| n % 2 == path.nodes[0] % 2), "{path:?}");
        }
    }

    #[test]
    fn a_heavy_hand_in_a_third_of_the_frames_loses_against_a_light_ball() {
        let mut nodes = Vec::new();
        for frame in 0..30 {
            let t = frame as f64;
            if frame < 10 {
                nodes.push(node(frame, 20.0 + 9.0 * (t * 0.9).sin(), 20.0, 5000.0));
            }
            nodes.push(node(frame, 40.0 + 3.0 * t, 60.0 + 0.2 * t * t, 150.0));
        }
        let first = &paths(&nodes, &[], 100.0, 3)[0];
        assert!(first.nodes.iter().all(|&n| nodes[n].weight < 1000.0), "{first:?}");
        assert_eq!(first.nodes.len(), 30);
    }

    #[test]
    fn a_bounce_and_a_gap_do_not_end_a_path() {
        let nodes: Vec<LinkNode> = (0..30)
            .filter(|f| !(12..15).contains(f))
            .map(|f| node(f, 5.0 * f as f64, 100.0 - 6.0 * (f as f64 - 20.0).abs(), 50.0))
            .collect();
        assert_eq!(paths(&nodes, &[], 100.0, 1)[0].nodes.len(), 27);
    }

    #[test]
    fn a_hint_chooses_the_lighter_mover() {
        let nodes: Vec<LinkNode> = (0..20)
            .flat_map(|f| [node(f, 50.0, 4.0 * f as f64, 100.0), node(f, 150.0, 3.0 * f as f64, 10.0)])
            .collect();
        let hint = Hint { frame: 7, position: [151.0, 22.0] };
        assert_eq!(nodes[paths(&nodes, &[hint], 100.0, 1)[0].nodes[0]].weight, 10.0);
        assert_eq!(missed(&nodes, &[hint], &(0..20)), None);
        let beside = Hint { position: [80.0, 28.0], ..hint };
        assert_eq!(missed(&nodes, &[hint, beside], &(0..20)), Some((beside, Some([50.0, 28.0]))));
        let later = Hint { frame: 25, ..hint };
        assert_eq!(missed(&nodes, &[later], &(0..20)), None);
        assert_eq!(missed(&nodes, &[later], &(0..30)), Some((later, None)));
    }
}
