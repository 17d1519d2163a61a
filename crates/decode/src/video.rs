//! A video file.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::codec::{self, StreamFacts};
use crate::colour::{Colour, Converter, Transfer};
use crate::container::{self, Setup, Stamps, VideoTrack};
use crate::error::{DecodeError, Result};
use crate::extracted::Extracted;
use crate::fields::{self, Parity};
use crate::frame::Presentation;
use crate::guard::guarded;
use crate::index::Index;
use crate::info::{Fields, Info, Note, VideoDecoder};
use crate::open::open_regular;
use crate::picture::DecodedPicture;
use crate::stream::Frames;
use crate::{ffmpeg, gif, pictures, track_frames};

/// A video file whose index was read.
pub struct VideoFile {
    path: PathBuf,
    info: Info,
    times: Option<Vec<f64>>,
    source: DecodedSource,
    display: Arc<Presentation>,
    /// Order of the fields, where frames are split into them.
    fields: Option<[Parity; 2]>,
    /// Folder of what was extracted from an archive; removed with the video.
    extracted: Option<Arc<Extracted>>,
}

impl std::fmt::Debug for VideoFile {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_struct("Video").field("path", &self.path).field("info", &self.info).finish_non_exhaustive()
    }
}

enum DecodedSource {
    Track(Arc<Index>),
    Gif,
    Pictures(Vec<PathBuf>),
    Ffmpeg,
}

impl VideoFile {
    /// Reads the index of a video file, or lists a folder of pictures, and decodes the first frame.
    ///
    /// # Errors
    /// See [`DecodeError`]: no regular file, a codec that neither this crate nor an ffmpeg on the PATH decodes, damage, sizes beyond
    /// [`crate::limits`].
    pub fn open(path: &Path) -> Result<Self> {
        match VideoFile::open_built_in(path) {
            Err(error) if error.is_unsupported() && ffmpeg::is_there() => VideoFile::open_ffmpeg(path),
            other => other,
        }
    }

    /// The same without ffmpeg.
    ///
    /// # Errors
    /// As for [`VideoFile::open`].
    pub fn open_built_in(path: &Path) -> Result<Self> {
        if path.is_dir() {
            return VideoFile::of_pictures(path);
        }
        if Extracted::is_archive(path) {
            let extracted = Extracted::open(path)?;
            let video = VideoFile::open(extracted.video())?;
            return Ok(VideoFile { path: path.into(), extracted: Some(Arc::new(extracted)), ..video });
        }
        let mut file = BufReader::new(open_regular(path)?);
        match container::read(&mut file)? {
            Some(track) => VideoFile::of_track(path, track, &mut file),
            None if first_bytes(&mut file)?.starts_with(gif::SIGNATURE) => VideoFile::of_gif(path, &mut file),
            None => Err(unknown(&first_bytes(&mut file)?)),
        }
    }

    /// Facts of the video.
    pub fn info(&self) -> &Info {
        &self.info
    }

    /// Presentation times of all frames in display order, seconds since the first; none where the source has no times.
    pub fn times(&self) -> Option<&[f64]> {
        self.times.as_deref()
    }

    /// The path that was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// All frames in display order, decoded ahead on a thread of their own.
    ///
    /// # Errors
    /// A file that cannot be opened any more.
    pub fn frames(&self) -> Result<Frames> {
        self.frames_from(0)
    }

    /// The frames from a display number on. Decoding begins with the last frame before it that depends on no other, where the
    /// decoder is built in.
    ///
    /// # Errors
    /// As for [`VideoFile::frames`].
    pub fn frames_from(&self, number: usize) -> Result<Frames> {
        match self.fields {
            Some(order) => Ok(self.whole_from(number / 2)?.in_fields(order, self.times.clone(), number)),
            None => self.whole_from(number),
        }
    }

    /// Splits each frame into its two fields, which have times of their own: an interlaced camera records twice as many
    /// pictures of half as many lines. Missing lines are the mean of their neighbours.
    #[must_use]
    pub fn split_into_fields(self) -> Self {
        let order = Parity::in_order(self.info.interlaced.unwrap_or(Fields::Unknown));
        let times = self.times.as_deref().map(fields::times);
        let info = Info { frames: 2 * self.info.frames, ..self.info };
        VideoFile { info, times, fields: Some(order), ..self }
    }

    fn whole_from(&self, number: usize) -> Result<Frames> {
        let (width, height) = self.info.size;
        let bytes = width as usize * height as usize * 3;
        let display = self.display.clone();
        match &self.source {
            DecodedSource::Track(index) => {
                let (index, file) = (index.clone(), BufReader::new(open_regular(self.file())?));
                Frames::decode(bytes, move |sink| track_frames::decode(&index, file, &display, number, sink))
            }
            DecodedSource::Gif => {
                let (file, times) = (BufReader::new(open_regular(self.file())?), self.frame_times());
                Frames::decode(bytes, move |sink| gif::decode(file, times.as_deref(), &display, number, sink))
            }
            DecodedSource::Pictures(files) => {
                let (files, size, times) = (files.clone(), self.info.size, self.frame_times());
                Frames::decode(bytes, move |sink| {
                    pictures::decode(&files, size, times.as_deref(), &display, number, sink)
                })
            }
            DecodedSource::Ffmpeg => {
                open_regular(self.file())?;
                let path = self.file().to_path_buf();
                let (times, size) = (self.frame_times().unwrap_or_default(), self.info.size);
                Frames::decode(bytes, move |sink| ffmpeg::decode(&path, size, &times, &display, number, sink))
            }
        }
    }

    /// The file that is decoded.
    fn file(&self) -> &Path {
        self.extracted.as_ref().map_or(&self.path, |extracted| extracted.video())
    }

    /// Times of the frames before they are split.
    fn frame_times(&self) -> Option<Vec<f64>> {
        let every = if self.fields.is_some() { 2 } else { 1 };
        self.times.as_ref().map(|times| times.iter().step_by(every).copied().collect())
    }

    fn of_track(path: &Path, track: VideoTrack, file: &mut BufReader<File>) -> Result<Self> {
        let index = Index::new(track, file)?;
        let (first, facts) = guarded("its first frame", || track_frames::probe(&index, file))?;
        let Index { track, times, start, .. } = &index;
        let is_jpeg = track.setup == Setup::Mjpeg;
        let colour = Colour::of(facts.colour.or(track.colour), is_jpeg)?;
        let StreamFacts { depth, pixel_aspect, interlaced, .. } = facts;
        let mut notes = track.notes.clone();
        if track.stamps == Stamps::Decoding {
            notes.push(Note::TimesOfDecoding);
        }
        if colour.transfer != Transfer::Standard {
            notes.push(Note::ToneMapped);
        }
        let orientation = track.geometry.orientation;
        let stored_aspect = track.geometry.pixel_aspect.or(pixel_aspect).unwrap_or(1.0);
        let info = Info {
            container: track.container.into(),
            codec: codec::name(&track.setup).into(),
            decoder: VideoDecoder::BuiltIn,
            size: orientation.size(first.size()),
            pixel_aspect: if orientation.swaps_sides() { 1.0 / stored_aspect } else { stored_aspect },
            orientation,
            depth,
            colour,
            frames: times.len(),
            start: *start,
            claimed_rate: track.claimed_rate,
            capture_rate: track.capture_rate,
            interlaced: track.interlaced.or(interlaced),
            segments: track.timeline.segments.clone(),
            tags: track.tags.clone(),
            notes,
        };
        let depth = match first {
            DecodedPicture::Yuv(_) => depth,
            DecodedPicture::Rgb(_) => 8,
        };
        let display = Arc::new(Presentation { orientation, converter: Converter::new(&colour, depth) });
        let times = Some(times.clone());
        Ok(VideoFile {
            path: path.into(),
            info,
            times,
            source: DecodedSource::Track(Arc::new(index)),
            display,
            fields: None,
            extracted: None,
        })
    }

    /// The same by ffmpeg, whatever the codec: for a video that turns out to be beyond the built-in decoder within.
    ///
    /// # Errors
    /// As for [`VideoFile::open`]; no ffmpeg on the PATH.
    pub fn open_ffmpeg(path: &Path) -> Result<Self> {
        open_regular(path)?;
        let (mut info, times, display) = ffmpeg::list(path)?;
        // What the container states of it is known all the same.
        if let Ok(Some(track)) = container::read(&mut BufReader::new(open_regular(path)?)) {
            info.container = track.container.into();
            info.codec = codec::name(&track.setup).into();
            info.interlaced = track.interlaced;
            info.claimed_rate = track.claimed_rate;
            info.capture_rate = track.capture_rate;
            info.segments = track.timeline.segments;
            info.tags = track.tags;
            info.notes.extend(track.notes);
        }
        Ok(VideoFile {
            path: path.into(),
            info,
            times: Some(times),
            source: DecodedSource::Ffmpeg,
            display,
            fields: None,
            extracted: None,
        })
    }

    fn of_gif(path: &Path, file: &mut BufReader<File>) -> Result<Self> {
        let gif::Outline { size, frames, times } = gif::Outline::read(file)?;
        let (info, display) = Info::of_rgb("gif", "GIF", size, frames)?;
        Ok(VideoFile {
            path: path.into(),
            info,
            times,
            source: DecodedSource::Gif,
            display,
            fields: None,
            extracted: None,
        })
    }

    fn of_pictures(path: &Path) -> Result<Self> {
        let (files, size) = pictures::list(path)?;
        let times = pictures::times(path, &files)?;
        let (info, display) = Info::of_rgb("pictures", "PNG or JPEG", size, files.len())?;
        Ok(VideoFile {
            path: path.into(),
            info,
            times,
            source: DecodedSource::Pictures(files),
            display,
            fields: None,
            extracted: None,
        })
    }
}

fn first_bytes(file: &mut BufReader<File>) -> Result<Vec<u8>> {
    file.rewind()?;
    let mut first = Vec::new();
    file.take(8).read_to_end(&mut first)?;
    Ok(first)
}

/// What a file is whose container is not read here, by its first bytes.
fn unknown(first: &[u8]) -> DecodeError {
    let what = match first {
        [0x89, b'P', b'N', b'G', ..] | [0xff, 0xd8, 0xff, ..] => {
            let remedy = "give the folder of all pictures".into();
            return DecodeError::Unsupported { what: "a single picture".into(), remedy };
        }
        [b'O', b'g', b'g', b'S', ..] => "Ogg",
        [0x30, 0x26, 0xb2, 0x75, ..] => "Windows Media",
        [b'F', b'L', b'V', ..] => "Flash",
        [0, 0, 1, 0xba | 0xb3, ..] => "MPEG",
        _ => "a container of an unknown kind",
    };
    DecodeError::unsupported(what)
}
