//! Video files to upright frames with their own presentation time stamps.
//!
//! ```no_run
//! let video = paig_decode::VideoFile::open("pendulum.mp4".as_ref())?;
//! println!("{} frames of {:?}, {}", video.info().frames, video.info().size, video.info().codec);
//! for frame in video.frames()? {
//!     let frame = frame?;
//!     println!("frame {} at {:?} s: {:?}", frame.number(), frame.seconds(), frame.rgb().get_pixel(0, 0));
//! }
//! # Ok::<(), paig_decode::DecodeError>(())
//! ```
//!
//! H.264, HEVC, VP9, AV1 and Motion JPEG in mp4, mov, Matroska, WebM and AVI, gifs and folders of pictures are decoded by this
//! crate, anything else by the program ffmpeg, if it is on the PATH. Decoding runs ahead on a thread of its own; its memory is bounded.

mod bits;
mod bytes;
mod codec;
mod colour;
mod container;
mod error;
mod exif;
mod extracted;
mod ffmpeg;
mod fields;
mod flat;
mod frame;
mod gif;
mod guard;
mod index;
mod info;
pub mod limits;
mod open;
mod picture;
mod pictures;
mod stream;
mod timeline;
mod track_frames;
mod upright;
mod video;

pub use colour::{Colour, Matrix, Transfer};
pub use error::{DecodeError, Result};
pub use frame::Frame;
pub use guard::quiet_decoders;
pub use info::{Fields, Info, Note, VideoDecoder};
pub use open::open_regular;
pub use pictures::{TIMES, is_picture};
pub use stream::Frames;
pub use timeline::EditSegment;
pub use upright::Orientation;
pub use video::VideoFile;
