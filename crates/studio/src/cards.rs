//! Projects in a line each: picture, equation, value, verdict.

use paig::support::significant::significant;
use paig_video::measure::results::{Measurement, Outcome};
use serde::Serialize;

use crate::equations::equation;
use crate::jobs::{ProcessStatus, ProjectJob};
use crate::preview::ProjectPreview;
use crate::project::Project;
use crate::settings::ProjectSettings;

/// Digits of a value.
pub const DIGITS: i32 = 4;

/// A project, for the list of all.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Card {
    pub name: String,
    pub title: String,
    pub created: u64,
    pub equation: Option<String>,
    /// Frame whose small picture stands for the video.
    pub picture: Option<usize>,
    /// The first quantity of the latest finished measurement with its interval.
    pub value: Option<String>,
    pub outcome: Option<Outcome>,
    pub running: bool,
}

impl Card {
    /// None of a project that cannot be read.
    pub fn of(project: &Project) -> Option<Self> {
        let (record, settings) = (project.record().ok()?, project.settings().ok()?);
        let preview = ProjectPreview::read(&project.preview_folder());
        let picture = preview.facts.map(|facts| {
            let made = preview.made.pictures.min(facts.shown).max(1) - 1;
            made / 2 / facts.strip_step * facts.strip_step
        });
        let latest = project.measurements().last().map(|number| project.measurement_folder(*number));
        let training = project.trainings().last().map(|number| project.training_folder(*number));
        // One that was stopped hides no earlier result.
        let folders = project.measurements().into_iter().rev().map(|number| project.measurement_folder(number));
        let measurement = folders.filter_map(|folder| Measurement::read(&folder).ok()).next();
        let runs = |job: ProjectJob| job.progress() == ProcessStatus::Running;
        Some(Card {
            name: project.name(),
            title: record.title,
            created: record.created,
            equation: title(&settings, measurement.as_ref()),
            picture: picture.filter(|_| preview.made.pictures > 0),
            value: measurement.as_ref().and_then(quantity),
            outcome: measurement.and_then(|it| it.verdict).map(|verdict| verdict.outcome),
            running: runs(project.preview_job())
                || latest.into_iter().chain(training).any(|folder| runs(ProjectJob::new(folder))),
        })
    }
}

/// Title of the equation that was measured with, or else will be.
fn title(settings: &ProjectSettings, measurement: Option<&Measurement>) -> Option<String> {
    let measured = measurement.and_then(|measurement| equation(&measurement.equation).ok());
    let title = measured.or_else(|| equation(&settings.equation).ok())?.title;
    let missing = settings.extended.filter(|_| measured.is_none());
    Some(missing.map_or_else(|| title.into(), |_| format!("{title}, extended")))
}

/// The first quantity: name, value, half the interval's width and unit.
pub fn quantity(measurement: &Measurement) -> Option<String> {
    let first = measurement.quantities.first()?;
    let name = first.name.replace('_', " ");
    let value = significant(first.value, DIGITS);
    let spread = first.low.zip(first.high).map(|(low, high)| significant(0.5 * (high - low), 2));
    let spread = spread.map_or_else(String::new, |spread| format!(" ± {spread}"));
    Some(format!("{name} = {value}{spread} {}", first.unit))
}
