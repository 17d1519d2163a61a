//! Tracks that somebody else made of a video: tables (`.csv`, `.tsv`, `.txt`, `.xlsx`, `.xls`, `.ods`) and files of the program
//! Tracker (`.trk`, `.trz`).

mod columns;
mod point_masses;
mod table;

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

/// Fewest positions of a point.
const LEAST_POSITIONS: usize = 4;

/// Unit of a track that does not give it.
pub const UNKNOWN: &str = "?";

/// Points of one file.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceTrack {
    pub points: Vec<TrackedPoint>,
    /// Unit of the positions: `px` of the video, a length, or [`UNKNOWN`].
    pub unit: String,
}

/// A tracked point.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedPoint {
    pub name: String,
    pub positions: Vec<Position>,
}

/// Position of a point in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Number of the frame, from 0 on; none in tables of times alone.
    pub frame: Option<u64>,
    /// Seconds from the beginning of the video; none in tables of frames alone.
    pub seconds: Option<f64>,
    pub at: [f64; 2],
}

impl ReferenceTrack {
    /// Reads a file; its ending says of which kind it is.
    ///
    /// # Errors
    /// A missing, damaged or unknown file, a table without columns of time and place, too few positions.
    pub fn read(path: &Path) -> Result<Self> {
        let read = || {
            let ending = path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_lowercase();
            match ending.as_str() {
                "trk" | "trz" => point_masses::track(path),
                "csv" | "tsv" | "txt" => columns::track(&table::of_text(path)?),
                "xlsx" | "xls" | "ods" => columns::track(&table::of_spreadsheet(path)?),
                _ => bail!("unknown ending; expected .csv, .tsv, .txt, .xlsx, .xls, .ods, .trk or .trz"),
            }
        };
        let track = read().with_context(|| format!("track {}", path.display()))?;
        ensure!(!track.points.is_empty(), "track {}: no tracked point in it", path.display());
        for point in &track.points {
            ensure!(
                point.positions.len() >= LEAST_POSITIONS,
                "track {}: {} has {} positions; {LEAST_POSITIONS} are the least",
                path.display(),
                point.name,
                point.positions.len()
            );
        }
        Ok(track)
    }
}
