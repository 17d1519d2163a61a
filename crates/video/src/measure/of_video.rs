//! The scene of videos that no model has seen: tracked at their own resolution.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use anyhow::{Context, Result, bail, ensure};
use paig_track::{Hint, Region, TrackingOptions};

use super::candidates::{self, EquationCandidate, candidates, for_frames};
use super::native::{PositionSource, TrackedVideo};
use super::pictures;
use super::proposals::Proposal;
use super::recording::{Observation, RecordedSystem, Recording, learned_from};
use super::scale::Scale;
use super::{ComparedEquation, Subject};
use crate::import::crop::CropRectangle;
use crate::import::each_once;
use crate::import::sources::{self, Filming};
use crate::import::stated::Stated;
use crate::import::time_base::{VideoPart, range};
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
pub(super) const LEAST_FRAMES: usize = 8;
/// Frames of the pieces with which a fit begins: this share of all, within these bounds.
const PIECE_SHARE: usize = 10;
const PIECES: Range<usize> = 12..48;

/// Videos to be measured, and how.
#[derive(Debug, Clone)]
pub struct VideoRequest {
    pub videos: Vec<PathBuf>,
    /// Parts of each video that show one motion from its beginning to its end.
    pub parts: Vec<VideoPart>,
    pub filming: Filming,
    /// The frame to which starts and bounds of the equation refer, and at whose edges walls stand; the whole picture if not
    /// given.
    pub crop: Option<CropRectangle>,
    /// See [`Video`].
    pub pixels_per_metre: Option<f64>,
    pub scale_percent: f64,
    pub time_percent: f64,
    pub origin: Option<[f64; 2]>,
    pub angle: f64,
    pub y_up: bool,
    /// As in an [import](crate::import::request::ImportRequest).
    pub scale_points: Option<[[f64; 2]; 2]>,
    pub tracker: Option<TrackerFile>,
    /// Chosen among those that come with the program where none is given.
    pub equation: Option<EquationFile>,
    pub objects: Option<usize>,
    /// Points on the objects, and regions in which nothing is looked for.
    pub hints: Vec<Hint>,
    pub ignore: Vec<Region>,
    /// Whether each part is measured alone, too, and the scatter of the parts counts.
    pub takes: bool,
}

/// The equation of a measurement.
pub(super) enum EquationChoice {
    Given(ComparedEquation),
    OneOf(Vec<EquationCandidate>),
}

/// A part of a video with its objects tracked.
pub(super) struct TrackedPart {
    video: Rc<sources::SourceVideo>,
    tracked: Rc<TrackedVideo>,
    options: TrackingOptions,
    /// Whether a person named the part.
    named: bool,
    /// Parts in which the objects move freely; none where a person named the part.
    free: Vec<Proposal>,
}

/// Parts of the films that are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MeasuredParts {
    /// Those in which the objects move freely.
    Free,
    /// Everything that was asked for.
    Whole,
}

/// One part of one video with its objects tracked.
struct TrackedTake {
    video: Rc<sources::SourceVideo>,
    tracked: Rc<TrackedVideo>,
    numbers: Vec<usize>,
    /// Of these frames, from 0 on, seconds.
    seconds: Vec<f64>,
    first_seconds: f64,
}

/// The points that are named in these frames.
fn hints_in(hints: &[Hint], frames: &Range<usize>) -> Vec<Hint> {
    hints.iter().filter(|hint| frames.contains(&hint.frame)).copied().collect()
}

/// Frames of the pieces with which a fit to recordings begins, the shortest of which has so many frames to learn from.
pub(super) fn piece_of(shortest: usize) -> usize {
    (shortest / PIECE_SHARE).clamp(PIECES.start, PIECES.end)
}

impl VideoRequest {
    /// The equation, or what stands for it until one is chosen, and the number of objects.
    fn system(&self) -> Result<(EquationFile, usize)> {
        let until_chosen = || EquationFile { side: Some(candidates::SIDE), ..EquationFile::built_in(UNTIL_CHOSEN) };
        let file = self.equation.clone().unwrap_or_else(until_chosen);
        let objects = self.objects.or(file.objects).unwrap_or(1);
        let kind =
            file.equation.kind(objects, &Equations::default()).with_context(|| format!("equation {}", file.name))?;
        let objects = kind.objects.unwrap_or(objects);
        Ok((file, objects))
    }

    /// All parts of all videos, tracked.
    pub(super) fn films(&self) -> Result<Vec<TrackedPart>> {
        ensure!(!self.videos.is_empty(), "no video given");
        let (_, objects) = self.system()?;
        let each = self.videos.iter().flat_map(|path| self.parts.iter().map(move |part| self.opened(path, *part)));
        let opened = each.collect::<Result<Vec<_>>>()?;
        sources::ensure_each_once(&self.videos)?;
        for Hint { frame, .. } in &self.hints {
            let parts = opened.iter().map(|(_, part)| format!("{}..{}", part.start, part.end));
            ensure!(
                opened.iter().any(|(_, part)| part.contains(frame)),
                "--at {frame}:..: frames {} are tracked; name one of them",
                parts.collect::<Vec<_>>().join(", ")
            );
        }
        opened
            .into_iter()
            .zip(self.parts.iter().cycle())
            .map(|((video, part), of)| self.film(video, part, *of, objects))
            .collect()
    }

    pub(super) fn subject(&self, films: &[TrackedPart], parts: MeasuredParts) -> Result<(Subject, EquationChoice)> {
        let (file, objects) = self.system()?;
        let (mut takes, mut proposed, mut doubtful) = (Vec::new(), Vec::new(), Vec::new());
        for of_one in films.chunk_by(|one, next| one.video.path == next.video.path) {
            doubtful.extend(self.stated().check(&of_one[0].video)?);
            for film in of_one {
                takes.extend(film.takes(parts, &mut proposed)?);
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
            None => CropRectangle { x: 0, y: 0, width: size[0], height: size[1] }.squared(size[0], size[1])?,
        };
        let calibration = self.filming.calibration(first)?;
        let trained = |take: &TrackedTake| learned_from(take.numbers.len());
        let source = |take: &TrackedTake| Source {
            file: take.video.path.display().to_string(),
            frames: [take.numbers[0], take.numbers[take.numbers.len() - 1] + 1],
            first_seconds: take.first_seconds,
            held_out_from: take.numbers[trained(take)],
            checksum: String::new(),
        };
        let record = Video {
            size,
            crop: [crop.x, crop.y, i64::from(crop.side)],
            step: 1,
            film_step: Some(1),
            time_unit: "s".into(),
            frame_seconds: interval,
            pixels_per_metre: calibration.map(|plane| plane.pixels_per_metre).or(self.pixels_per_metre),
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
        let observation = |by: PositionSource, text: &str| Observation {
            by: text.into(),
            recordings: takes.iter().map(|take| take.tracked.positions(&take.numbers, by, units)).collect(),
        };
        let observations = vec![
            observation(PositionSource::Template, "the tracker's templates at the video's resolution"),
            observation(PositionSource::Centroid, "centroids of what moves"),
        ];
        let tracked = || takes.chunk_by(|a, b| Rc::ptr_eq(&a.tracked, &b.tracked)).map(|of_one| &of_one[0]);
        let doubts = tracked().flat_map(|take| take.tracked.doubts.iter().cloned()).collect();
        let notes = tracked().flat_map(|take| take.video.remarks.iter().chain(&take.tracked.notes).cloned());
        let diameters = takes[0].tracked.tracks.iter().map(|track| track.diameter).collect();
        let notes = each_once(doubtful.into_iter().chain(notes).chain(proposed).collect());
        let subject = Subject {
            task: names.join(", "),
            pictures: takes.into_iter().map(|take| pictures::PictureSource::Filmed(take.video)).collect(),
            observations,
            first_counts: true,
            may_be_cut: true,
            known: Vec::new(),
            diameters,
            notes,
            doubts,
            takes: Vec::new(),
            other_parts: Vec::new(),
            training_seconds: None,
            seed: 0,
            scene: RecordedSystem {
                record,
                dt: system.dt,
                system,
                scale,
                may_drift: false,
                piece: piece_of(shortest),
                recordings,
            },
        };
        let equation = match self.equation {
            Some(_) => {
                EquationChoice::Given(ComparedEquation { name: file.name, cell: subject.scene.system.cell.clone() })
            }
            None => EquationChoice::OneOf(candidates(objects, interval, self.crop.is_some())),
        };
        Ok((subject, equation))
    }

    fn stated(&self) -> Stated {
        Stated {
            pixels_per_metre: self.pixels_per_metre,
            scale_percent: self.scale_percent,
            time_percent: self.time_percent,
            origin: self.origin,
            angle: self.angle,
            fps: self.filming.fps,
            scale_points: self.scale_points,
            tracker: self.tracker,
        }
    }

    /// A video and the frames of its part.
    fn opened(&self, path: &Path, part: VideoPart) -> Result<(sources::SourceVideo, Range<usize>)> {
        let video = self.filming.open(path)?;
        let part = range(video.frames, video.times.as_deref(), None, part);
        let part = part.with_context(|| format!("video {}", path.display()))?;
        Ok((video, part))
    }

    /// A part of a video with its objects tracked.
    fn film(
        &self,
        video: sources::SourceVideo,
        frames: Range<usize>,
        part: VideoPart,
        objects: usize,
    ) -> Result<TrackedPart> {
        let calibration = self.filming.calibration(&video)?;
        let options = TrackingOptions {
            hints: hints_in(&self.hints, &frames),
            frames: Some(frames),
            ignore: self.ignore.clone(),
            slow_motion: self.filming.slow_motion,
            readout: self.filming.readout,
            ..TrackingOptions::default()
        };
        let video = calibration.iter().fold(video, sources::SourceVideo::rectified);
        let tracked = TrackedVideo::of(&video, &options, objects)?;
        Ok(TrackedPart::new(Rc::new(video), tracked, options, part != VideoPart::All))
    }
}

impl TrackedPart {
    fn new(video: Rc<sources::SourceVideo>, tracked: TrackedVideo, options: TrackingOptions, named: bool) -> Self {
        let free = if named { Vec::new() } else { tracked.proposals(LEAST_FRAMES) };
        TrackedPart { video, tracked: Rc::new(tracked), options, named, free }
    }

    /// The longest part in which the objects move freely, tracked again by itself: an object that rests elsewhere in the video, and is
    /// taken for background there, is not in this one's. None of a video that is one part.
    pub(super) fn longest_alone(&self) -> Option<(Self, String)> {
        let TrackedPart { video, tracked, options, .. } = self;
        let Proposal { frames, reason } = self.free.iter().max_by_key(|part| part.frames.len())?;
        let all = options.frames.as_ref().map_or(video.frames, Range::len);
        let hints = hints_in(&options.hints, frames);
        let alone = TrackingOptions { frames: Some(frames.clone()), hints, ..options.clone() };
        let tracked = (frames.len() < all).then(|| TrackedVideo::of(video, &alone, tracked.tracks.len()).ok())??;
        let Range { start, end } = *frames;
        let note = format!(
            "{}: frames {start}..{end} are taken and tracked by themselves, {reason} (--frames chooses a part)",
            video.name()
        );
        Some((Self::new(video.clone(), tracked, alone, true), note))
    }

    /// The other movers in place of the object, the likeliest first, each with a line that says so. None of several objects.
    pub(super) fn others(&self) -> Vec<(Self, String)> {
        let TrackedPart { video, tracked, options, named, .. } = self;
        if tracked.tracks.len() > 1 {
            return Vec::new();
        }
        let part = |tracked: TrackedVideo| {
            let Range { start, end } = tracked.range(None);
            let note = format!(
                "{}: the largest mover does not follow the equation; another one, in frames {start}..{end}, does and is measured \
                 (--at names the object, --ignore a rectangle)",
                video.name()
            );
            (Self::new(video.clone(), tracked, options.clone(), *named), note)
        };
        // Errors of a lower threshold are none of the video's.
        tracked.others(video, options).unwrap_or_default().into_iter().map(part).collect()
    }

    /// Whether the objects move freely in a part of it only.
    pub(super) fn has_parts(&self) -> bool {
        let whole = self.tracked.range(None);
        self.free.iter().any(|part| part.frames.start > whole.start || part.frames.end < whole.end)
    }

    /// Parts cut to the frames between which all objects are seen, with a line on each in `proposed`.
    fn takes(&self, parts: MeasuredParts, proposed: &mut Vec<String>) -> Result<Vec<TrackedTake>> {
        let mut takes = Vec::new();
        for Proposal { frames, reason } in self.free.iter().filter(|_| parts == MeasuredParts::Free) {
            let Ok(take) = self.take(Some(frames)) else { continue };
            let (first, last) = (take.numbers[0], take.numbers[take.numbers.len() - 1]);
            if take.numbers.len() < self.video.frames {
                let name = self.video.name();
                proposed.push(format!(
                    "{name}: frames {first}..{} are taken, {reason} (--frames chooses a part)",
                    last + 1
                ));
            }
            takes.push(take);
        }
        if takes.is_empty() {
            takes.push(self.take(None)?);
        }
        Ok(takes)
    }

    fn take(&self, among: Option<&Range<usize>>) -> Result<TrackedTake> {
        let TrackedPart { video, tracked, .. } = self;
        let path = &video.path;
        let seen = tracked.range(among);
        ensure!(
            seen.len() >= LEAST_FRAMES,
            "video {}: all objects are seen in {} frames only; {LEAST_FRAMES} are the least",
            path.display(),
            seen.len()
        );
        let Some(times) = &tracked.times else {
            bail!("video {}: no time stamps; say with --fps how many frames it has a second", path.display())
        };
        let stamps = times[seen.clone()].to_vec();
        let seconds: Vec<f64> = stamps.iter().map(|stamp| stamp - stamps[0]).collect();
        ensure!(
            seconds.windows(2).all(|pair| pair[1] > pair[0]),
            "video {}: its times do not ascend; say with --fps how many frames it has a second",
            path.display()
        );
        let (video, tracked) = (video.clone(), tracked.clone());
        Ok(TrackedTake { video, tracked, numbers: seen.collect(), first_seconds: stamps[0], seconds })
    }
}
