//! Prints the comparisons as they are made, and their summary.

use std::path::{Path, PathBuf};

use crate::harness::row::RowVerdict;
use crate::harness::verdict::{JudgedRow, UninformativeCheck};

/// Counts what has been printed.
#[derive(Debug)]
pub struct Table {
    file_width: usize,
    files: usize,
    tensors: usize,
    failed: usize,
    uninformative: usize,
    /// Of the uninformative ones.
    not_held: usize,
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
        Table { file_width, files: 0, tensors: 0, failed: 0, uninformative: 0, not_held: 0, without_case: 0 }
    }

    /// Prints a file's rows; `None` is a file that no case knows.
    pub fn add(&mut self, path: &Path, judged: Option<&[JudgedRow]>) {
        let (file, file_width) = (name(path), self.file_width);
        self.files += 1;
        let Some(judged) = judged else {
            self.without_case += 1;
            println!("{file:file_width$}  no case for a file of this name: FAIL");
            return;
        };
        for each in judged {
            self.count(each);
            let (row, shape) = (&each.row, format!("{:?}", each.row.shape));
            println!(
                "{file:file_width$}  {:TENSOR_WIDTH$}  {shape:>20}  {:10.3e}  {:10.3e}  {:9.0e}  {}",
                row.title,
                row.absolute,
                row.relative,
                row.tolerance.relative,
                each.words(),
            );
        }
    }

    fn count(&mut self, judged: &JudgedRow) {
        self.tensors += 1;
        match judged.verdict {
            RowVerdict::Pass => {}
            RowVerdict::Fail => self.failed += 1,
            RowVerdict::Uninformative => {
                self.uninformative += 1;
                self.not_held += usize::from(judged.held == Some(UninformativeCheck::NotAtAll));
            }
        }
    }

    /// Prints the summary; gives whether nothing failed.
    pub fn finish(self) -> bool {
        let Table { files, tensors, failed, uninformative, not_held, without_case, .. } = self;
        let of_them = match uninformative {
            0 => String::new(),
            _ => format!(" ({not_held} of them not held by a single step)"),
        };
        println!(
            "{files} files, {tensors} comparisons: {failed} failed, {uninformative} uninformative{of_them}; {without_case} files without a case"
        );
        failed == 0 && without_case == 0
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
