//! Observed positions of a measurement, as `positions.csv` holds them.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use paig::support::statistics::upper_median;
use paig::support::storage;

use super::super::positions_file::FILE;

/// Position of an object in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    /// Place of its video, or part of a video, among those measured.
    pub recording: usize,
    pub frame: u64,
    pub seconds: f64,
    /// From 0 on.
    pub object: usize,
    /// Pixels of the video.
    pub seen: [f64; 2],
}

/// All positions of a measurement.
pub(super) struct Observed {
    pub videos: Vec<String>,
    pub rows: Vec<Row>,
    /// Median time between two frames, seconds.
    pub interval: f64,
}

impl Observed {
    /// Reads the positions of a measurement's folder; rows without a position are left out.
    ///
    /// # Errors
    /// A missing or damaged file, one without positions.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let named = || format!("positions {}", path.display());
        Self::of(&storage::read(&path).with_context(named)?).with_context(named)
    }

    fn of(bytes: &[u8]) -> Result<Self> {
        let mut reader = csv::Reader::from_reader(bytes);
        let headers = reader.headers().context("not a table")?.clone();
        let column = |name: &str| {
            headers.iter().position(|header| header == name).with_context(|| format!("it has no column {name}"))
        };
        let (video, frame, seconds, object) =
            (column("video")?, column("frame")?, column("seconds")?, column("object")?);
        let seen = [column("seen_x_video_px")?, column("seen_y_video_px")?];
        let (mut videos, mut rows) = (Vec::<String>::new(), Vec::new());
        let mut place: HashMap<String, usize> = HashMap::new();
        for record in reader.records() {
            let record = record.context("a damaged line")?;
            let name = &record[video];
            let recording = *place.entry(name.into()).or_insert_with(|| {
                videos.push(name.into());
                videos.len() - 1
            });
            let number = |column: usize| record[column].parse::<f64>();
            let [x, y] = seen.map(number);
            let (frame, seconds) = (record[frame].parse::<u64>()?, number(seconds)?);
            let object = record[object].parse::<usize>()?.checked_sub(1).context("objects count from 1")?;
            if let Some(seen) = x.ok().zip(y.ok()).filter(|(x, y)| x.is_finite() && y.is_finite()) {
                rows.push(Row { recording, frame, seconds, object, seen: [seen.0, seen.1] });
            }
        }
        ensure!(!rows.is_empty(), "no positions in it");
        let of_first = rows.iter().filter(|row| row.object == rows[0].object).collect::<Vec<_>>();
        let steps = of_first.windows(2).filter(|pair| pair[0].recording == pair[1].recording);
        let steps =
            steps.map(|pair| (pair[1].seconds - pair[0].seconds) / (pair[1].frame - pair[0].frame).max(1) as f64);
        let interval = upper_median(steps).unwrap_or(0.0);
        Ok(Observed { videos, rows, interval })
    }

    pub fn objects(&self) -> usize {
        self.rows.iter().map(|row| row.object + 1).max().unwrap_or(0)
    }
}
