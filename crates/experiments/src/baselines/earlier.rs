//! What earlier reports say: trainings of other machines, or whose runs are gone.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::de::DeserializeOwned;

use super::list::Comparison;
use super::plan::Training;
use super::results::{BaselineRow, PredictedFrames, RESULTS, SEARCH, Searched, SearchedOn};
use paig::support::storage;

/// The rows and searches of earlier reports, each once: the first that has it counts.
#[derive(Debug, Clone, Default)]
pub struct Earlier {
    rows: Vec<BaselineRow>,
    searches: Vec<Searched>,
}

impl Earlier {
    /// Reads the reports in these folders.
    ///
    /// # Errors
    /// A folder that holds none, or a damaged one.
    pub fn read(reports: &[PathBuf]) -> Result<Self> {
        let mut earlier = Earlier::default();
        for report in reports {
            for mut row in read_json::<Vec<BaselineRow>>(&report.join(RESULTS))? {
                row.frames = Some(PredictedFrames::Report(report.clone()));
                earlier.rows.push(row);
            }
            earlier.searches.extend(read_json::<Vec<Searched>>(&report.join(SEARCH))?);
        }
        Ok(earlier)
    }

    /// The row of a training.
    pub fn row(&self, list: &Comparison, training: &Training) -> Option<&BaselineRow> {
        self.rows.iter().find(|row| row.is_of(list, training))
    }

    /// What a search has found, with the rates that were only run earlier.
    pub fn completed(&self, searched: Searched) -> Searched {
        let known: Vec<&Searched> = self.like(&searched.model, &searched.key, searched.on.as_ref()).collect();
        let Searched { model, key, on, rates, mut failed, .. } = searched;
        let earlier = |rate: f64| known.iter().find_map(|searched| searched.score(rate));
        let rates = rates.into_iter().map(|(rate, score)| (rate, score.or_else(|| earlier(rate)))).collect();
        failed.extend(known.iter().flat_map(|searched| &searched.failed));
        Searched::new((&model, &key), on, rates, &failed)
    }

    /// Whether this rate of this model was run in an earlier search.
    pub fn has_searched(&self, list: &Comparison, training: &Training) -> bool {
        let &Training { entry, clips, rate: Some(rate), searched: true, .. } = training else { return false };
        let Some(key) = &entry.rate else { return false };
        let on = SearchedOn::new(list, entry, clips);
        self.like(&entry.name, key, Some(&on)).any(|searched| searched.knows(rate))
    }

    /// The earlier searches of a model's rate that were made by the same trainings; those of before, which do not say by which,
    /// are taken for such.
    fn like(&self, model: &str, key: &str, on: Option<&SearchedOn>) -> impl Iterator<Item = &Searched> {
        let of_model = move |searched: &&Searched| searched.model == model && searched.key == key;
        let by_such = move |searched: &&Searched| searched.on.is_none() || searched.on.as_ref() == on;
        self.searches.iter().filter(of_model).filter(by_such)
    }
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let read = || Ok::<T, anyhow::Error>(serde_json::from_slice(&storage::read(path)?)?);
    read().with_context(|| format!("earlier report, {}", path.display()))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::baselines::plan;

    /// A search on other clips says nothing of this one; an earlier report, which does not say on which, is believed.
    #[test]
    fn a_search_counts_for_trainings_like_its_own() {
        let list =
            Comparison::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/baselines.toml"))).unwrap();
        let models = [list.model("gru").unwrap(), list.model("video_lstm").unwrap()];
        let searches = |clips: Option<usize>| {
            let of = |training: &Training| {
                let on = clips.map(|clips| SearchedOn::new(&list, training.entry, clips));
                let key = training.entry.rate.as_deref().unwrap();
                Searched::new((&training.entry.name, key), on, vec![(training.rate.unwrap(), Some(1.0))], &[])
            };
            Earlier { rows: Vec::new(), searches: plan::search(&list, &models, 5000).iter().map(of).collect() }
        };
        for (clips, counts) in [(Some(5000), true), (Some(1000), false), (None, true)] {
            let earlier = searches(clips);
            for training in plan::search(&list, &models, 5000) {
                assert_eq!(earlier.has_searched(&list, &training), counts, "{} {clips:?}", training.entry.name);
                let (name, key) = (&training.entry.name, training.entry.rate.as_deref().unwrap());
                let here = SearchedOn::new(&list, training.entry, 5000);
                let here = Searched::new((name, key), Some(here), vec![(training.rate.unwrap(), None)], &[]);
                assert_eq!(earlier.completed(here).chosen, training.rate.filter(|_| counts));
            }
        }
    }
}
