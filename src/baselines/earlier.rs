//! What earlier reports say: trainings of other machines, or whose runs are gone.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::de::DeserializeOwned;

use super::plan::Training;
use super::results::{PredictedFrames, RESULTS, Row, SEARCH, Searched};
use crate::support::storage;

/// The rows and searches of earlier reports, each once: the first that has it counts.
#[derive(Debug, Clone, Default)]
pub struct Earlier {
    rows: Vec<Row>,
    /// Model and key, and the scores of the rates that were run.
    searches: BTreeMap<(String, String), Vec<Searched>>,
}

impl Earlier {
    /// Reads the reports in these folders.
    ///
    /// # Errors
    /// A folder that holds none, or a damaged one.
    pub fn read(reports: &[PathBuf]) -> Result<Self> {
        let mut earlier = Earlier::default();
        for report in reports {
            for mut row in read_json::<Vec<Row>>(&report.join(RESULTS))? {
                row.frames = Some(PredictedFrames::Report(report.clone()));
                earlier.rows.push(row);
            }
            for searched in read_json::<Vec<Searched>>(&report.join(SEARCH))? {
                let key = (searched.model.clone(), searched.key.clone());
                earlier.searches.entry(key).or_default().push(searched);
            }
        }
        Ok(earlier)
    }

    /// The row of a training.
    pub fn row(&self, training: &Training) -> Option<&Row> {
        self.rows.iter().find(|row| row.is_of(training))
    }

    /// What a search has found, with the rates that were only run earlier.
    pub fn completed(&self, searched: Searched) -> Searched {
        let Searched { model, key, rates, mut failed, .. } = searched;
        let known = self.searches.get(&(model.clone(), key.clone())).map_or(&[][..], Vec::as_slice);
        let earlier = |rate: f64| known.iter().find_map(|searched| searched.score(rate));
        let rates = rates.into_iter().map(|(rate, score)| (rate, score.or_else(|| earlier(rate)))).collect();
        failed.extend(known.iter().flat_map(|searched| &searched.failed));
        Searched::new(&model, &key, rates, &failed)
    }

    /// Whether this rate of this model was run in an earlier search.
    pub fn has_searched(&self, training: &Training) -> bool {
        let (Some(key), Some(rate)) = (&training.entry.rate, training.rate) else { return false };
        let known = self.searches.get(&(training.entry.name.clone(), key.clone()));
        training.searched && known.is_some_and(|known| known.iter().any(|searched| searched.knows(rate)))
    }
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let read = || Ok::<T, anyhow::Error>(serde_json::from_slice(&storage::read(path)?)?);
    read().with_context(|| format!("earlier report, {}", path.display()))
}
