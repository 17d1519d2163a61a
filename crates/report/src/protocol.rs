//! The paper's own protocol and the yardsticks of the original: `reports/protocol.toml`, compiled in.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

use paig::network::physics_models::losses::Loss;

/// All of the file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Protocol {
    pub recipe: String,
    yardsticks: Vec<Yardstick>,
}

/// Test losses below which something is learned.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Yardstick {
    tasks: Vec<String>,
    losses: BTreeMap<Loss, f64>,
}

static PROTOCOL: LazyLock<Protocol> =
    LazyLock::new(|| toml::from_str(include_str!("../../../reports/protocol.toml")).expect("a test reads this file"));

pub(super) fn protocol() -> &'static Protocol {
    &PROTOCOL
}

impl Protocol {
    /// The original's yardstick for a task, if it has one.
    pub(super) fn yardstick(&self, task: &str) -> Option<&BTreeMap<Loss, f64>> {
        let row = self.yardsticks.iter().find(|row| row.tasks.iter().any(|name| name == task))?;
        Some(&row.losses)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use paig::tasks;

    #[test]
    fn the_file_is_sound_and_names_tasks() {
        assert!(protocol().yardsticks.iter().flat_map(|row| &row.tasks).all(|name| tasks::find(name).is_ok()));
        assert_eq!(protocol().yardstick("3bp_color").unwrap()[&Loss::Recons], 1.5);
        assert_eq!(protocol().yardstick("mnist_spring_color").unwrap().get(&Loss::Recons), None);
        assert!(protocol().yardstick("mine").is_none());
    }
}
