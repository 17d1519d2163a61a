//! The pieces that report.md is put together from.

use std::fmt::Write;

use anyhow::Result;

use super::pictures::Picture;
use super::statistics::{Spread, significant};

/// What stands for a number that there is not.
pub(super) const NONE: &str = "–";

/// The error of a value in per cent, with its sign; never broken across lines.
pub(super) fn percent(value: f64, truth: f64) -> String {
    signed(100.0 * (value / truth - 1.0))
}

/// Per cent with their sign; never broken across lines.
pub(super) fn signed(percent: f64) -> String {
    format!("{percent:+.2}\u{a0}%")
}

/// `median [min, max]`.
pub(super) fn spread(spread: Option<Spread>) -> String {
    spread.map_or(NONE.into(), |spread| spread.text(significant))
}

pub(super) fn minutes(seconds: f64) -> String {
    format!("{:.1} min", seconds / 60.0)
}

/// Minutes, or seconds where these say little.
pub(super) fn duration(seconds: f64) -> String {
    if seconds < 120.0 { format!("{seconds:.0} s") } else { minutes(seconds) }
}

/// A table with its head.
pub(super) fn table(page: &mut String, head: &[&str], rows: &[String]) -> Result<()> {
    writeln!(page, "{}\n{}\n{}\n", row(head), row(&vec!["---"; head.len()]), rows.join("\n"))?;
    Ok(())
}

/// One line of a table.
pub(super) fn row<S: AsRef<str>>(cells: &[S]) -> String {
    let cells: Vec<_> = cells.iter().map(|cell| cell.as_ref().replace('|', "\\|").replace('\n', " ")).collect();
    format!("| {} |", cells.join(" | "))
}

/// Text that is shown as it is.
pub(super) fn code(text: &str) -> String {
    format!("`{}`", text.replace('`', "'").replace('\n', " "))
}

/// Text from outside in which nothing may be taken for markup. (An underscore within a word is none.)
pub(super) fn text(text: &str) -> String {
    text.chars().flat_map(|c| "\\`*[]<>&#~".contains(c).then_some('\\').into_iter().chain([c])).collect()
}

/// A picture with its caption.
pub(super) fn show(page: &mut String, picture: &Picture) -> Result<()> {
    Ok(writeln!(page, "![{0}]({1})\n\n*{0}*\n", picture.caption, picture.path)?)
}
