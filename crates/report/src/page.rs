//! report.md.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Result;
use minijinja::context;

use super::groups::{RunGroup, by_task};
use super::pictures::{GroupPictures, WithPictures};
use super::protocol::protocol;
use super::view::{of_group, of_task, value};
use super::{hypotheses, template};
use paig::network::physics_models::losses::Loss;
use paig::tasks::published::published;

/// The whole report. `unreadable`: folders, and what is wrong with them; `records`: where those of each group's runs lie.
pub(super) fn page(
    groups: &[RunGroup],
    unreadable: &[(PathBuf, anyhow::Error)],
    pictures: &[GroupPictures],
    records: &[Vec<PathBuf>],
    folders: &[String],
    shown: WithPictures,
) -> Result<String> {
    let of_groups = groups.iter().zip(pictures).zip(records);
    let views: Vec<_> =
        of_groups.map(|((group, pictures), records)| of_group(group, pictures, records)).collect::<Result<_>>()?;
    let tasks = by_task(groups).into_iter();
    let tasks = tasks.map(|(task, places)| of_task(&task, &groups[places.clone()], &views[places]));
    let unreadable = unreadable.iter().map(|(folder, error)| {
        context! { folder => folder.display().to_string(), error => format!("{error:#}") }
    });
    template::page(&context! {
        title => template::TITLE,
        folders => folders.to_vec(),
        pictures => shown == WithPictures::Shown,
        unreadable => unreadable.collect::<Vec<_>>(),
        losses => Loss::ALL.map(Loss::key).to_vec(),
        symbols => value(BTreeMap::from(Loss::ALL.map(|loss| (loss, loss.symbol())))),
        tasks => tasks.collect::<Vec<_>>(),
        findings => hypotheses::findings(groups, &views)?,
        recipe_of_paper => protocol().recipe.clone(),
        published => value(published()),
    })
}
