//! Prints the comparisons as they are made, and their summary.

use std::path::{Path, PathBuf};

use crate::checks::Row;

/// Counts what has been printed.
#[derive(Debug)]
pub struct Table {
    file_width: usize,
    files: usize,
    tensors: usize,
    failed: usize,
    without_case: usize,
}

const TENSOR_WIDTH: usize = 48;

impl Table {
    /// Prints the head of a table that will hold these files.
    pub fn new(files: &[PathBuf]) -> Self {
        let file_width = files.iter().map(|file| name(file).len()).max().unwrap_or_default();
        println!(
            "{:file_width$}  {:TENSOR_WIDTH$}  {:>20}  {:>10}  {:>10}  {:>9}  result",
            "file", "tensor", "shape", "max abs", "max rel", "tolerance"
        );
        Table { file_width, files: 0, tensors: 0, failed: 0, without_case: 0 }
    }

    /// Prints a file's rows; `None` is a file that no case knows.
    pub fn add(&mut self, path: &Path, rows: Option<Vec<Row>>) {
        let (file, file_width) = (name(path), self.file_width);
        self.files += 1;
        let Some(rows) = rows else {
            self.without_case += 1;
            println!("{file:file_width$}  no case for a file of this name: FAIL");
            return;
        };
        for row in rows {
            self.tensors += 1;
            let passes = row.passes();
            self.failed += usize::from(!passes);
            let shape = format!("{:?}", row.shape);
            let beyond = match row.beyond() {
                0 => String::new(),
                n if passes => format!(" ({n} within their own rounding)"),
                n => format!(" ({n} beyond)"),
            };
            println!(
                "{file:file_width$}  {:TENSOR_WIDTH$}  {shape:>20}  {:10.3e}  {:10.3e}  {:9.0e}  {}{beyond}",
                row.tensor,
                row.absolute,
                row.relative,
                row.tolerance.relative,
                if passes { "pass" } else { "FAIL" },
            );
        }
    }

    /// Prints the summary; gives whether everything passed.
    pub fn finish(self) -> bool {
        let Table { files, tensors, failed, without_case, .. } = self;
        println!("{files} files, {tensors} comparisons: {failed} failed; {without_case} files without a case");
        failed == 0 && without_case == 0
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
