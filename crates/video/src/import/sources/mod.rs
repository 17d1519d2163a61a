//! Where frames come from: films, gifs, folders of pictures, arrays. Each gives upright RGB frames in display order.

mod colour;
mod container;
mod damage;
mod edits;
mod ffmpeg;
mod film;
mod gif;
mod h264;
mod npz;
mod pictures;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;

pub use damage::quiet_decoders;

/// Largest side of a frame, pixels, and most frames of a video. What claims more is refused before room is made for it.
pub const LARGEST_SIDE: u32 = 8192;
pub const MOST_FRAMES: usize = 2_000_000;

/// Part by which a pixel may be wider than high or less wide: a converter that rounds a small frame's sides to even numbers says
/// so of its pixels. Those of television are off by 7 % at least.
const SQUARE: f64 = 0.01;

/// A video and what is known of it before a frame is decoded.
#[derive(Debug)]
pub struct Video {
    pub path: PathBuf,
    /// Of the upright frames, pixels.
    pub width: u32,
    pub height: u32,
    pub frames: usize,
    /// Of each frame, in seconds, from 0 on and ascending; none where the source knows no times.
    pub times: Option<Vec<f64>>,
    /// What ffmpeg complains of, though it reads on.
    pub complaint: Option<String>,
    source: Source,
}

#[derive(Debug)]
enum Source {
    H264(container::Track),
    Ffmpeg,
    Gif,
    Pictures(Vec<PathBuf>),
    Array(npz::Film),
}

/// Decodes the frames of one video.
pub trait Frames {
    /// The frame of this number, counted from 0 in display order. Numbers are asked for in ascending order; the same one
    /// may be asked for again.
    ///
    /// # Errors
    /// Damage; the message names the frame.
    fn frame(&mut self, number: usize) -> Result<RgbImage>;
}

/// Size, length and times of a source.
struct Facts {
    size: (u32, u32),
    frames: usize,
    times: Option<Vec<f64>>,
    complaint: Option<String>,
}

impl Video {
    /// Reads what a video says of itself.
    ///
    /// # Errors
    /// No such file, an unknown kind of file, damage, sizes beyond the limits, a codec that nothing here decodes.
    pub fn open(path: &Path) -> Result<Self> {
        let read = || {
            ensure!(path.exists(), "there is no such file or folder");
            let (source, facts) = source(path)?;
            let Facts { size: (width, height), frames, times, complaint } = facts;
            check_size(width, height)?;
            ensure!(frames > 0, "it has no frames");
            ensure!(frames <= MOST_FRAMES, "it has {frames} frames; at most {MOST_FRAMES} are read");
            Ok(Video { path: path.into(), width, height, frames, times, complaint, source })
        };
        read().with_context(|| format!("video {}", path.display()))
    }

    /// Begins to decode.
    ///
    /// # Errors
    /// A file that cannot be opened any more.
    pub fn decode(&self) -> Result<Box<dyn Frames + '_>> {
        let path = self.path.as_path();
        Ok(match &self.source {
            Source::H264(track) => Box::new(film::Film::open(path, track)?),
            Source::Ffmpeg => Box::new(ffmpeg::Pipe::open(path, self.width, self.height)?),
            Source::Gif => Box::new(gif::Animation::open(path)?),
            Source::Pictures(files) => Box::new(pictures::Pictures::new(files, (self.width, self.height))),
            Source::Array(film) => Box::new(film),
        })
    }

    /// Whether a new decoder goes to the first frame it is asked for at once, or nearly so; else it decodes all before it.
    fn is_entered_anywhere(&self) -> bool {
        match &self.source {
            Source::H264(_) | Source::Pictures(_) | Source::Array(_) => true,
            Source::Ffmpeg | Source::Gif => false,
        }
    }

    /// The file's name, for people.
    pub fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or(self.path.as_os_str());
        name.to_string_lossy().into_owned()
    }
}

/// Decodes parts of videos, one after the other. Parts of one video that follow each other are decoded in one pass, unless a
/// new decoder gets to the next one sooner.
#[derive(Default)]
pub struct Passes<'a> {
    open: Option<(&'a Video, Box<dyn Frames + 'a>)>,
}

impl<'a> Passes<'a> {
    /// A decoder for the next part. Its frames come after all that the decoder before was asked for.
    ///
    /// # Errors
    /// As [`Video::decode`].
    pub fn of(&mut self, video: &'a Video) -> Result<&mut (dyn Frames + 'a)> {
        let goes_on = !video.is_entered_anywhere();
        let open = match self.open.take().filter(|(open, _)| goes_on && std::ptr::eq(*open, video)) {
            Some(open) => open,
            None => (video, video.decode()?),
        };
        Ok(self.open.insert(open).1.as_mut())
    }
}

fn source(path: &Path) -> Result<(Source, Facts)> {
    if path.is_dir() {
        let (files, facts) = pictures::list(path)?;
        return Ok((Source::Pictures(files), facts));
    }
    let extension = path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_lowercase();
    match extension.as_str() {
        "mp4" | "mov" | "m4v" | "qt" => mp4(path),
        "gif" => Ok((Source::Gif, gif::facts(path)?)),
        "npz" => {
            let film = npz::Film::read(path)?;
            let facts = film.facts();
            Ok((Source::Array(film), facts))
        }
        "png" | "jpg" | "jpeg" => bail!("it is a single picture; give the folder of all"),
        "npy" => bail!("save the array with numpy.savez as .npz"),
        _ if ffmpeg::is_there() => Ok((Source::Ffmpeg, ffmpeg::facts(path)?)),
        _ => bail!(
            "{extension:?} is read by ffmpeg only, which is not on the PATH; install it, or convert the video to mp4 \
             (H.264). Read without it: mp4, mov, gif, npz, folders of png or jpeg"
        ),
    }
}

/// H.264 is decoded here, anything else by ffmpeg.
fn mp4(path: &Path) -> Result<(Source, Facts)> {
    let mut track = container::Track::read(path)?;
    let tried = match &track.codec {
        container::Codec::H264(_) => film::try_first(path, &track)?,
        container::Codec::Other(name) => Err(format!("it is {name}")),
    };
    let why = match tried {
        Ok(coded) => {
            track.coded = coded;
            let times = track.times();
            let facts = Facts { size: track.size(), frames: times.len(), times: Some(times), complaint: None };
            return Ok((Source::H264(track), facts));
        }
        Err(why) => why,
    };
    ensure!(
        ffmpeg::is_there(),
        "{why}, which needs ffmpeg, and there is none on the PATH; install ffmpeg or convert the video to H.264 (8 bit, \
         4:2:0)"
    );
    Ok((Source::Ffmpeg, ffmpeg::facts(path)?))
}

fn check_size(width: u32, height: u32) -> Result<()> {
    let sound = |side| (1..=LARGEST_SIDE).contains(&side);
    ensure!(
        sound(width) && sound(height),
        "its frames have {width} x {height} pixels; expected 1 to {LARGEST_SIDE} a side"
    );
    Ok(())
}

/// Refuses pixels that are shown wider or higher than they are stored: `aspect` times as wide as high.
fn check_square(aspect: f64) -> Result<()> {
    ensure!(
        (aspect - 1.0).abs() <= SQUARE,
        "its pixels are not square: each is shown {aspect:.3} times as wide as high. Make them so: ffmpeg -i VIDEO -vf \
         scale=iw*sar:ih,setsar=1 square.mp4"
    );
    Ok(())
}
