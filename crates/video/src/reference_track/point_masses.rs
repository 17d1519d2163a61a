//! Point masses of files of the program Tracker.

use std::path::Path;

use anyhow::Result;

use super::{Position, ReferenceTrack, TrackedPoint};
use crate::import::tracker::{document, number, property, text};

/// Point masses of a file, in pixels of the video. Frames are numbered as in the video.
///
/// # Errors
/// No such file, no XML, positions without a number.
pub(super) fn track(path: &Path) -> Result<ReferenceTrack> {
    let text = text(path)?;
    let document = document(&text)?;
    let interval = number(document.root(), "delta_t")?.filter(|interval| *interval > 0.0).map(|it| it / 1000.0);
    let masses = document.descendants().filter(|it| {
        it.has_tag_name("object") && it.attribute("class").is_some_and(|class| class.ends_with(".tracker.PointMass"))
    });
    let points = masses.map(|mass| {
        let name = property(mass, "name").and_then(|name| name.text()).unwrap_or("point mass").to_string();
        let frames = property(mass, "framedata").into_iter().flat_map(|frames| frames.children());
        let mut positions = Vec::new();
        for frame in frames {
            let Some(place) = frame.attribute("name").and_then(|name| name.trim_matches(['[', ']']).parse().ok())
            else {
                continue;
            };
            if let Some((x, y)) = number(frame, "x")?.zip(number(frame, "y")?) {
                let seconds = interval.map(|interval| interval * place as f64);
                positions.push(Position { frame: Some(place), seconds, at: [x, y] });
            }
        }
        Ok(TrackedPoint { name, positions })
    });
    Ok(ReferenceTrack { points: points.collect::<Result<_>>()?, unit: "px".into() })
}
