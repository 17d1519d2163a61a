//! A folder of pictures, one a frame, in the natural order of their names: `f2.png` before `f10.png`.

use std::cmp::Ordering;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use image::{ImageReader, Limits, RgbImage};

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
    let size = reader(first)?.into_dimensions().with_context(|| format!("{first:?} is not a readable picture"))?;
    let frames = files.len();
    Ok((files, Facts { size, frames, times: None }))
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn reader(path: &Path) -> Result<ImageReader<std::io::BufReader<fs::File>>> {
    let mut reader = ImageReader::open(path)?.with_guessed_format()?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LARGEST_SIDE);
    limits.max_image_height = Some(LARGEST_SIDE);
    reader.limits(limits);
    Ok(reader)
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
        let picture =
            reader(path)?.decode().with_context(|| format!("{path:?} is not a readable picture"))?.into_rgb8();
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
    use super::natural_order;

    #[test]
    fn numbers_in_names_are_compared_as_numbers() {
        let mut names = ["f10.png", "f2.png", "f1.png", "f02b.png", "e300.png"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["e300.png", "f1.png", "f2.png", "f02b.png", "f10.png"]);
    }
}
