//! Where a task comes from: the text of a built-in one, or a file.

use std::borrow::Cow;
use std::path::Path;

use anyhow::{Context, Result, anyhow, ensure};
use toml::Table;

use super::Task;
use super::builtin::{builtin, names, text};
use crate::support::storage;

/// The text of a task, not parsed yet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TaskSource {
    /// The name of a built-in task, or the path of a file that ends in `.toml`.
    named: String,
    text: Cow<'static, str>,
}

impl TaskSource {
    /// Finds a built-in task by its name, or reads a file.
    ///
    /// # Errors
    /// An unknown name, with the list of those there are; a file that cannot be read.
    pub fn find(name_or_file: &str) -> Result<Self> {
        let named = name_or_file.to_string();
        if is_file(name_or_file) {
            let text = storage::read_to_string(Path::new(name_or_file)).with_context(|| of_file(name_or_file))?;
            return Ok(TaskSource { named, text: text.into() });
        }
        let text = text(name_or_file).ok_or_else(|| {
            anyhow!("unknown task {name_or_file:?}; give the path of a task file (.toml), or one of {}", names())
        })?;
        Ok(TaskSource { named, text: text.into() })
    }

    /// What [`Self::find`] was asked for.
    pub fn named(&self) -> &str {
        &self.named
    }

    /// The task's name, as far as the text says it.
    ///
    /// # Errors
    /// As for [`Self::table`].
    pub fn name(&self) -> Result<Option<String>> {
        if !is_file(&self.named) {
            return Ok(Some(self.named.clone()));
        }
        Ok(name_in(&self.table()?).map(String::from))
    }

    /// The text as a table, its keys and values not checked.
    ///
    /// # Errors
    /// Text that is no TOML, the name of a built-in task in another file.
    pub fn table(&self) -> Result<Table> {
        let parse = || -> Result<Table> {
            let table: Table = self.text.parse()?;
            let builtin = name_in(&table).and_then(text);
            // Another text may still be the same task.
            if builtin.is_some_and(|builtin| *builtin != self.text) {
                self.parse()?;
            }
            Ok(table)
        };
        parse().with_context(|| of_file(&self.named))
    }

    /// The task.
    ///
    /// # Errors
    /// As for [`Task::from_toml`]; a file with the name of a built-in task.
    pub fn task(&self) -> Result<Task> {
        self.parse().with_context(|| of_file(&self.named))
    }

    fn parse(&self) -> Result<Task> {
        let task = Task::from_toml(&self.text)?;
        let taken = is_file(&self.named) && builtin(&task.name).is_some_and(|other| other != task);
        ensure!(!taken, "task name {:?} is that of a built-in task; choose another", task.name);
        Ok(task)
    }
}

/// The name in a task's table.
pub(crate) fn name_in(table: &Table) -> Option<&str> {
    table.get("name")?.as_str()
}

fn is_file(name_or_file: &str) -> bool {
    name_or_file.ends_with(".toml")
}

/// The folder that a task's file lies in; none of the name of a built-in task.
pub(crate) fn folder_of(name_or_file: &str) -> Option<&str> {
    let folder = Path::new(name_or_file).parent().filter(|_| is_file(name_or_file))?.to_str()?;
    Some(if folder.is_empty() { "." } else { folder })
}

fn of_file(path: &str) -> String {
    format!("task file {path}")
}
