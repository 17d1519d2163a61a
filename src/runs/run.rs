//! A run as its folder tells it, finished or not.

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::checkpoint::Store;
use super::course::Course;
use super::run_config::RunConfig;
use super::summary::Summary;
use crate::datasets::iterators::steps_per_epoch;
use crate::support::run_names::{CONFIG, METRICS};
use crate::support::storage;

/// One run folder.
#[derive(Debug)]
pub struct StoredRun {
    pub folder: PathBuf,
    pub config: RunConfig,
    /// None for a run that has not finished.
    pub summary: Option<Summary>,
    /// The course of the training, or why it cannot be read.
    pub course: Result<Course>,
    /// What the run learned from; of a run that has not finished, as others on the same files say.
    pub data: Option<RunData>,
}

/// The clips of a run's files, and how they were made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunData {
    /// Training, validation, test.
    pub clips: [usize; 3],
    /// None of files that were not generated here.
    pub made_with: Option<String>,
}

impl RunData {
    /// The seed of the generated files.
    pub fn seed(&self) -> Option<u64> {
        self.settings().find_map(seed)
    }

    /// How the files were made but for their seed: what is the same for all data sets of one kind.
    pub fn kind(&self) -> Option<String> {
        let kind = self.settings().filter(|part| seed(part).is_none()).collect::<Vec<_>>().join(SEPARATOR);
        self.made_with.as_ref().map(|_| kind)
    }

    fn settings(&self) -> impl Iterator<Item = &str> {
        self.made_with.as_deref().unwrap_or_default().split(SEPARATOR)
    }
}

/// What stands between the settings of a data set.
const SEPARATOR: &str = ", ";

fn seed(setting: &str) -> Option<u64> {
    setting.strip_prefix("seed ")?.parse().ok()
}

impl StoredRun {
    /// Reads a run folder.
    ///
    /// # Errors
    /// A config that is missing or damaged, a summary that is damaged or of another run than the config.
    pub fn read(folder: &Path) -> Result<Self> {
        let (config, summary) = (RunConfig::read(&folder.join(CONFIG))?, Summary::read(folder)?);
        if let Some(summary) = &summary {
            let of_config = (config.task.name.as_str(), config.recipe.as_str(), config.seed);
            let of_summary = (summary.task.as_str(), summary.recipe.as_str(), summary.seed);
            ensure!(
                of_config == of_summary,
                "config and summary are of different runs: task, recipe and seed are {of_config:?} and {of_summary:?}"
            );
        }
        let data = summary.as_ref().and_then(|summary| {
            let clips = [summary.training_clips?, summary.validation_clips?, summary.test.scores.clips];
            Some(RunData { clips, made_with: summary.test.made_with.clone() })
        });
        let course = Store::new(folder).check_recorded().and_then(|()| Course::read(folder));
        Ok(StoredRun { folder: folder.into(), config, summary, course, data })
    }

    /// The course, if it can be read.
    pub fn known_course(&self) -> Option<&Course> {
        self.course.as_ref().ok()
    }

    /// The course of the weights that a finished run has: without what `join` did after its best validation, where it ended
    /// with the weights of that.
    pub fn course_of_its_weights(&self) -> Option<Course> {
        let course = self.known_course()?;
        let ended_at_best = self.config.choices.get("join.end_at_best").is_some_and(|value| value == "true");
        Some(if ended_at_best && course.phase() == Some("join") { course.to_best() } else { course.clone() })
    }

    /// Steps until the end, or until the last record of a run that has not finished.
    pub fn steps(&self) -> Option<u64> {
        self.summary.as_ref().map(|summary| summary.steps).or_else(|| self.known_course().map(Course::steps))
    }

    /// Passes over the training clips that `join`'s batches make in these steps.
    pub fn epochs(&self) -> Option<f64> {
        let (clips, batch) = (self.data.as_ref()?.clips[0], self.config.number("join.batch")? as usize);
        Some(self.steps()? as f64 / steps_per_epoch(clips, batch) as f64)
    }

    /// `1750 steps`; of a recipe that counts epochs, `1750 steps (35 epochs)`.
    pub fn length(&self) -> String {
        let Some(steps) = self.steps() else { return "an unknown number of steps".into() };
        let in_epochs = self.config.choices.contains_key("join.epochs");
        match self.epochs().filter(|_| in_epochs) {
            Some(epochs) => format!("{steps} steps ({} epochs)", (10.0 * epochs).round() / 10.0),
            None => format!("{steps} steps"),
        }
    }

    /// The bytes of the config and of the course: the first tells runs apart, the second grows while a run goes on. Empty
    /// where they cannot be read.
    pub(super) fn config_and_course(&self) -> [Vec<u8>; 2] {
        [CONFIG, METRICS].map(|name| storage::read(&self.folder.join(name)).unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::RunData;

    #[test]
    fn data_sets_of_one_kind_differ_in_their_seed_alone() {
        let data = |text: &str| RunData { clips: [1, 1, 1], made_with: Some(text.into()) };
        let one = data("generator 1, task spring_color, seed 7, clips 10+10+500 of 30 frames, side 32");
        let other = data("generator 1, task spring_color, seed 8, clips 10+10+500 of 30 frames, side 32");
        assert_eq!((one.seed(), other.seed()), (Some(7), Some(8)));
        assert_eq!(one.kind(), other.kind());
        assert!(one.kind().is_some_and(|kind| kind.contains("task spring_color") && kind.contains("side 32")));
        assert_eq!(data("made by hand").seed(), None);
    }
}
