//! A measurement beside a track that somebody else made of the same video: distances of the positions, and the same equation
//! fitted to both in the frames that they share.

mod alignment;
mod observed;

use std::path::Path;

use anyhow::{Context, Result, ensure};
use paig::network::cells::Equations;
use serde::Serialize;
use tch::no_grad_guard;

pub use self::alignment::Alignment;
use self::alignment::PositionPair;
use self::observed::{Observed, Row};
use super::native::coordinates;
use super::of_video::{LEAST_FRAMES, piece_of};
use super::recording::{Observation, Positions, RecordedSystem, Recording, learned_from};
use super::results::{Measurement, Quantity, SceneRecord};
use super::scale::Scale;
use crate::reference_track::{ReferenceTrack, TrackedPoint, UNKNOWN};

/// Frames by which the numbering of another track may be off, and the share of the distance that a shift must save.
const SHIFTS: i64 = 10;
const SAVES: f64 = 0.3;
/// Fewest positions in common.
const LEAST_PAIRS: usize = 6;
/// Share of the largest number of pairs that a shift must keep.
const KEPT: f64 = 0.8;
/// An offset alone is kept for tracks in pixels unless a similarity leaves less than this share of its distance.
const SIMILAR: f64 = 0.5;

/// Both tracks side by side.
#[derive(Debug, Clone, Serialize)]
pub struct TrackComparison {
    /// Unit of the other track.
    pub unit: String,
    pub alignment: Alignment,
    pub points: Vec<PointDistances>,
    /// Empty where too few frames are shared, or no equation is known.
    pub quantities: Vec<ComparedQuantity>,
}

/// Distances between the positions of one object, pixels of the video.
#[derive(Debug, Clone, Serialize)]
pub struct PointDistances {
    /// Its name in the other track.
    pub name: String,
    /// Number of our object, from 1 on.
    pub object: usize,
    pub frames: usize,
    pub median: f64,
    pub root_mean_square: f64,
    pub largest: f64,
    /// The median over the object's diameter; none where that is not known.
    pub of_diameter: Option<f64>,
}

/// A value with its 95 % interval.
#[derive(Debug, Clone, Serialize)]
pub struct Estimate {
    pub value: f64,
    pub low: Option<f64>,
    pub high: Option<f64>,
}

/// One quantity by the whole measurement, and by both tracks in the shared frames.
#[derive(Debug, Clone, Serialize)]
pub struct ComparedQuantity {
    pub name: String,
    pub unit: String,
    pub measured: Estimate,
    pub by_our_track: Option<Estimate>,
    pub by_other_track: Option<Estimate>,
    /// The last in the unit of the other track, where ours are pixels.
    pub in_other_unit: Option<f64>,
}

/// Holds a measurement against a track.
///
/// # Errors
/// A folder without a measurement, one of an earlier version, too few frames that both have.
pub fn compare_track(folder: &Path, track: &ReferenceTrack) -> Result<TrackComparison> {
    let _guard = no_grad_guard();
    let measurement = Measurement::read(folder)?;
    let record = measurement.scene.as_ref().with_context(|| {
        format!("{} is of an earlier version, which does not record the equation; measure again", folder.display())
    })?;
    let observed = Observed::read(folder)?;
    let matched = Matched::best(&observed, track)?;
    let long = matched.long(&observed);
    let scene = scene(record, &observed, &long)?;
    let fitted = |theirs: bool| scene.as_ref().map(|scene| fitted(scene, &matched, &long, theirs)).transpose();
    let [ours, theirs] = [fitted(false)?.unwrap_or_default(), fitted(true)?.unwrap_or_default()];
    let of = |all: &[Quantity], name: &str| all.iter().find(|it| it.name == name).map(Estimate::of);
    let unit = matched.unit(track);
    let in_other_unit = |name: &str, by_track: &Option<Estimate>| {
        let scene = scene.as_ref().filter(|scene| unit != "px" && scene.scale.length_unit() == "px")?;
        let parameter = scene.system.cell.parameters.iter().find(|it| it.name == name)?;
        let [length, _] = Scale::powers(parameter)?;
        Some(by_track.as_ref()?.value * matched.alignment.pixels_per_unit.powi(-length))
    };
    let quantities = measurement.quantities.iter().map(|quantity| {
        let by_other_track = of(&theirs, &quantity.name);
        ComparedQuantity {
            name: quantity.name.clone(),
            unit: quantity.unit.clone(),
            measured: Estimate::of(quantity),
            by_our_track: of(&ours, &quantity.name),
            in_other_unit: in_other_unit(&quantity.name, &by_other_track),
            by_other_track,
        }
    });
    Ok(TrackComparison {
        unit: unit.into(),
        alignment: matched.alignment,
        points: matched.distances(track, &measurement.diameters),
        quantities: quantities.collect(),
    })
}

impl Estimate {
    fn of(quantity: &Quantity) -> Self {
        Estimate { value: quantity.value, low: quantity.low, high: quantity.high }
    }
}

/// Positions of both tracks in the same frames.
struct Matched {
    alignment: Alignment,
    /// Place of the other track's point of each of our objects.
    points: Vec<usize>,
    /// Of each of our objects.
    rows: Vec<MatchedRows>,
}

/// Rows of one of our objects, each with the other track's position.
type MatchedRows = Vec<(Row, [f64; 2])>;

/// An assignment of points to objects, and a shift.
struct TrackAssignment {
    points: Vec<usize>,
    shift: i64,
    rows: Vec<MatchedRows>,
}

impl TrackAssignment {
    /// Shared frames of the object with the fewest.
    fn pairs(&self) -> usize {
        self.rows.iter().map(Vec::len).min().unwrap_or(0)
    }

    /// With its alignment, and the median distance that is left.
    fn aligned(self, track: &ReferenceTrack) -> (f64, Matched) {
        let TrackAssignment { points, shift, rows } = self;
        let pairs: Vec<PositionPair> = rows.iter().flatten().map(|(row, theirs)| (*theirs, row.seen)).collect();
        let similarity = Alignment::similarity(&pairs);
        let offset = Some(Alignment::offset(&pairs)).filter(|offset| {
            ["px", UNKNOWN].contains(&track.unit.as_str())
                && SIMILAR * offset.median(&pairs) <= similarity.median(&pairs)
        });
        let alignment = Alignment { shift, ..offset.unwrap_or(similarity) };
        (alignment.median(&pairs), Matched { alignment, points, rows })
    }
}

impl Matched {
    /// The assignment of points to objects and the shift with the least distance.
    fn best(observed: &Observed, track: &ReferenceTrack) -> Result<Self> {
        let objects = observed.objects();
        ensure!(
            track.points.len() >= objects,
            "the track has {} points, the measurement {objects} objects",
            track.points.len()
        );
        let shifted = |shift: i64| assignments(objects, track.points.len()).into_iter().map(move |it| (it, shift));
        let candidates = (-SHIFTS..=SHIFTS).flat_map(shifted).map(|(points, shift)| {
            let of_object = |(object, point): (usize, &usize)| observed.beside(object, &track.points[*point], shift);
            let rows = points.iter().enumerate().map(of_object).collect();
            TrackAssignment { points, shift, rows }
        });
        let candidates: Vec<TrackAssignment> = candidates.collect();
        let most = candidates.iter().map(TrackAssignment::pairs).max().unwrap_or(0);
        ensure!(
            most >= LEAST_PAIRS,
            "the track and the measurement share {most} frames; {LEAST_PAIRS} are the least (do both count frames or seconds \
             from the beginning of the video?)"
        );
        let enough = candidates.into_iter().filter(|candidate| candidate.pairs() as f64 >= KEPT * most as f64);
        let aligned = enough.map(|candidate| candidate.aligned(track));
        let aligned: Vec<(f64, Matched)> = aligned.collect();
        // A shift must pay.
        let cost = |(distance, matched): &(f64, Matched)| {
            if matched.alignment.shift == 0 { (1.0 - SAVES) * distance } else { *distance }
        };
        let best = aligned.into_iter().min_by(|a, b| cost(a).total_cmp(&cost(b)));
        Ok(best.context("nothing to align")?.1)
    }

    /// Unit of the track; pixels where an offset alone aligns a track whose unit is not given.
    fn unit<'a>(&self, track: &'a ReferenceTrack) -> &'a str {
        if track.unit == UNKNOWN && self.alignment.is_offset() { "px" } else { &track.unit }
    }

    fn distances(&self, track: &ReferenceTrack, diameters: &[f64]) -> Vec<PointDistances> {
        let of_object = |(object, rows): (usize, &MatchedRows)| {
            let pairs: Vec<PositionPair> = rows.iter().map(|(row, theirs)| (*theirs, row.seen)).collect();
            let distances = self.alignment.distances(&pairs);
            let squares: f64 = distances.iter().map(|distance| distance * distance).sum();
            let middle = self.alignment.median(&pairs);
            PointDistances {
                name: track.points[self.points[object]].name.clone(),
                object: object + 1,
                frames: pairs.len(),
                median: middle,
                root_mean_square: (squares / pairs.len() as f64).sqrt(),
                largest: distances.iter().copied().fold(0.0, f64::max),
                of_diameter: diameters.get(object).map(|diameter| middle / diameter),
            }
        };
        self.rows.iter().enumerate().map(of_object).collect()
    }
}

/// All ways to give each of some objects a point of its own.
fn assignments(objects: usize, points: usize) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for _ in 0..objects {
        all = all
            .into_iter()
            .flat_map(|taken: Vec<usize>| {
                let free: Vec<usize> = (0..points).filter(|point| !taken.contains(point)).collect();
                free.into_iter().map(move |point| [&taken[..], &[point]].concat())
            })
            .collect();
    }
    all
}

/// The frames in which all objects have positions in both tracks, as recordings; none where there are too few.
fn scene(record: &SceneRecord, observed: &Observed, long: &[Vec<Row>]) -> Result<Option<RecordedSystem>> {
    let system = record.system.system(0.0, &Equations::default())?;
    let scale = Scale::new(&record.video, &system);
    let recording = |rows: &Vec<Row>| {
        let first = rows[0].seconds;
        Recording {
            name: observed.videos[rows[0].recording].clone(),
            first_seconds: first,
            times: rows.iter().map(|row| (row.seconds - first) / scale.seconds).collect(),
            numbers: rows.iter().map(|row| row.frame).collect(),
            trained: learned_from(rows.len()),
            teaches: true,
        }
    };
    let recordings: Vec<Recording> = long.iter().map(recording).collect();
    let Some(shortest) = recordings.iter().map(|recording| recording.trained).min() else { return Ok(None) };
    let (dt, record) = (system.dt, record.video.clone());
    Ok(Some(RecordedSystem { record, system, scale, dt, piece: piece_of(shortest), may_drift: false, recordings }))
}

impl Matched {
    /// Rows of the first object in those frames of a recording in which all objects have positions.
    fn shared(&self, recording: usize) -> Vec<Row> {
        let is_shared = |frame: u64| {
            self.rows.iter().all(|rows| rows.iter().any(|(row, _)| row.recording == recording && row.frame == frame))
        };
        let first = self.rows[0].iter().map(|(row, _)| *row);
        first.filter(|row| row.recording == recording && is_shared(row.frame)).collect()
    }

    /// The same of each recording with enough frames for a fit.
    fn long(&self, observed: &Observed) -> Vec<Vec<Row>> {
        let shared = (0..observed.videos.len()).map(|recording| self.shared(recording));
        shared.filter(|rows| rows.len() >= LEAST_FRAMES).collect()
    }

    /// Position of an object in a frame, pixels of the video.
    fn position(&self, object: usize, Row { recording, frame, .. }: &Row, theirs: bool) -> [f64; 2] {
        let found = self.rows[object].iter().find(|(row, _)| row.recording == *recording && row.frame == *frame);
        found.map_or([f64::NAN; 2], |(row, at)| if theirs { self.alignment.apply(*at) } else { row.seen })
    }
}

/// The equation fitted to the shared frames of one of the tracks.
fn fitted(scene: &RecordedSystem, matched: &Matched, long: &[Vec<Row>], theirs: bool) -> Result<Vec<Quantity>> {
    let objects = 0..matched.rows.len();
    let positions = long.iter().map(|rows| {
        let places =
            rows.iter().flat_map(|row| objects.clone().map(move |object| matched.position(object, row, theirs)));
        let pixels: Vec<f64> = places.flat_map(|place| scene.scale.in_frame(place)).collect();
        Positions::even(pixels.clone(), coordinates(&pixels, &scene.system))
    });
    let observation = Observation { by: String::new(), recordings: positions.collect() };
    let fits = scene.fits(&scene.system.cell, &[observation], &[])?;
    scene.quantities_alone(&fits.whole_tracks, &fits.whole, 0)
}

impl Observed {
    /// Positions of a point in the frames in which our track has the object, too.
    fn beside(&self, object: usize, point: &TrackedPoint, shift: i64) -> MatchedRows {
        let of_object = || self.rows.iter().filter(|row| row.object == object);
        let mut beside = MatchedRows::new();
        for position in &point.positions {
            let row = match (position.frame, position.seconds) {
                (Some(frame), _) => {
                    let wanted = frame as i64 + shift;
                    of_object().find(|row| row.frame as i64 == wanted)
                }
                (None, Some(seconds)) => {
                    let wanted = seconds + shift as f64 * self.interval;
                    let near =
                        of_object().min_by(|a, b| (a.seconds - wanted).abs().total_cmp(&(b.seconds - wanted).abs()));
                    near.filter(|row| (row.seconds - wanted).abs() <= 0.5 * self.interval)
                }
                (None, None) => None,
            };
            // One position a frame: the first.
            if let Some(row) = row
                && !beside.iter().any(|(other, _)| (other.recording, other.frame) == (row.recording, row.frame))
            {
                beside.push((*row, position.at));
            }
        }
        beside.sort_by_key(|(row, _)| (row.recording, row.frame));
        beside
    }
}
