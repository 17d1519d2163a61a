//! Reading and writing npz files with messages that name the file and the array.

use std::fs::{self, File};
use std::io::{BufReader, Cursor, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use ndarray::ArrayD;
use ndarray_npy::{NpzReader, NpzWriter, ReadNpyError, ReadNpzError, ReadableElement};

use crate::support::atomic;

/// A compressed npz under construction, in memory.
pub(crate) type Writer = NpzWriter<Cursor<Vec<u8>>>;

/// An npz file open for reading.
pub(crate) struct Archive {
    path: PathBuf,
    reader: NpzReader<BufReader<File>>,
    names: Vec<String>,
}

impl Archive {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).with_context(|| format!("cannot open {path:?}"))?;
        ensure!(!path.is_dir(), "{path:?} is a folder, not an npz file");
        let unreadable =
            || format!("{path:?} is not a readable npz file: truncated, or something else; delete it and get it again");
        let mut reader = NpzReader::new(BufReader::new(file)).with_context(unreadable)?;
        let names = reader.names().with_context(unreadable)?;
        Ok(Self { path: path.to_owned(), reader, names })
    }

    pub(crate) fn names(&self) -> &[String] {
        &self.names
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.names.iter().any(|known| known == name)
    }

    /// Reads an array of any shape, in row-major order. `dtype` is the name of `T` in messages.
    pub(crate) fn array<T: ReadableElement + Clone>(&mut self, name: &str, dtype: &str) -> Result<ArrayD<T>> {
        if !self.has(name) {
            bail!("{:?} has no array {name:?}; its arrays are {:?}", self.path, self.names);
        }
        let array: ArrayD<T> = self.reader.by_name(name).map_err(|error| match error {
            ReadNpzError::Npy(ReadNpyError::WrongDescriptor(found)) => {
                anyhow!(
                    "array {name:?} of {:?} has dtype {found}, expected {dtype}; save it as {dtype}{}",
                    self.path,
                    if dtype == "uint8" { ", 0 to 255" } else { "" }
                )
            }
            error => anyhow::Error::new(error).context(format!(
                "cannot read array {name:?} of {:?}: the file is damaged; delete it and get it again",
                self.path
            )),
        })?;
        Ok(if array.is_standard_layout() { array } else { array.as_standard_layout().into_owned() })
    }

    /// The same for numbers of either float type, as float32.
    pub(crate) fn floats(&mut self, name: &str) -> Result<ArrayD<f32>> {
        match self.array::<f64>(name, "float64") {
            Ok(array) => Ok(array.mapv(|value| value as f32)),
            Err(_) => self.array(name, "float32 or float64"),
        }
    }
}

/// Collects arrays into a compressed npz and puts it at `path` in one step.
pub(crate) fn write(path: &Path, fill: impl FnOnce(&mut Writer) -> Result<()>) -> Result<()> {
    write_whole(path, &compressed(path, fill)?)
}

/// Collects arrays into a compressed npz that is to be written to `path`.
pub(crate) fn compressed(path: &Path, fill: impl FnOnce(&mut Writer) -> Result<()>) -> Result<Vec<u8>> {
    let mut npz = NpzWriter::new_compressed(Cursor::new(Vec::new()));
    let bytes = fill(&mut npz).and_then(|()| Ok(npz.finish()?.into_inner()));
    bytes.with_context(|| format!("cannot compress the arrays of {path:?}"))
}

/// Makes the folders in which a file is to lie where missing.
pub(crate) fn make_folder(path: &Path) -> Result<()> {
    let Some(folder) = path.parent() else { return Ok(()) };
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {folder:?}"))
}

/// Writes a file in one step, and the folders it lies in where missing.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    make_folder(path)?;
    atomic::write_file(path, |file| Ok(file.write_all(bytes)?)).with_context(|| {
        format!(
            "{path:?} ({} bytes) was not saved, nothing is left of it; check free space and permissions",
            bytes.len()
        )
    })
}
