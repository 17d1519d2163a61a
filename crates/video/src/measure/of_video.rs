//! The scene of videos that no model has seen: tracked at their own resolution.

use std::ops::Range;
use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use paig_track::{Hint, Options, Region};

use super::candidates::{self, Candidate, candidates, for_frames};
use super::native::{By, Tracked};
use super::pictures;
use super::recording::{Observation, Recording, Scene, learned_from};
use super::scale::Scale;
use super::{Named, Subject};
use crate::import::crop::Rectangle;
use crate::import::sources;
use crate::import::stated::Stated;
use crate::import::time_base::{Part, range};
use crate::import::tracker::TrackerFile;
use paig::network::cells::Equations;
use paig::network::system::SystemTable;
use paig::support::statistics::upper_median;
use paig::tasks::equation_file::EquationFile;
use paig::tasks::video::{Source, Video};

/// Side of the frame in whose pixels an equation is that does not say.
const SIDE: usize = 32;
/// Stands for the equation until one is chosen.
const UNTIL_CHOSEN: &str = "falling";
/// Fewest frames of a recording.
const LEAST_FRAMES: usize = 8;
/// Frames of the pieces with which a fit begins: this share of all, within these bounds.
const PIECE_SHARE: usize = 10;
const PIECES: Range<usize> = 12..48;

/// Videos to be measured, and how.
#[derive(Debug, Clone)]
pub struct VideoRequest {
    pub videos: Vec<PathBuf>,
    /// Parts of each video that show one motion from its beginning to its end.
    pub parts: Vec<Part>,
    /// Frames a second, in place of the video's own times.
    pub fps: Option<f64>,
    /// The frame to which starts and bounds of the equation refer, and at whose edges walls stand; the whole picture if not
    /// given.
    pub crop: Option<Rectangle>,
    /// See [`Video`].
    pub pixels_per_metre: Option<f64>,
    pub scale_percent: f64,
    pub time_percent: f64,
    pub origin: Option<[f64; 2]>,
    pub angle: f64,
    pub y_up: bool,
    /// As in an [import](crate::import::request::Request).
    pub scale_points: Option<[[f64; 2]; 2]>,
    pub tracker: Option<TrackerFile>,
    /// Chosen among those that come with the program where none is given.
    pub equation: Option<EquationFile>,
    pub objects: Option<usize>,
    /// Points on the objects, and regions in which nothing is looked for.
    pub hints: Vec<Hint>,
    pub ignore: Vec<Region>,
}

/// The equation of a measurement.
pub(super) enum Equation {
    Given(Named),
    OneOf(Vec<Candidate>),
}

/// One part of one video with its objects tracked.
struct Take {
    video: sources::Video,
    tracked: Tracked,
    numbers: Vec<usize>,
    /// Of these frames, from 0 on, seconds.
    seconds: Vec<f64>,
    first_seconds: f64,
}

impl VideoRequest {
    pub(super) fn subject(&self) -> Result<(Subject, Equation)> {
        ensure!(!self.videos.is_empty(), "no video given");
        let given = self.equation.clone();
        let file = given
            .clone()
            .unwrap_or_else(|| EquationFile { side: Some(candidates::SIDE), ..EquationFile::built_in(UNTIL_CHOSEN) });
        let objects = self.objects.or(file.objects).unwrap_or(1);
        let kind =
            file.equation.kind(objects, &Equations::default()).with_context(|| format!("equation {}", file.name))?;
        let objects = kind.objects.unwrap_or(objects);
        let (mut takes, mut doubtful) = (Vec::new(), Vec::new());
        for path in &self.videos {
            doubtful.extend(self.stated().check(&sources::Video::open(path)?)?);
            for part in &self.parts {
                takes.push(self.take(path, *part, objects)?);
            }
        }
        let first = &takes[0].video;
        let size = [first.width, first.height];
        for take in &takes[1..] {
            ensure!(
                [take.video.width, take.video.height] == size,
                "video {}: {} x {} pixels, where the first one has {} x {}; measure them apart",
                take.video.path.display(),
                take.video.width,
                take.video.height,
                size[0],
                size[1]
            );
        }
        let side = file.side.unwrap_or(SIDE);
        let intervals = takes.iter().flat_map(|take| take.seconds.windows(2).map(|pair| pair[1] - pair[0]));
        let interval = upper_median(intervals).context("a video needs more than one frame")?;
        let crop = match self.crop {
            Some(rectangle) => rectangle.squared(size[0], size[1])?,
            None => Rectangle { x: 0, y: 0, width: size[0], height: size[1] }.squared(size[0], size[1])?,
        };
        let trained = |take: &Take| learned_from(take.numbers.len());
        let source = |take: &Take| Source {
            file: take.video.path.display().to_string(),
            frames: [take.numbers[0], take.numbers[take.numbers.len() - 1] + 1],
            first_seconds: take.first_seconds,
            held_out_from: take.numbers[trained(take)],
        };
        let record = Video {
            size,
            crop: [crop.x, crop.y, i64::from(crop.side)],
            step: 1,
            film_step: Some(1),
            time_unit: "s".into(),
            frame_seconds: interval,
            pixels_per_metre: self.pixels_per_metre,
            scale_percent: self.scale_percent,
            time_percent: self.time_percent,
            origin: self.origin,
            angle: self.angle,
            y_up: self.y_up,
            sources: takes.iter().map(source).collect(),
        };
        let table = SystemTable {
            side,
            channels: 3,
            objects,
            input_steps: 4,
            pred_steps: 6,
            dt: interval,
            equation: for_frames(&file, side, interval),
            wall_margin: None,
        };
        let system = table.system(0.0, &Equations::default())?;
        let scale = Scale::new(&record, &system);
        let names = record.source_names();
        let recordings = takes.iter().zip(&names).map(|(take, name)| Recording {
            name: name.clone(),
            first_seconds: take.first_seconds,
            times: take.seconds.clone(),
            numbers: take.numbers.iter().map(|number| *number as u64).collect(),
            trained: trained(take),
            teaches: true,
        });
        let recordings: Vec<_> = recordings.collect();
        let shortest = recordings.iter().map(|recording| recording.trained).min().unwrap_or(0);
        let units = (&scale, &system);
        let observation = |by: By, text: &str| Observation {
            by: text.into(),
            recordings: takes.iter().map(|take| take.tracked.positions(&take.numbers, by, units)).collect(),
        };
        let observations = vec![
            observation(By::Template, "the tracker's templates at the video's resolution"),
            observation(By::Centroid, "centroids of what moves"),
        ];
        let doubts = takes.iter().filter_map(|take| take.tracked.doubt.clone()).collect();
        let of_takes = takes.iter().flat_map(|take| take.video.remarks.iter().chain(&take.tracked.notes).cloned());
        let notes = doubtful.into_iter().chain(of_takes).collect();
        let subject = Subject {
            task: names.join(", "),
            pictures: takes.into_iter().map(|take| pictures::Source::Filmed(Box::new(take.video))).collect(),
            observations,
            first_counts: true,
            may_be_cut: true,
            known: Vec::new(),
            notes,
            doubts,
            training_seconds: None,
            seed: 0,
            scene: Scene {
                record,
                dt: system.dt,
                system,
                scale,
                may_drift: false,
                piece: (shortest / PIECE_SHARE).clamp(PIECES.start, PIECES.end),
                recordings,
            },
        };
        let equation = match given {
            Some(_) => Equation::Given(Named { name: file.name, cell: subject.scene.system.cell.clone() }),
            None => Equation::OneOf(candidates(objects, interval, self.crop.is_some())),
        };
        Ok((subject, equation))
    }

    fn stated(&self) -> Stated {
        Stated {
            pixels_per_metre: self.pixels_per_metre,
            scale_percent: self.scale_percent,
            origin: self.origin,
            angle: self.angle,
            fps: self.fps,
            scale_points: self.scale_points,
            tracker: self.tracker,
        }
    }

    /// A part of a video, its objects tracked, cut to the frames between which all of them are seen.
    fn take(&self, path: &std::path::Path, part: Part, objects: usize) -> Result<Take> {
        let video = sources::Video::open(path)?;
        let named = || format!("video {}", path.display());
        let part = range(video.frames, video.times.as_deref(), self.fps, part).with_context(named)?;
        let options = Options {
            frames: Some(part),
            hints: self.hints.clone(),
            ignore: self.ignore.clone(),
            ..Options::default()
        };
        let tracked = Tracked::of(&video, &options, objects)?;
        let seen = tracked.range();
        ensure!(
            seen.len() >= LEAST_FRAMES,
            "video {}: all objects are seen in {} frames only; {LEAST_FRAMES} are the least",
            path.display(),
            seen.len()
        );
        let stamps: Vec<f64> = match (self.fps, &tracked.times) {
            (Some(fps), _) => seen.clone().map(|frame| frame as f64 / fps).collect(),
            (None, Some(times)) => times[seen.clone()].to_vec(),
            (None, None) => {
                bail!("video {}: no time stamps; say with --fps how many frames it has a second", path.display())
            }
        };
        let seconds: Vec<f64> = stamps.iter().map(|stamp| stamp - stamps[0]).collect();
        ensure!(
            seconds.windows(2).all(|pair| pair[1] > pair[0]),
            "video {}: its times do not ascend; say with --fps how many frames it has a second",
            path.display()
        );
        Ok(Take { video, tracked, numbers: seen.collect(), first_seconds: stamps[0], seconds })
    }
}
