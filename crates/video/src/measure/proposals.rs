//! Parts of a video to be measured, where a person names none: the pieces in which its objects move freely.

use std::ops::Range;

use paig_track::{Limit, Segment};

/// A part that is shorter than this share of the longest one is left out.
const SHORT: f64 = 0.2;

/// Frames of one motion, and why it begins and ends there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Proposal {
    pub frames: Range<usize>,
    pub reason: String,
}

/// Parts in which all of the first `objects` tracks move freely, in order of time; at least `least` frames each.
pub(super) fn proposals(segments: &[Segment], objects: usize, least: usize) -> Vec<Proposal> {
    let of_track = |track: usize| joined(segments.iter().filter(|segment| segment.track == track));
    let mut common = of_track(0);
    for track in 1..objects {
        let others = of_track(track);
        let shared = |one: &Segment| {
            let both = |other: &Segment| Segment {
                frames: one.frames.start.max(other.frames.start)..one.frames.end.min(other.frames.end),
                begins: if other.frames.start > one.frames.start { other.begins } else { one.begins },
                ends: if other.frames.end < one.frames.end { other.ends } else { one.ends },
                ..one.clone()
            };
            others.iter().map(both).filter(|it| !it.frames.is_empty()).collect::<Vec<_>>()
        };
        common = common.iter().flat_map(shared).collect();
    }
    let longest = common.iter().map(|segment| segment.frames.len()).max().unwrap_or(0);
    let enough = |segment: &&Segment| segment.frames.len() >= least.max((SHORT * longest as f64) as usize);
    let proposal = |segment: &Segment| Proposal { frames: segment.frames.clone(), reason: segment.reason() };
    common.iter().filter(enough).map(proposal).collect()
}

/// The same with pieces joined between which an object is only lost from sight: it goes on.
fn joined<'a>(segments: impl Iterator<Item = &'a Segment>) -> Vec<Segment> {
    let mut joined: Vec<Segment> = Vec::new();
    for segment in segments {
        match joined.last_mut() {
            Some(last) if last.ends == Limit::Lost && segment.begins == Limit::Lost => {
                last.frames.end = segment.frames.end;
                last.ends = segment.ends;
                last.impacts.extend(&segment.impacts);
            }
            _ => joined.push(segment.clone()),
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(track: usize, frames: Range<usize>, begins: Limit, ends: Limit) -> Segment {
        Segment { track, frames, begins, ends, impacts: Vec::new() }
    }

    fn frames(segments: &[Segment], objects: usize) -> Vec<Range<usize>> {
        proposals(segments, objects, 8).into_iter().map(|proposal| proposal.frames).collect()
    }

    #[test]
    fn throws_are_apart_and_a_hidden_swing_goes_on() {
        let throws = [
            segment(0, 30..62, Limit::Hand, Limit::Hand),
            segment(0, 90..94, Limit::Hand, Limit::Hand),
            segment(0, 120..155, Limit::Hand, Limit::Border),
        ];
        assert_eq!(frames(&throws, 1), [30..62, 120..155]);
        assert!(proposals(&throws, 1, 8)[0].reason.contains("a hand lets it go"));
        let hidden = [
            segment(0, 10..80, Limit::Hand, Limit::Lost),
            segment(0, 95..400, Limit::Lost, Limit::Video),
            segment(1, 0..400, Limit::Video, Limit::Video),
        ];
        assert_eq!(frames(&hidden, 1), vec![10..400]);
    }

    #[test]
    fn two_objects_are_measured_while_both_move() {
        let both = [
            segment(0, 10..200, Limit::Hand, Limit::Border),
            segment(1, 40..90, Limit::Hand, Limit::Hand),
            segment(1, 120..260, Limit::Hand, Limit::Video),
        ];
        assert_eq!(frames(&both, 2), [40..90, 120..200]);
    }
}
