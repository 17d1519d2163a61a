//! Pictures that users name: PNG, JPEG, GIF.

use std::io::{Cursor, Write};
use std::path::Path;

use anyhow::{Context, Result};
use crc::{CRC_32_ISO_HDLC, Crc};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, RgbImage};

use super::{atomic, storage};

/// Bytes of a PNG before its second chunk: the signature and the header.
const HEAD: usize = 8 + 25;
/// Type of a chunk with text, and its keyword.
const TEXT: &[u8] = b"tEXt";
const KEYWORD: &[u8] = b"Title\0";

/// Reads a picture file.
///
/// # Errors
/// No such file, a folder, a pipe, a device, no readable picture; the message names the file.
pub fn read(path: &Path) -> Result<DynamicImage> {
    let read = || Ok::<_, anyhow::Error>(image::load_from_memory(&storage::read(path)?)?);
    read().with_context(|| format!("cannot read the picture {}", path.display()))
}

/// Writes a PNG with a title, by which the program recognizes it.
///
/// # Errors
/// A full disk, a missing folder.
pub fn write_titled(path: &Path, picture: &RgbImage, title: &str) -> Result<()> {
    let mut png = Cursor::new(Vec::new());
    picture.write_with_encoder(PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::Adaptive))?;
    let png = png.into_inner();
    let (head, rest) = png.split_at(HEAD);
    let text = [TEXT, KEYWORD, title.as_bytes()].concat();
    let checksum = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&text);
    let length = (text.len() - TEXT.len()) as u32;
    atomic::write_file(path, |file| {
        for part in [head, &length.to_be_bytes(), &text, &checksum.to_be_bytes(), rest] {
            file.write_all(part)?;
        }
        Ok(())
    })
}

/// Whether bytes are a PNG that [`write_titled`] wrote with this title.
pub fn has_title(png: &[u8], title: &str) -> bool {
    let Some(text) = png.get(HEAD..).and_then(|rest| rest.get(4..)) else { return false };
    let expected = [TEXT, KEYWORD, title.as_bytes()].concat();
    let length = png[HEAD..HEAD + 4] == ((expected.len() - TEXT.len()) as u32).to_be_bytes();
    length && text.starts_with(&expected)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_titled_picture_is_recognized_and_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let picture = RgbImage::from_fn(7, 5, |x, y| image::Rgb([x as u8, y as u8, 200]));
        write_titled(&path, &picture, "paig: paths").unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(has_title(&bytes, "paig: paths") && !has_title(&bytes, "paig: path"));
        assert!(!has_title(&bytes[..HEAD + 2], "paig: paths"));
        assert_eq!(read(&path).unwrap().into_rgb8(), picture);
    }
}
