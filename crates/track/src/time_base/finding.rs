//! Findings about the time base, each with its consequence.

use serde::{Deserialize, Serialize};

/// Origin of a slow-motion factor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FactorSource {
    /// A person gave it.
    Given,
    /// The camera's tag of its capture rate.
    Tag,
}

/// Contradiction between a file's times and its content, or something that a fit must know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Finding {
    /// The source has no times.
    NoTimes,
    /// Time stamps do not ascend from this frame on.
    NotAscending { frame: usize },
    /// Time between two frames varies; milliseconds.
    Variable { shortest: f64, median: f64, longest: f64 },
    /// The stamps leave gaps of whole intervals: so many frames are missing.
    Gaps { frames: Vec<usize>, missing: usize },
    /// The rate of the stamps changes for good; frames a second before and after.
    RateChange { frame: usize, before: f64, after: f64 },
    /// No camera films at this rate, frames a second.
    Impossible { rate: f64 },
    /// A stated rate at which hardly any camera films, frames a second.
    TooFast { rate: f64 },
    /// An unusual rate, frames a second.
    Unusual { rate: f64 },
    /// The header claims another rate than the stamps; frames a second.
    Claimed { claimed: f64, stamps: f64 },
    /// The file plays slower than it was filmed; the times were divided by the factor.
    SlowMotion { factor: f64, source: FactorSource },
    /// The edit list plays pieces at other speeds.
    EditedSpeed { rates: Vec<f64> },
    /// Pictures that repeat the one before.
    Repeated { frames: Vec<usize> },
    /// Some of every so many frames repeat the one before; the rate of the new ones, frames a second.
    RepeatedRegularly { repeats: usize, of: usize, rate: Option<f64> },
    /// One of every so many frames is a mixture of its neighbours.
    Blended { of: usize },
    /// The object jumps ahead by whole frames: frames were dropped, though the stamps are regular.
    Dropped { frames: Vec<usize>, missing: usize },
    /// The object's speed changes at once, in the same direction, by a factor.
    SpeedChange { frame: usize, factor: f64 },
}

impl Finding {
    /// Finding and consequence.
    pub fn line(&self) -> String {
        match self {
            Self::NoTimes => "the video has no times; give --fps to measure in seconds".into(),
            Self::NotAscending { frame } => {
                format!("the time stamps do not ascend at frame {frame}; give --fps")
            }
            Self::Variable { shortest, median, longest } => format!(
                "the frame rate varies ({shortest:.1} to {longest:.1} ms, mostly {median:.1} ms); each frame's own time is used"
            ),
            Self::Gaps { frames, missing } => format!(
                "{missing} frames are missing by the time stamps, before {}; the times stay right",
                listed(frames)
            ),
            Self::RateChange { frame, before, after } => format!(
                "the frame rate changes from {before:.4} to {after:.4} a second at frame {frame}; each frame's own time is used"
            ),
            Self::Impossible { rate } => {
                format!(
                    "{rate:.0} frames a second are no camera's rate; times in seconds are wrong until --fps is given"
                )
            }
            Self::TooFast { rate } => {
                format!("{rate:.0} frames a second are more than nearly all cameras film; check --fps or --slow-motion")
            }
            Self::Unusual { rate } => format!(
                "{rate:.2} frames a second are unusual; 1 % in the time is 2 % in an acceleration: give --fps if you know it"
            ),
            Self::Claimed { claimed, stamps } => format!(
                "the header claims {claimed:.2} frames a second, the time stamps {stamps:.2}; the time stamps are used"
            ),
            Self::SlowMotion { factor, source } => {
                let why = match source {
                    FactorSource::Given => "as given",
                    FactorSource::Tag => "by the camera's tag",
                };
                format!("the file plays {factor:.4} times as slow as it was filmed ({why}); times are divided by that")
            }
            Self::EditedSpeed { rates } => {
                let rates: Vec<String> = rates.iter().map(|rate| format!("{rate}")).collect();
                format!(
                    "the edit list plays pieces at speeds of {}; times are those of the presentation, cut at the changes",
                    rates.join(", ")
                )
            }
            Self::Repeated { frames } => {
                format!("{} repeat the one before; they have no positions", listed(frames))
            }
            Self::RepeatedRegularly { repeats, of, rate } => {
                let rate = rate.map_or(String::new(), |rate| format!(" of {rate:.4} frames a second"));
                format!(
                    "{repeats} of every {of} frames repeat the one before: converted from a video{rate}; the others are timed \
                     evenly, repetitions have no positions"
                )
            }
            Self::Blended { of } => format!(
                "one of every {of} frames is blended from its neighbours: converted from another rate; these have no positions"
            ),
            Self::Dropped { frames, missing } => format!(
                "the object jumps ahead at {}: {missing} dropped frames that the stamps do not show; fits are cut there",
                listed(frames)
            ),
            Self::SpeedChange { frame, factor } => format!(
                "the speed changes {factor:.2}-fold at once at frame {frame}, in the same direction: a blow, or slow motion \
                 begins or ends; fits are cut there"
            ),
        }
    }
}

/// `frame 7`, `frames 7, 9` or `30 frames (7, 9, 11, ..)`.
fn listed(frames: &[usize]) -> String {
    let some: Vec<String> = frames.iter().take(3).map(ToString::to_string).collect();
    match frames {
        [one] => format!("frame {one}"),
        few if few.len() <= 3 => format!("frames {}", some.join(", ")),
        many => format!("{} frames ({}, ..)", many.len(), some.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_short() {
        assert_eq!(listed(&[7]), "frame 7");
        assert_eq!(listed(&[7, 9]), "frames 7, 9");
        assert_eq!(listed(&[1, 2, 3, 4]), "4 frames (1, 2, 3, ..)");
    }
}
