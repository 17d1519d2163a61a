//! Why a video cannot be read.

use std::io;
use std::result;

/// A result of this crate.
pub type Result<T> = result::Result<T, DecodeError>;

/// Why a video cannot be read. The messages name neither file nor folder: the caller knows it. Those of a picture and of a frame
/// leave the cause to [`std::error::Error::source`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// A FIFO, device, socket or a link to nothing, where a file is expected.
    #[error("expected a regular file, found {found}")]
    NotAFile {
        /// The kind of file that was found.
        found: &'static str,
    },
    /// A sound file of a kind that no decoder here reads.
    #[error("{what} is not decoded here; {remedy}")]
    Unsupported {
        /// Codec or container, and the tool of it that is missing.
        what: String,
        /// What the user can do about it.
        remedy: String,
    },
    /// Damage, or contradictory headers.
    #[error("{what}; is the file damaged?")]
    Corrupt {
        /// The contradiction.
        what: String,
    },
    /// Pictures that are no series of frames, or times that are not theirs.
    #[error("{what}")]
    NoSeries {
        /// What keeps them from being one.
        what: String,
    },
    /// A size beyond the limits, claimed by a header: nothing was allocated for it.
    #[error("{what}")]
    TooLarge {
        /// The size and its limit.
        what: String,
    },
    /// The operating system's refusal.
    #[error("cannot read it: {0}")]
    Io(#[from] io::Error),
    /// An error in one picture of a folder.
    #[error("{name}")]
    InFile {
        /// The picture's name.
        name: String,
        /// What failed in it.
        source: Box<DecodeError>,
    },
    /// An error at a known place of the video.
    #[error("frame {number}{}", at(*.seconds))]
    AtFrame {
        /// Display number, counted from 0.
        number: usize,
        /// Its presentation time, seconds since the first frame.
        seconds: Option<f64>,
        /// What failed there.
        source: Box<DecodeError>,
    },
}

impl DecodeError {
    /// Damage, by its description.
    pub(crate) fn no_series(what: impl Into<String>) -> Self {
        DecodeError::NoSeries { what: what.into() }
    }

    pub(crate) fn corrupt(what: impl Into<String>) -> Self {
        DecodeError::Corrupt { what: what.into() }
    }

    /// A missing decoder, by the codec's name, with the usual remedy.
    pub(crate) fn unsupported(what: impl Into<String>) -> Self {
        DecodeError::Unsupported { what: what.into(), remedy: CONVERT.into() }
    }

    /// A size beyond the limits.
    pub(crate) fn too_large(what: impl Into<String>) -> Self {
        DecodeError::TooLarge { what: what.into() }
    }

    /// An error at a frame. Refusals of the system stay as they are.
    pub(crate) fn at_frame(number: usize, seconds: Option<f64>, error: DecodeError) -> Self {
        match error {
            DecodeError::Io(_) | DecodeError::AtFrame { .. } => error,
            error => DecodeError::AtFrame { number, seconds, source: Box::new(error) },
        }
    }

    /// Whether ffmpeg may read what is not decoded here.
    pub(crate) fn is_unsupported(&self) -> bool {
        match self {
            DecodeError::Unsupported { .. } => true,
            DecodeError::AtFrame { source, .. } => source.is_unsupported(),
            _ => false,
        }
    }
}

fn at(seconds: Option<f64>) -> String {
    seconds.map_or(String::new(), |seconds| format!(" at {seconds:.3} s"))
}

/// The remedy for a codec without a decoder.
pub(crate) const CONVERT: &str = "install ffmpeg, or convert the video: ffmpeg -i VIDEO -pix_fmt yuv420p video.mp4";

/// Text from a file, safe for a terminal: control characters escaped, at most 200 characters.
pub(crate) fn printable(text: &str) -> String {
    let escaped = text.chars().flat_map(|c| {
        let escape = c.is_control();
        let (first, rest) = if escape { (None, Some(c.escape_default())) } else { (Some(c), None) };
        first.into_iter().chain(rest.into_iter().flatten())
    });
    escaped.take(200).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_do_not_reach_a_terminal() {
        assert_eq!(printable("caf\u{e9}\u{1b}[31m\n"), "caf\u{e9}\\u{1b}[31m\\n");
        assert_eq!(printable(&"x".repeat(999)).len(), 200);
    }
}
