//! Reading and writing npz files with messages that name the file and the array.

use std::io::{BufReader, Cursor, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use ndarray::ArrayD;
use ndarray_npy::{NpzReader, NpzWriter, ReadNpyError, ReadNpzError, ReadableElement};

use crate::support::storage::{self, Input, storage};
use crate::support::{atomic, memory};

/// A compressed npz under construction, in memory.
pub(crate) type Writer = NpzWriter<Cursor<Vec<u8>>>;

/// Bytes that one byte of a deflated file can unpack to.
const MOST_PACKED: u64 = 1032;
/// Bytes in which the header of an array must lie.
const MOST_HEADER: u64 = 4096;

/// An npz file open for reading.
pub(crate) struct Archive {
    path: PathBuf,
    reader: NpzReader<BufReader<Box<dyn Input>>>,
    names: Vec<String>,
}

impl Archive {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        ensure!(!path.is_dir(), "{path:?} is a folder, not an npz file");
        let file = storage::open(path).with_context(|| format!("cannot open {path:?}"))?;
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
        self.check_size::<T>(name)?;
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

    /// Room is made for as many numbers as an array's header claims, so the claim must be that of the archive, too, and fit
    /// into memory.
    fn check_size<T>(&self, name: &str) -> Result<()> {
        let mut archive = zip::ZipArchive::new(BufReader::new(storage::open(&self.path)?))?;
        let named = [format!("{name}.npy"), name.to_string()];
        let entry = named.iter().find_map(|name| archive.index_for_name(name));
        let entry = archive.by_index(entry.with_context(|| format!("{:?} has no array {name:?}", self.path))?)?;
        let (held, packed) = (entry.size(), entry.compressed_size());
        let damaged = || format!("array {name:?} of {:?}: the file is damaged; delete it and get it again", self.path);
        ensure!(
            held <= packed.saturating_mul(MOST_PACKED).saturating_add(MOST_HEADER),
            "{}: it claims {held} bytes, which {packed} cannot be unpacked to",
            damaged()
        );
        let claimed = claimed_elements(entry).with_context(damaged)?;
        let claimed = claimed.checked_mul(size_of::<T>() as u64).filter(|bytes| *bytes <= held);
        let bytes = claimed.with_context(|| format!("{}: its header claims more numbers than it holds", damaged()))?;
        // The array, and its copy in row-major order.
        memory::ensure_free(bytes.saturating_mul(2)).with_context(|| format!("array {name:?} of {:?}", self.path))
    }

    /// The same for numbers of either float type, as float32.
    pub(crate) fn floats(&mut self, name: &str) -> Result<ArrayD<f32>> {
        match self.array::<f64>(name, "float64") {
            Ok(array) => Ok(array.mapv(|value| value as f32)),
            Err(_) => self.array(name, "float32 or float64"),
        }
    }
}

/// The number of elements that the header of an npy file claims.
fn claimed_elements(mut file: impl Read) -> Result<u64> {
    // No more is read than the header: what follows it may be damaged without being claimed.
    let mut start = [0; 8];
    file.read_exact(&mut start)?;
    ensure!(start.starts_with(b"\x93NUMPY"), "it is no npy array");
    // Version 1 gives the header's length in two bytes, later ones in four (the npy format, NEP 1).
    let mut length = [0; 4];
    file.read_exact(&mut length[..if start[6] == 1 { 2 } else { 4 }])?;
    let mut header = Vec::new();
    file.take(u64::from(u32::from_le_bytes(length)).min(MOST_HEADER)).read_to_end(&mut header)?;
    let text = String::from_utf8_lossy(&header);
    let shape = text.split_once("'shape'").and_then(|(_, rest)| rest.split_once('(')?.1.split_once(')'));
    let (shape, _) = shape.context("its header has no shape")?;
    let numbers = shape.split(',').map(str::trim).filter(|number| !number.is_empty());
    let mut numbers = numbers.map(|number| number.trim_end_matches('L').parse::<u64>().ok());
    let product = numbers.try_fold(1u64, |product, number| product.checked_mul(number?));
    product.with_context(|| format!("its header claims the shape ({shape})"))
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
    storage().create_folder(folder).with_context(|| format!("cannot make the folder {folder:?}"))
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
