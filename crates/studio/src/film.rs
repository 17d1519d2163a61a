//! Motion JPEG in AVI: videos that are made here.
//!
//! The smallest form of the container: one stream, one list of frames, one index (Microsoft, AVI RIFF File Reference).

use anyhow::{Context, Result};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

/// Of the pictures, per cent.
const QUALITY: u8 = 92;
/// The file has an index; each frame can be decoded by itself.
const HAS_INDEX: u32 = 0x10;
const KEY_FRAME: u32 = 0x10;

/// A video of pictures of one size.
pub struct RenderedVideo {
    size: (u32, u32),
    fps: u32,
    frames: Vec<Vec<u8>>,
}

impl RenderedVideo {
    pub fn new(size: (u32, u32), fps: u32) -> Self {
        RenderedVideo { size, fps, frames: Vec::new() }
    }

    /// # Errors
    /// A picture that cannot be compressed.
    pub fn add(&mut self, picture: &RgbImage) -> Result<()> {
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(picture).context("cannot compress a frame")?;
        self.frames.push(bytes);
        Ok(())
    }

    /// The file.
    pub fn bytes(&self) -> Vec<u8> {
        let mut movie = b"movi".to_vec();
        let mut index = Vec::new();
        for frame in &self.frames {
            let place = movie.len() as u32;
            index.extend(b"00dc");
            index.extend(numbers(&[KEY_FRAME, place, frame.len() as u32]));
            movie.extend(chunk(b"00dc", frame));
        }
        let header = [b"hdrl".to_vec(), chunk(b"avih", &self.main_header()), self.stream()].concat();
        let body = [b"AVI ".to_vec(), chunk(b"LIST", &header), chunk(b"LIST", &movie), chunk(b"idx1", &index)];
        chunk(b"RIFF", &body.concat())
    }

    fn main_header(&self) -> Vec<u8> {
        let ((width, height), frames) = (self.size, self.frames.len() as u32);
        numbers(&[1_000_000 / self.fps, 0, 0, HAS_INDEX, frames, 0, 1, self.largest(), width, height, 0, 0, 0, 0])
    }

    fn stream(&self) -> Vec<u8> {
        let (width, height) = self.size;
        let mut header = b"vidsMJPG".to_vec();
        header.extend(numbers(&[0, 0, 0, 1, self.fps, 0, self.frames.len() as u32, self.largest(), u32::MAX, 0, 0, 0]));
        let mut format = numbers(&[40, width, height, 1 | 24 << 16]);
        format.extend(b"MJPG");
        format.extend(numbers(&[3 * width * height, 0, 0, 0, 0]));
        chunk(b"LIST", &[b"strl".to_vec(), chunk(b"strh", &header), chunk(b"strf", &format)].concat())
    }

    fn largest(&self) -> u32 {
        self.frames.iter().map(Vec::len).max().unwrap_or(0) as u32
    }
}

fn numbers(numbers: &[u32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Name, length, content, filled to an even length.
fn chunk(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let mut bytes = name.to_vec();
    bytes.extend(numbers(&[content.len() as u32]));
    bytes.extend(content);
    if content.len() % 2 == 1 {
        bytes.push(0);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use image::Rgb;
    use paig_video::import::sources::SourceVideo;

    use super::*;

    #[test]
    fn a_film_is_read_back() {
        let mut film = RenderedVideo::new((64, 48), 30);
        for number in 0..5 {
            film.add(&RgbImage::from_pixel(64, 48, Rgb([40 * number, 90, 200]))).unwrap();
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.avi");
        std::fs::write(&path, film.bytes()).unwrap();
        let video = SourceVideo::open(&path).unwrap();
        assert_eq!((video.width, video.height, video.frames), (64, 48, 5));
        let times = video.times.clone().unwrap();
        assert!((times[4] - 4.0 / 30.0).abs() < 1e-4, "{times:?}");
        let frame = video.decode().unwrap().frame(3).unwrap();
        // JPEG's rounding.
        let pixel = frame.get_pixel(30, 20).0;
        assert!(pixel.iter().zip([120, 90, 200]).all(|(a, b)| a.abs_diff(b) < 6), "{pixel:?}");
    }
}
