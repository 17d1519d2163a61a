//! Facts of a video known before its first frame is decoded.

use std::sync::Arc;

use crate::colour::{Colour, Converter, Tags};
use crate::error::Result;
use crate::frame::Presentation;
use crate::timeline::EditSegment;
use crate::upright::Orientation;

/// Facts of a video known before its first frame is decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Info {
    /// Name of the container: `mp4`, `matroska`, `avi`, `gif`, `pictures`, or ffmpeg's name.
    pub container: String,
    /// Name of the codec, for people: `H.264`, `HEVC`, ..
    pub codec: String,
    /// What decodes it.
    pub decoder: VideoDecoder,
    /// Width and height of the upright frames, pixels as stored.
    pub size: (u32, u32),
    /// Shown width of a pixel of an upright frame over its height: 1 for square pixels.
    pub pixel_aspect: f64,
    /// How stored frames are turned to stand upright. The frames of this crate already are.
    pub orientation: Orientation,
    /// Bits of a stored sample.
    pub depth: u8,
    /// Colour tags, and the defaults where there are none.
    pub colour: Colour,
    /// Frames that are shown, from the container's index.
    pub frames: usize,
    /// Presentation time of the first frame, seconds from the start of the presentation.
    pub start: f64,
    /// Frame rate that a header claims, frames a second. The time stamps may differ from it.
    pub claimed_rate: Option<f64>,
    /// Frame rate at which the camera recorded, where a tag states it and the container plays it at another.
    pub capture_rate: Option<f64>,
    /// Fields of a frame, where the video is marked as interlaced.
    pub interlaced: Option<Fields>,
    /// Segments of the edit list; empty where there is none.
    pub segments: Vec<EditSegment>,
    /// Tags of the camera, name and value: `com.android.capture.fps`, `com.apple.quicktime.model`, ..
    pub tags: Vec<(String, String)>,
    /// Contradictions that do not stop decoding, but that a user should know.
    pub notes: Vec<Note>,
}

impl Info {
    /// Facts of frames that are decoded to upright RGB, and how they are shown.
    pub(crate) fn of_rgb(
        container: &str,
        codec: &str,
        size: (u32, u32),
        frames: usize,
    ) -> Result<(Self, Arc<Presentation>)> {
        let (orientation, colour) = (Orientation::UPRIGHT, Colour::of(Tags::default(), true)?);
        let info = Info {
            container: container.into(),
            codec: codec.into(),
            decoder: VideoDecoder::BuiltIn,
            size,
            pixel_aspect: 1.0,
            orientation,
            depth: 8,
            colour,
            frames,
            start: 0.0,
            claimed_rate: None,
            capture_rate: None,
            interlaced: None,
            segments: Vec::new(),
            tags: Vec::new(),
            notes: Vec::new(),
        };
        Ok((info, Arc::new(Presentation { orientation, converter: Converter::new(&colour, 8) })))
    }
}

/// What decodes a video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VideoDecoder {
    /// A decoder built into this crate.
    BuiltIn,
    /// The program ffmpeg.
    Ffmpeg,
}

/// Order of the two fields of an interlaced frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fields {
    /// Even lines were recorded first.
    TopFirst,
    /// Odd lines were recorded first.
    BottomFirst,
    /// The order is not stated.
    Unknown,
}

/// A contradiction that does not stop decoding.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Note {
    /// The edit list plays the recording this many times as fast as it was recorded.
    EditRate(f64),
    /// The edit list shows this many pieces of the recording, one after the other: time jumps between them.
    Cuts(usize),
    /// The container stores times of decoding only; frames are put into display order by the codec's own count.
    TimesOfDecoding,
    /// High dynamic range, tone-mapped to the range of ordinary screens.
    ToneMapped,
    /// A complaint of ffmpeg, which read on.
    Ffmpeg(String),
}
