//! A measurement beside somebody else's track. See `paig compare-track --help`.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use paig::support::atomic;
use paig::support::output::{FileKind, has_keys};
use paig::support::significant::significant;
use paig_terminal::say;
use paig_video::measure::compare_track::{Estimate, TrackComparison, compare_track};
use paig_video::reference_track::ReferenceTrack;

/// Holds a measurement against a track that somebody else made of the same video: distances of the positions, and the same
/// equation fitted to both.
///
/// The track is a table (.csv, .tsv, .txt, .xlsx, .xls, .ods) with a header: a column of frames (`frame`) or seconds (`t`, `time`)
/// and columns `x` and `y` (`x1`, `y1`, `x2`, .. for several points; units in brackets), or a file of the program Tracker (.trk,
/// .trz). Tracks in pixels are aligned by an offset; others by an offset, a scale, a turn and the direction of y.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  paig compare-track measured trajectory.csv\n  \
                        paig compare-track measured experiment.trk --json comparison.json")]
pub struct CompareTrackArguments {
    /// Folder of a measurement
    measurement: PathBuf,
    /// The track
    track: PathBuf,
    /// Write the comparison to this file, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The comparison as a file that the program recognizes.
const COMPARISON: FileKind = FileKind {
    name: "a comparison of `paig compare-track`",
    recognizes: |json| has_keys(json, &["unit", "alignment", "points", "quantities"]),
};

pub fn run(arguments: &CompareTrackArguments) -> Result<()> {
    let json = arguments.json.as_deref().map(|path| COMPARISON.check(path, &[&arguments.track])).transpose()?;
    let track = ReferenceTrack::read(&arguments.track)?;
    let comparison = compare_track(&arguments.measurement, &track)?;
    show(&comparison);
    if let Some(path) = json {
        atomic::write_file(&path, |file| Ok(serde_json::to_writer_pretty(file, &comparison)?))?;
    }
    Ok(())
}

fn show(comparison: &TrackComparison) {
    let TrackComparison { unit, alignment, points, quantities } = comparison;
    let direction = if alignment.y_up { "y up" } else { "y down" };
    say!(
        "alignment: {} px to 1 {unit}, turned by {:.2} degrees, {direction}, {} frames later",
        significant(alignment.pixels_per_unit, 5),
        alignment.degrees,
        alignment.shift
    );
    say!();
    say!(
        "{:<20}{:>8}{:>8}{:>12}{:>12}{:>12}  of the diameter",
        "point",
        "object",
        "frames",
        "median",
        "rms",
        "largest"
    );
    for point in points {
        let of_diameter = point.of_diameter.map_or("-".into(), |share| format!("{:.1} %", 100.0 * share));
        say!(
            "{:<20}{:>8}{:>8}{:>9.3} px{:>9.3} px{:>9.3} px  {of_diameter}",
            point.name,
            point.object,
            point.frames,
            point.median,
            point.root_mean_square,
            point.largest
        );
    }
    if quantities.is_empty() {
        return;
    }
    say!();
    say!("{:<24}{:>34}{:>34}{:>34}  unit", "quantity", "measured", "our track, shared frames", "the other track");
    for quantity in quantities {
        let text = |estimate: Option<&Estimate>| estimate.map_or("-".into(), text);
        let other = quantity
            .in_other_unit
            .map_or(String::new(), |value| format!(" ({} in units of {unit})", significant(value, 5)));
        say!(
            "{:<24}{:>34}{:>34}{:>34}  {}{other}",
            quantity.name,
            text(Some(&quantity.measured)),
            text(quantity.by_our_track.as_ref()),
            text(quantity.by_other_track.as_ref()),
            quantity.unit
        );
    }
}

/// `9.81 [9.7, 9.9]`.
fn text(estimate: &Estimate) -> String {
    let digits = |value: f64| significant(value, 5);
    let interval = estimate.low.zip(estimate.high).map(|(low, high)| format!(" [{}, {}]", digits(low), digits(high)));
    format!("{}{}", digits(estimate.value), interval.unwrap_or_default())
}
