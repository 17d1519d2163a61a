//! Frames side by side in one picture, pixel for pixel, to be read again.

use std::path::Path;

use anyhow::{Result, ensure};
use tch::{Kind, Tensor};

use super::canvas::{Canvas, pictures};
use crate::support::error::Error;
use crate::support::picture_file;

/// Writes frames `[frames, C, S, S]` in \[0, 1\] side by side, each of their pixels one pixel of 8 bits.
///
/// # Errors
/// A file that cannot be written, frames with neither 1 nor 3 channels.
pub fn write_strip(path: &Path, frames: &Tensor) -> Result<(), Error> {
    let pictures = pictures(frames, 1)?;
    let side = frames.size()[2] as u32;
    let mut canvas = Canvas::new(side * pictures.len() as u32, side);
    for (place, picture) in (0..).zip(&pictures) {
        canvas.paste(picture, (place * side, 0));
    }
    Ok(canvas.write_png(path)?)
}

/// Reads such a picture: `[frames, 3, S, S]` in \[0, 1\].
///
/// # Errors
/// A file that is no picture, or whose sides say that it holds another number of frames.
pub fn read_strip(path: &Path, frames: usize) -> Result<Tensor> {
    let picture = picture_file::read(path)?.to_rgb8();
    let (width, side) = picture.dimensions();
    ensure!(
        u64::from(width) == u64::from(side) * frames as u64,
        "{}: {width} x {side} pixels are not {frames} frames side by side",
        path.display()
    );
    let shape = [i64::from(side), frames as i64, i64::from(side), 3];
    let values = Tensor::from_slice(picture.as_raw()).reshape(shape).permute([1, 3, 0, 2]);
    Ok(values.to_kind(Kind::Float) / 255.0)
}

#[cfg(test)]
mod tests {
    use tch::{Device, Kind, Tensor};

    use super::{read_strip, write_strip};

    #[test]
    fn a_strip_holds_every_pixel() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("strip.png");
        let levels = Tensor::randint(256, [4, 3, 8, 8], (Kind::Float, Device::Cpu));
        write_strip(&path, &(&levels / 255.0)).unwrap();
        let read = read_strip(&path, 4).unwrap();
        assert!((read * 255.0).round().equal(&levels));
        let error = read_strip(&path, 3).unwrap_err().to_string();
        assert!(error.contains("32 x 8 pixels are not 3 frames"), "{error}");
    }
}
