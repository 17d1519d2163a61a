//! Numbers that others have published: `reports/published.toml`, compiled in.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use crate::network::physics_models::losses::Loss;

/// `who` of the paper's own losses.
const PAPER: &str = "paper";

/// All of the file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Where the numbers come from, for readers.
    pub sources: String,
    /// Passes over the training clips in the paper's training.
    pub epochs: f64,
    parameters: Vec<PublishedParameter>,
    losses: Vec<PublishedLosses>,
}

/// A parameter that the paper learned.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedParameter {
    task: String,
    symbol: String,
    pub learned: f64,
    pub truth: f64,
}

/// Test losses on a task: squared error summed over a frame, averaged over frames and clips.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedLosses {
    task: String,
    pub who: String,
    pub losses: BTreeMap<Loss, f64>,
}

static PUBLISHED: LazyLock<Published> =
    LazyLock::new(|| toml::from_str(include_str!("../../reports/published.toml")).expect("a test reads this file"));

/// What is published.
pub fn published() -> &'static Published {
    &PUBLISHED
}

impl Published {
    /// What the paper learned for a parameter, if it reports it.
    pub fn parameter(&self, task: &str, symbol: &str) -> Option<&PublishedParameter> {
        self.parameters.iter().find(|row| row.task == task && row.symbol == symbol)
    }

    /// Test losses on a task, the paper's own first.
    pub fn losses(&self, task: &str) -> impl Iterator<Item = &PublishedLosses> {
        self.losses.iter().filter(move |row| row.task == task)
    }

    /// A test loss of the paper, if it reports it.
    pub fn paper_loss(&self, task: &str, loss: Loss) -> Option<f64> {
        self.losses(task).find(|row| row.who == PAPER)?.losses.get(&loss).copied()
    }

    /// Whether the paper reports numbers of a task.
    pub fn knows(&self, task: &str) -> bool {
        self.parameters.iter().any(|row| row.task == task) || self.losses(task).any(|row| row.who == PAPER)
    }
}

impl PublishedParameter {
    /// The error in per cent of the truth, with its sign.
    pub fn error_percent(&self) -> f64 {
        100.0 * (self.learned / self.truth - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks;

    #[test]
    fn the_file_is_sound_and_names_tasks_and_their_parameters() {
        for row in &published().parameters {
            let task = tasks::find(&row.task).unwrap();
            assert!(task.system.cell.parameters.iter().any(|p| p.name == row.symbol), "{row:?}");
        }
        assert!(published().losses.iter().all(|row| tasks::find(&row.task).is_ok()));
        assert_eq!(published().paper_loss("spring_color", Loss::Pred), Some(1.39));
        assert_eq!(published().paper_loss("spring_color", Loss::Extrap), None);
        assert!(published().knows("3bp_color") && !published().knows("pendulum"));
        let k = published().parameter("spring_color", "k").unwrap();
        assert!((k.error_percent() - 6.5).abs() < 1e-9, "{}", k.error_percent());
        let misspelt = include_str!("../../reports/published.toml").replace("learned =", "lerned =");
        assert!(toml::from_str::<Published>(&misspelt).is_err());
    }
}
