//! The paper's tables and figures beside ours: `cargo xtask paper`.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use clap::Args;
use paig::support::{atomic, storage};
use serde_json::{Map, Value};

use crate::project::project;

/// Words of the page.
const TEMPLATE: &str = "reports/paper.md.jinja";
const PAGE: &str = "docs/paper.md";
/// Reports with numbers of the page.
const REPORTS: [&str; 5] = ["data-seeds", "seeds", "paper-protocol", "baselines", "control"];

/// Writes docs/paper.md from reports/paper.md.jinja and the numbers of the reports.
#[derive(Debug, Args)]
pub struct PaperArguments {}

/// # Errors
/// A report that cannot be read or lacks a number, a full disk.
pub fn run(_: &PaperArguments) -> Result<()> {
    let page = page()?;
    atomic::write_file(&project(PAGE), |file| Ok(file.write_all(page.as_bytes())?))
}

fn page() -> Result<String> {
    let read = |path: &Path| {
        let text = storage::read_to_string(path)?;
        Ok::<Value, anyhow::Error>(match path.extension() {
            Some(extension) if extension == "toml" => toml::from_str(&text)?,
            _ => serde_json::from_str(&text)?,
        })
    };
    let read = |path: String| read(&project(&path)).with_context(|| path);
    let mut numbers = Map::from_iter([("published".into(), read("reports/published.toml".into())?)]);
    for report in REPORTS {
        numbers.insert(report.replace('-', "_"), read(format!("reports/{report}/results.json"))?);
    }
    paig_report::fill_template(&storage::read_to_string(&project(TEMPLATE))?, &Value::Object(numbers)).context(TEMPLATE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_the_numbers_of_the_reports() {
        let written = std::fs::read_to_string(project(PAGE)).unwrap();
        assert!(page().unwrap() == written, "{PAGE} is out of date: run `cargo xtask paper`");
    }
}
