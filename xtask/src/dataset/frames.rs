//! Arrays of frames and times in an npz, as NIRPI has them: `imgs`, `[frames, height, width, 3]`, 0 to 1, and `ts`, seconds.

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ndarray_npy::NpzWriter;
use paig::datasets::npz::Archive;

const FRAMES: &str = "imgs";
const TIMES: &str = "ts";

/// The same frames as `paig measure` reads them, in `out`, with the rate among the options; any other video as it is.
pub(super) fn converted(path: &Path, name: &str, out: &Path, options: &mut toml::Table) -> Result<PathBuf> {
    if path.extension().is_none_or(|extension| extension != "npz") {
        return Ok(path.into());
    }
    let mut archive = Archive::open(path)?;
    let times = archive.floats(TIMES)?;
    let times: Vec<f64> = times.iter().map(|time| f64::from(*time)).collect();
    let frames = archive.floats(FRAMES)?;
    let (least, most) = frames.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), it| (a.min(*it), b.max(*it)));
    ensure!(
        least >= 0.0 && most <= 1.0,
        "array {FRAMES:?} of {path:?}: expected numbers from 0 to 1, found {least} to {most}"
    );
    options.insert("fps".into(), rate(&times).with_context(|| format!("array {TIMES:?} of {path:?}"))?.into());
    let converted = out.join(format!("{name}.npz"));
    let mut npz = NpzWriter::new_compressed(File::create(&converted)?);
    npz.add_array("frames", &frames.mapv(|it| (255.0 * it).round() as u8))?;
    npz.finish()?;
    Ok(converted)
}

/// Frames a second; the times must be even to a tenth of their step.
fn rate(times: &[f64]) -> Result<f64> {
    let (Some(first), Some(last)) = (times.first(), times.last()) else { anyhow::bail!("it has no times") };
    let step = (last - first) / (times.len() - 1) as f64;
    let even = times.windows(2).all(|pair| (pair[1] - pair[0] - step).abs() < 0.1 * step);
    ensure!(step > 0.0 && even, "expected times at even steps, found {times:?}");
    Ok(1.0 / step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array1, Array4};

    #[test]
    fn frames_become_bytes_and_times_a_rate() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("data_pendulum.npz");
        let mut npz = NpzWriter::new(File::create(&path).unwrap());
        npz.add_array(FRAMES, &Array4::from_shape_fn((3, 2, 2, 3), |(t, ..)| t as f64 / 2.0)).unwrap();
        npz.add_array(TIMES, &Array1::from_iter([0.0, 0.1, 0.2])).unwrap();
        npz.finish().unwrap();
        let mut options = toml::Table::new();
        let converted = converted(&path, "pendulum", folder.path(), &mut options).unwrap();
        let frames = Archive::open(&converted).unwrap().array::<u8>("frames", "uint8").unwrap();
        assert_eq!(frames.iter().step_by(12).copied().collect::<Vec<_>>(), [0, 128, 255]);
        assert!((options["fps"].as_float().unwrap() - 10.0).abs() < 1e-5);
    }

    #[test]
    fn uneven_times_are_refused() {
        assert!(format!("{:#}", rate(&[0.0, 0.1, 0.4]).unwrap_err()).contains("even steps"));
        assert!(rate(&[]).is_err());
        assert!(rate(&[0.0]).is_err());
    }
}
