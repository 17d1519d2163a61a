//! A measurement with all that its files are made of.

use std::io::Write;
use std::path::Path;

use anyhow::Result;

use super::explain::Explained;
use super::measured::MeasuredSubject;
use super::pictures;
use super::recording::{Observation, RecordedSystem};
use super::results::{EXTENDED, MEASUREMENT, Measurement, Outcome};
use super::{overlay, page, positions_file};
use paig::support::atomic;
use paig::support::output::FileSet;

/// What [`EXTENDED`] holds where no term is missing.
const NOTHING_MISSING: &str = "# The equation lacks none of the terms that were tried.\n";

/// The files of a measurement. The numbers come last: they show whose the others are.
pub(super) const FILES: FileSet = FileSet {
    name: "a measurement",
    files: &[positions_file::FILE, "overlay.gif", page::POSITIONS, page::PAGE, EXTENDED, MEASUREMENT],
    recognizes: Measurement::is_in,
};

/// A measured subject.
pub(super) struct Finished {
    pub measurement: Measurement,
    pub scene: RecordedSystem,
    /// The observation whose fit is quoted.
    pub observation: Observation,
    pub explained: Explained,
    pub pictures: Vec<pictures::PictureSource>,
}

impl Finished {
    pub(super) fn outcome(&self) -> Outcome {
        self.measurement.verdict.as_ref().map_or(Outcome::NotFound, |verdict| verdict.outcome)
    }

    /// Writes the files of a measurement as a whole set.
    pub(super) fn write(self, out: &Path) -> Result<Measurement> {
        let pictures = self.pictures.iter().zip(&self.scene.recordings);
        let pictures =
            pictures.map(|(source, recording)| source.pictures(recording, &self.scene.scale)).collect::<Result<_>>()?;
        let pixels = self.observation.recordings.iter().map(|positions| positions.pixels.as_slice()).collect();
        let (measurement, scene, explained) = (&self.measurement, &self.scene, &self.explained);
        let measured = MeasuredSubject { measurement, scene, pixels, explained, pictures };
        FILES.replace(out, |out| {
            positions_file::write(&out.join(positions_file::FILE), &measured)?;
            overlay::write(&out.join("overlay.gif"), &measured)?;
            page::write(out, &measured)?;
            atomic::write_file(&out.join(EXTENDED), |file| {
                let equation = measurement.missing.as_ref().and_then(|missing| missing.equation.as_deref());
                Ok(file.write_all(equation.unwrap_or(NOTHING_MISSING).as_bytes())?)
            })?;
            measurement.write(out)
        })?;
        Ok(self.measurement)
    }
}
