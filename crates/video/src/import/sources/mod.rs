//! Frames of videos: films, gifs and folders of pictures by [`paig_decode`], arrays of npz. Each gives upright RGB frames with
//! square pixels in display order.

mod film;
mod filming;
mod npz;
mod rectified;

use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;
use paig_decode::{Note, VideoDecoder};
use paig_track::{Finding, StatedTime, TimeBase};

use self::film::FilmPass;
pub(super) use self::filming::check_slow_motion;
pub use self::filming::{Filming, ReferenceRectangle};
use self::rectified::{Rectification, Rectified};
use crate::calibration::Calibration;
use crate::import::names::{TASK, TRAIN};
use paig::support::random::Fnv1a;

pub use paig_decode::quiet_decoders;

// What claims more is refused before room is made for it.
pub use paig::tasks::video::{LARGEST_SIDE, MOST_FRAMES};

/// A video and what is known of it before a frame is decoded.
#[derive(Debug)]
pub struct SourceVideo {
    pub path: PathBuf,
    /// Of the upright frames, pixels.
    pub width: u32,
    pub height: u32,
    pub frames: usize,
    /// Of each frame, in seconds, from 0 on and ascending; none where the source knows no times.
    pub times: Option<Vec<f64>>,
    /// Frames a second by the file's own times, whatever `times` was set to.
    pub file_rate: Option<f64>,
    /// What the file states about time.
    pub clock: StatedTime,
    /// Remarks on the file, for people.
    pub remarks: Vec<String>,
    source: OpenedSource,
    /// How frames are rectified, if they are.
    rectification: Option<Rectification>,
}

#[derive(Debug)]
enum OpenedSource {
    Film(paig_decode::VideoFile),
    Array(npz::FrameArray),
}

/// Decodes the frames of one video.
pub trait FrameReader {
    /// The frame of this number, counted from 0 in display order. Numbers are asked for in ascending order; the same one
    /// may be asked for again.
    ///
    /// # Errors
    /// Damage; the message names the frame.
    fn frame(&mut self, number: usize) -> Result<RgbImage>;
}

/// Frames a second over all of these times; none of a single one.
fn mean_rate(times: &[f64]) -> Option<f64> {
    let [first, .., last] = times else { return None };
    Some((times.len() - 1) as f64 / (last - first)).filter(|rate| rate.is_finite())
}

/// Size, length and times of a source.
struct SourceFacts {
    size: (u32, u32),
    frames: usize,
    clock: StatedTime,
    remarks: Vec<String>,
}

impl SourceVideo {
    /// Reads what a video says of itself.
    ///
    /// # Errors
    /// No such file, an unknown kind of file, damage, sizes beyond the limits, a codec that nothing here decodes.
    pub fn open(path: &Path) -> Result<Self> {
        let read = || {
            ensure!(path.exists(), "there is no such file or folder");
            let imported = [TASK, TRAIN].iter().all(|name| path.join(name).exists());
            ensure!(!imported, "it is an imported task; give the video that it was imported from, or train it");
            let (source, facts) = source(path)?;
            let SourceFacts { size: (width, height), frames, clock, remarks } = facts;
            check_size(width, height)?;
            ensure!(frames > 0, "it has no frames");
            ensure!(frames <= MOST_FRAMES, "it has {frames} frames; at most {MOST_FRAMES} are read");
            let times = clock.times.clone();
            let file_rate = times.as_deref().and_then(mean_rate);
            let path = path.into();
            let rectification = None;
            Ok(SourceVideo { path, width, height, frames, times, file_rate, clock, remarks, source, rectification })
        };
        read().with_context(|| format!("video {}", path.display()))
    }

    /// Begins to decode.
    ///
    /// # Errors
    /// A file that cannot be opened any more.
    pub fn decode(&self) -> Result<Box<dyn FrameReader + '_>> {
        let frames: Box<dyn FrameReader + '_> = match &self.source {
            OpenedSource::Film(film) => Box::new(FilmPass::new(film, (self.width, self.height))),
            OpenedSource::Array(film) => Box::new(film),
        };
        Ok(match &self.rectification {
            Some(rectification) => Box::new(Rectified { frames, rectification }),
            None => frames,
        })
    }

    /// Checksum of the file, or of the names and bytes of a folder's pictures.
    ///
    /// # Errors
    /// A file that cannot be read any more.
    pub fn checksum(&self) -> Result<String> {
        let named = || format!("video {}", self.path.display());
        let mut files = vec![self.path.clone()];
        if self.path.is_dir() {
            let entries = std::fs::read_dir(&self.path).with_context(named)?;
            files = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>().with_context(named)?;
            files.retain(|path| paig_decode::is_picture(path) || path.ends_with(paig_decode::TIMES));
            files.sort();
        }
        let mut sum = Fnv1a::default();
        let mut buffer = vec![0; 1 << 16];
        for path in files {
            let mut file = paig_decode::open_regular(&path).with_context(named)?;
            sum.add(path.file_name().unwrap_or_default().as_encoded_bytes().iter().filter(|_| path != self.path));
            loop {
                let count = file.read(&mut buffer).with_context(named)?;
                if count == 0 {
                    break;
                }
                sum.add(&buffer[..count]);
            }
        }
        Ok(format!("{:016x}", sum.sum()))
    }

    /// The same with each frame of an interlaced video split into its two fields, which have times of their own.
    ///
    /// # Errors
    /// An array, whose frames are whole.
    pub fn in_fields(self) -> Result<Self> {
        let OpenedSource::Film(film) = self.source else {
            bail!("video {}: an array has whole frames, no fields", self.path.display())
        };
        let film = film.split_into_fields();
        let times = film.times().map(<[f64]>::to_vec);
        let clock = StatedTime { times: times.clone(), ..self.clock };
        Ok(SourceVideo { frames: film.info().frames, times, clock, source: OpenedSource::Film(film), ..self })
    }

    /// The same with the times at which the frames were filmed, and remarks on what that changes: where the video plays slower
    /// than it was filmed, by the camera's tags or by so many times as `slow_motion` says.
    #[must_use]
    pub fn timed(self, slow_motion: Option<f64>) -> Self {
        let TimeBase { times, findings, .. } = TimeBase::new(&self.clock, slow_motion);
        let concerns = |finding: &&Finding| {
            let rates =
                matches!(finding, Finding::SlowMotion { .. } | Finding::Impossible { .. } | Finding::TooFast { .. });
            rates || matches!(finding, Finding::Claimed { .. } | Finding::EditedSpeed { .. })
        };
        let lines = findings.iter().filter(concerns).map(Finding::line);
        let remarks = self.remarks.into_iter().chain(lines).collect();
        SourceVideo { times, remarks, ..self }
    }

    /// The same with so many frames a second instead of the times that the file states.
    #[must_use]
    pub fn at_rate(self, fps: f64) -> Self {
        let times: Vec<f64> = (0..self.frames).map(|frame| frame as f64 / fps).collect();
        let clock = StatedTime { times: Some(times.clone()), capture_rate: Some(fps), ..StatedTime::default() };
        SourceVideo { times: Some(times), clock, ..self }
    }

    /// The same with frames as a camera in front of the plane of the motion would film them.
    #[must_use]
    pub fn rectified(self, calibration: &Calibration) -> Self {
        let rectification = Rectification::new(calibration, (self.width, self.height));
        SourceVideo { rectification: Some(rectification), ..self }
    }

    /// By what the frames are rectified, if they are.
    pub(crate) fn calibration(&self) -> Option<&Calibration> {
        self.rectification.as_ref().map(|rectification| &rectification.calibration)
    }

    /// Whether a new decoder goes to the first frame it is asked for at once, or nearly so; else it decodes all before it.
    fn is_entered_anywhere(&self) -> bool {
        match &self.source {
            OpenedSource::Film(film) => film.info().decoder == VideoDecoder::BuiltIn && film.info().container != "gif",
            OpenedSource::Array(_) => true,
        }
    }

    /// The file's name, for people.
    pub fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or(self.path.as_os_str());
        name.to_string_lossy().into_owned()
    }
}

/// # Errors
/// A video that is given twice, also by another name: what one of them holds out, the other would fit.
pub(crate) fn ensure_each_once(videos: &[PathBuf]) -> Result<()> {
    let real = |path: &PathBuf| std::fs::canonicalize(path).with_context(|| format!("video {}", path.display()));
    let real = videos.iter().map(real).collect::<Result<Vec<_>>>()?;
    for (place, path) in videos.iter().enumerate() {
        ensure!(!real[..place].contains(&real[place]), "video {} is given twice; each counts once", path.display());
    }
    Ok(())
}

/// Decodes parts of videos, one after the other. Parts of one video that follow each other are decoded in one pass, unless a
/// new decoder gets to the next one sooner.
#[derive(Default)]
pub struct Passes<'a> {
    open: Option<(&'a SourceVideo, Box<dyn FrameReader + 'a>)>,
}

impl<'a> Passes<'a> {
    /// A decoder for the next part. Its frames come after all that the decoder before was asked for.
    ///
    /// # Errors
    /// As [`SourceVideo::decode`].
    pub fn of(&mut self, video: &'a SourceVideo) -> Result<&mut (dyn FrameReader + 'a)> {
        let goes_on = !video.is_entered_anywhere();
        let open = match self.open.take().filter(|(open, _)| goes_on && std::ptr::eq(*open, video)) {
            Some(open) => open,
            None => (video, video.decode()?),
        };
        Ok(self.open.insert(open).1.as_mut())
    }
}

fn source(path: &Path) -> Result<(OpenedSource, SourceFacts)> {
    let extension = path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_lowercase();
    match extension.as_str() {
        _ if path.is_dir() => film(path),
        "npz" => {
            let film = npz::FrameArray::read(path)?;
            let facts = film.facts();
            Ok((OpenedSource::Array(film), facts))
        }
        "png" | "jpg" | "jpeg" => bail!("it is a single picture; give the folder of all"),
        "npy" => bail!("save the array with numpy.savez as .npz"),
        _ => film(path),
    }
}

/// A film, a gif or a folder of pictures.
fn film(path: &Path) -> Result<(OpenedSource, SourceFacts)> {
    let film = paig_decode::VideoFile::open(path)?;
    let info = film.info();
    let size = film::square(info.size, info.pixel_aspect);
    let mut remarks: Vec<String> = info.notes.iter().filter_map(remark).collect();
    if size != info.size {
        let (width, height) = info.size;
        remarks.push(format!(
            "its pixels are {:.4} times as wide as high: {width} x {height} of them become {} x {} square ones",
            info.pixel_aspect, size.0, size.1
        ));
    }
    let clock = StatedTime {
        times: film.times().map(<[f64]>::to_vec),
        claimed_rate: info.claimed_rate,
        capture_rate: info.capture_rate,
        // Times begin with the first frame, pieces with the presentation.
        pieces: info.segments.iter().map(|piece| (piece.shown_from - info.start, piece.rate)).collect(),
    };
    let facts = SourceFacts { size, frames: info.frames, clock, remarks };
    Ok((OpenedSource::Film(film), facts))
}

/// What a note means for a measurement; none where frames and times are as they were filmed.
fn remark(note: &Note) -> Option<String> {
    match note {
        Note::EditRate(rate) => Some(format!("its edit list plays it {rate} times as fast as it was filmed")),
        Note::Cuts(pieces) => {
            Some(format!("its edit list shows {pieces} pieces one after the other: time jumps between them"))
        }
        Note::TimesOfDecoding => {
            Some("it has no times of display: its frames are taken to follow each other evenly".into())
        }
        Note::Ffmpeg(complaint) => Some(format!(
            "ffmpeg says {complaint:?}: it may be damaged or cut off; look at its last frames in the contact sheet"
        )),
        _ => None,
    }
}

fn check_size(width: u32, height: u32) -> Result<()> {
    let sound = |side| (1..=LARGEST_SIDE).contains(&side);
    ensure!(
        sound(width) && sound(height),
        "its frames have {width} x {height} pixels; expected 1 to {LARGEST_SIDE} a side"
    );
    Ok(())
}
