//! Animated gifs.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::sync::Arc;

use image::codecs::gif::GifDecoder;
use image::{AnimationDecoder, ImageDecoder, Limits};

use crate::bytes::Bytes;
use crate::error::{DecodeError, Result};
use crate::flat::over_black;
use crate::frame::{Frame, Presentation};
use crate::limits::{LARGEST_DESCRIPTION, LARGEST_SIDE, check_frames, check_size};
use crate::picture::DecodedPicture;
use crate::stream::Sink;

/// First letters of a gif.
pub(crate) const SIGNATURE: &[u8] = b"GIF8";
/// Bytes of the header, and of an image's descriptor.
const HEADER: usize = 13;
const DESCRIPTOR: usize = 9;

/// Size and times of a gif, without decoding it. Without delays it has no times.
pub(crate) struct Outline {
    pub size: (u32, u32),
    pub frames: usize,
    pub times: Option<Vec<f64>>,
}

impl Outline {
    /// # Errors
    /// Damage, sizes beyond the limits.
    pub(crate) fn read(file: &mut BufReader<File>) -> Result<Self> {
        let length = file.get_ref().metadata()?.len();
        if length > LARGEST_DESCRIPTION {
            return Err(DecodeError::too_large(format!(
                "it is a gif of {length} bytes; at most {LARGEST_DESCRIPTION} are read"
            )));
        }
        file.rewind()?;
        let mut gif = Vec::new();
        file.take(length).read_to_end(&mut gif)?;
        let mut bytes = Bytes(&gif);
        let header = bytes.take(HEADER)?;
        let side = |at: usize| u32::from(u16::from_le_bytes([header[at], header[at + 1]]));
        let size = (side(6), side(8));
        check_size(size.0, size.1)?;
        skip_colours(&mut bytes, header[10])?;
        // Hundredths of a second.
        let (mut time, mut delay, mut times) = (0u64, 0, Vec::new());
        loop {
            match bytes.u8()? {
                0x21 => {
                    let is_control = bytes.u8()? == 0xf9;
                    if let (true, [_, _, low, high, ..]) = (is_control, bytes.0) {
                        delay = u16::from_le_bytes([*low, *high]);
                    }
                    skip_blocks(&mut bytes)?;
                }
                0x2c => {
                    let descriptor = bytes.take(DESCRIPTOR)?;
                    skip_colours(&mut bytes, descriptor[8])?;
                    bytes.u8()?;
                    skip_blocks(&mut bytes)?;
                    times.push(time as f64 / 100.0);
                    time += u64::from(std::mem::take(&mut delay));
                    check_frames(times.len())?;
                }
                0x3b => break,
                _ => return Err(DecodeError::corrupt("a block of the gif is damaged")),
            }
        }
        if times.is_empty() {
            return Err(DecodeError::corrupt("it has no frames"));
        }
        let is_timed = time > 0 || times.len() == 1;
        Ok(Outline { size, frames: times.len(), times: is_timed.then_some(times) })
    }
}

/// Skips a table of colours, if its flags say that there is one.
fn skip_colours(bytes: &mut Bytes, flags: u8) -> Result<()> {
    if flags & 0x80 != 0 {
        bytes.take(3 << ((flags & 7) + 1))?;
    }
    Ok(())
}

fn skip_blocks(bytes: &mut Bytes) -> Result<()> {
    loop {
        match bytes.u8()? {
            0 => return Ok(()),
            size => bytes.take(size.into())?,
        };
    }
}

/// Decodes the frames from a number on; those before are decoded, too.
///
/// # Errors
/// Damage, with the frame at which it was found.
pub(crate) fn decode(
    file: BufReader<File>,
    times: Option<&[f64]>,
    display: &Arc<Presentation>,
    from: usize,
    sink: &Sink,
) -> Result<()> {
    let damaged = |error: image::ImageError| DecodeError::corrupt(crate::error::printable(&error.to_string()));
    let mut decoder = GifDecoder::new(file).map_err(damaged)?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    decoder.set_limits(limits).map_err(damaged)?;
    for (number, frame) in decoder.into_frames().enumerate() {
        let seconds = times.and_then(|times| times.get(number).copied());
        let frame = frame.map_err(damaged).map_err(|error| DecodeError::at_frame(number, seconds, error))?;
        let picture = DecodedPicture::Rgb(over_black(&frame.into_buffer()));
        if number >= from && !sink.send(Frame { number, seconds, picture, display: display.clone(), field: None }) {
            break;
        }
    }
    Ok(())
}
