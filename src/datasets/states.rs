//! True states of generated clips, kept beside a dataset for scoring only; nothing that learns reads them.
//!
//! `<stem>_states.npz` holds `train_pos`, `train_vel`, `valid_pos`, ... float32 `[clips, frames, coordinates]`, as drawn
//! in the frame of that index: x0, y0, x1, y1, ... in pixels and pixels per time unit; for a pendulum its angle and
//! angular velocity, in radians. `truth` (float64) are the values of the task's physical parameters, empty where the
//! clips follow another equation; `frames_checksum` (uint64 `[3]`) ties all to the frames they belong to, `settings`
//! (uint8, JSON) says how they were made.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ndarray::{Array1, Array3, Ix1, Ix3};

use super::files::{FrameIdentity, Split};
use super::npz;
use super::settings::Provenance;
use crate::network::System;
use crate::tasks::STATES_ENDING;

/// States of the clips of one split, `[clips, frames, coordinates]`: two coordinates for each object, or one angle.
#[derive(Debug, Clone, PartialEq)]
pub struct SplitStates {
    /// Pixels, or radians.
    pub positions: Array3<f32>,
    /// The same per time unit.
    pub velocities: Array3<f32>,
}

impl SplitStates {
    /// Refuses states by which no model of the system can be scored: a pendulum's angle, where an equation has x and y.
    ///
    /// # Errors
    /// Another number of coordinates than the system has.
    pub fn check(&self, system: &System) -> Result<()> {
        let expected = system.coordinates();
        [&self.positions, &self.velocities].into_iter().try_for_each(|states| {
            let found = states.dim().2;
            ensure!(
                found == expected,
                "coordinates in a frame: {found}, of the system: {expected}; move the file with the true states away, \
                 and runs are not scored by positions"
            );
            Ok(())
        })
    }
}

/// States of a whole dataset file.
#[derive(Debug, Clone, PartialEq)]
pub struct States {
    pub train: SplitStates,
    pub valid: SplitStates,
    pub test: SplitStates,
    /// Values of the task's true parameters, in their order; empty where the clips follow another equation. None in a
    /// file of an earlier version.
    pub truth: Option<Vec<f64>>,
    /// How the clips were made.
    pub settings: Provenance,
}

impl States {
    /// The states of one split.
    pub fn split(&self, split: Split) -> &SplitStates {
        match split {
            Split::Train => &self.train,
            Split::Valid => &self.valid,
            Split::Test => &self.test,
        }
    }

    /// Where the states of a dataset file are.
    pub fn path_beside(dataset: &Path) -> PathBuf {
        let stem = dataset.file_stem().unwrap_or_default().to_string_lossy();
        dataset.with_file_name(format!("{stem}{STATES_ENDING}"))
    }

    /// How the dataset file `dataset` was made, without reading any state. `None` where no states lie beside it.
    ///
    /// # Errors
    /// A damaged file.
    pub fn settings_beside(dataset: &Path) -> Result<Option<Provenance>> {
        let path = Self::path_beside(dataset);
        if !path.exists() {
            return Ok(None);
        }
        read_settings(&mut npz::Archive::open(&path)?, &path).map(Some)
    }

    /// Reads the states of the dataset file `dataset`, whose frames are `frames`. `None` where there are none, as
    /// beside the authors' files.
    ///
    /// # Errors
    /// A damaged file, or states of other frames (say, a dataset that was replaced and its states were not).
    pub fn read(dataset: &Path, frames: &impl FrameIdentity) -> Result<Option<Self>> {
        let path = Self::path_beside(dataset);
        if !path.exists() {
            return Ok(None);
        }
        let mut archive = npz::Archive::open(&path)?;
        let checksums = archive.array::<u64>("frames_checksum", "uint64")?;
        ensure!(
            checksums.iter().eq(&frames.checksums()),
            "the true states in {path:?} belong to other frames than those in {dataset:?}; \
             delete {path:?}, or make both again with `paig generate --force`"
        );
        let settings = read_settings(&mut archive, &path)?;
        let truth = archive.has("truth").then(|| archive.array::<f64>("truth", "float64")).transpose()?;
        let truth = truth.map(|values| values.into_iter().collect());
        let mut read = |split: Split| {
            let [clips, length] = frames.lengths(split);
            let mut array = |quantity: &str| {
                let name = format!("{}_{quantity}", split.name());
                let array = archive.array::<f32>(&name, "float32")?;
                let fits = array.ndim() == 3 && array.shape()[..2] == [clips, length];
                ensure!(
                    fits,
                    "array {name:?} of {path:?} has shape {:?}, expected [{clips}, {length}, coordinates]; \
                     make it again with `paig generate --force`",
                    array.shape()
                );
                Ok(array.into_dimensionality::<Ix3>()?)
            };
            Ok::<_, anyhow::Error>(SplitStates { positions: array("pos")?, velocities: array("vel")? })
        };
        let (train, valid, test) = (read(Split::Train)?, read(Split::Valid)?, read(Split::Test)?);
        Ok(Some(Self { train, valid, test, truth, settings }))
    }

    /// Writes the states beside the dataset file `dataset` with frames `frames`.
    ///
    /// # Errors
    /// No space, no permission.
    pub fn write(&self, dataset: &Path, frames: &impl FrameIdentity) -> Result<()> {
        npz::write(&Self::path_beside(dataset), |npz| {
            for split in Split::ALL {
                let states = self.split(split);
                npz.add_array(format!("{}_pos", split.name()), &states.positions)?;
                npz.add_array(format!("{}_vel", split.name()), &states.velocities)?;
            }
            if let Some(truth) = &self.truth {
                npz.add_array("truth", &Array1::from_iter(truth.iter().copied()))?;
            }
            npz.add_array("frames_checksum", &Array1::from_iter(frames.checksums()))?;
            npz.add_array("settings", &Array1::from_iter(self.settings.to_file().bytes()))?;
            Ok(())
        })
    }
}

fn read_settings(archive: &mut npz::Archive, path: &Path) -> Result<Provenance> {
    let text = archive.array::<u8>("settings", "uint8")?.into_dimensionality::<Ix1>()?;
    let text = String::from_utf8(text.to_vec()).map_err(anyhow::Error::from);
    text.and_then(|text| Provenance::parse(&text)).with_context(|| format!("settings in {path:?}"))
}
