//! A folder of pictures, one a frame, in the natural order of their names: `f2.png` before `f10.png`. Each is turned as its
//! camera was, if the file says so (EXIF).

use std::cmp::Ordering;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use image::metadata::Orientation::{self, *};
use image::{DynamicImage, ImageDecoder, ImageReader, Limits, RgbImage};

use super::{Facts, Frames, LARGEST_SIDE};

/// The pictures of a folder. They have no times.
pub(super) fn list(folder: &Path) -> Result<(Vec<PathBuf>, Facts)> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).context("cannot read the folder")? {
        let path = entry?.path();
        let extension = path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_lowercase();
        if ["png", "jpg", "jpeg"].contains(&extension.as_str()) {
            files.push(path);
        }
    }
    files.sort_by(|a, b| natural_order(&name(a), &name(b)));
    let first = files.first().context("the folder holds no png or jpeg")?;
    let mut decoder = decoder(first)?;
    let (width, height) = decoder.dimensions();
    let size = match turn(&mut decoder) {
        Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH => (height, width),
        NoTransforms | Rotate180 | FlipHorizontal | FlipVertical => (width, height),
    };
    let frames = files.len();
    Ok((files, Facts { size, frames, times: None, complaint: None }))
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn decoder(path: &Path) -> Result<impl ImageDecoder + use<>> {
    let mut reader = ImageReader::open(path)?.with_guessed_format()?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    reader.limits(limits);
    reader.into_decoder().with_context(|| format!("{path:?} is not a readable picture"))
}

/// How a picture must be turned to stand upright; what is damaged in notes beside it turns nothing.
fn turn(decoder: &mut impl ImageDecoder) -> Orientation {
    decoder.orientation().unwrap_or(NoTransforms)
}

/// Runs of digits compare as numbers, all else as text.
fn natural_order(a: &str, b: &str) -> Ordering {
    let parts = |name: &str| -> Vec<(bool, String)> {
        let mut parts: Vec<(bool, String)> = Vec::new();
        for c in name.chars() {
            match parts.last_mut() {
                Some((digits, part)) if *digits == c.is_ascii_digit() => part.push(c),
                _ => parts.push((c.is_ascii_digit(), c.into())),
            }
        }
        parts
    };
    let number = |part: &str| part.trim_start_matches('0').to_string();
    let compared = |((a_digits, a), (b_digits, b)): (&(bool, String), &(bool, String))| match a_digits & b_digits {
        true => number(a).len().cmp(&number(b).len()).then_with(|| number(a).cmp(&number(b))),
        false => a.cmp(b),
    };
    let (of_a, of_b) = (parts(a), parts(b));
    let differing = of_a.iter().zip(&of_b).map(compared).find(|order| order.is_ne());
    differing.unwrap_or_else(|| of_a.len().cmp(&of_b.len())).then_with(|| a.cmp(b))
}

/// Reads the pictures as they are asked for.
pub(super) struct Pictures<'a> {
    files: &'a [PathBuf],
    size: (u32, u32),
}

impl<'a> Pictures<'a> {
    pub(super) fn new(files: &'a [PathBuf], size: (u32, u32)) -> Self {
        Pictures { files, size }
    }
}

impl Frames for Pictures<'_> {
    fn frame(&mut self, number: usize) -> Result<RgbImage> {
        let path = &self.files[number];
        let mut decoder = decoder(path)?;
        let turn = turn(&mut decoder);
        let mut picture =
            DynamicImage::from_decoder(decoder).with_context(|| format!("{path:?} is not a readable picture"))?;
        picture.apply_orientation(turn);
        let picture = picture.into_rgb8();
        let (found, expected) = (picture.dimensions(), self.size);
        ensure!(
            found == expected,
            "{path:?} has {} x {} pixels, the first picture {} x {}; all must have one size",
            found.0,
            found.1,
            expected.0,
            expected.1
        );
        Ok(picture)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;
    use image::{ImageEncoder, Rgb};

    /// A picture of 16 x 8 pixels, white in its left half, of a camera that was turned.
    #[test]
    fn pictures_of_a_turned_camera_stand_upright() {
        let folder = tempfile::tempdir().unwrap();
        let stored = RgbImage::from_fn(16, 8, |x, _| Rgb([if x < 8 { 255 } else { 0 }; 3]));
        // TIFF, most significant byte first, one entry: 0x112, a number of two bytes.
        let exif = |orientation: u8| {
            [&b"MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0"[..], &[orientation, 0, 0, 0, 0, 0, 0]].concat()
        };
        for (orientation, size, [x, y]) in [(1, (16, 8), [4, 4]), (3, (16, 8), [12, 4]), (6, (8, 16), [4, 4])] {
            let mut encoder = JpegEncoder::new(fs::File::create(folder.path().join("f0.jpg")).unwrap());
            encoder.set_exif_metadata(exif(orientation)).unwrap();
            encoder.encode_image(&stored).unwrap();
            let (files, facts) = list(folder.path()).unwrap();
            let upright = Pictures::new(&files, facts.size).frame(0).unwrap();
            assert_eq!((facts.size, upright.dimensions()), (size, size));
            let dark = [size.0 - 1 - x, size.1 - 1 - y];
            assert!(upright[(x, y)].0[0] > 200 && upright[dark.into()].0[0] < 50, "{orientation}");
        }
    }

    #[test]
    fn numbers_in_names_are_compared_as_numbers() {
        let mut names = ["f10.png", "f2.png", "f1.png", "f02b.png", "e300.png"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["e300.png", "f1.png", "f2.png", "f02b.png", "f10.png"]);
    }
}
