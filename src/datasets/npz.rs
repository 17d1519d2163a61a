//! Reading and writing npz files with messages that name the file and the array.

use std::io::{BufReader, Cursor, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use ndarray::ArrayD;
use ndarray_npy::{NpzReader, NpzWriter, ReadNpyError, ReadNpzError, ReadableElement};
use zip::write::SimpleFileOptions;

use crate::support::error::{Error, ErrorKind};
use crate::support::storage::{self, StorageInput, storage};
use crate::support::{atomic, memory};

/// A compressed npz under construction, in memory.
pub type ArchiveWriter = NpzWriter<Cursor<Vec<u8>>>;

/// Bytes that one byte of a deflated file can unpack to.
const MOST_PACKED: u64 = 1032;
/// The fastest level of compression: floating-point numbers get no smaller by a higher one.
const FASTEST: i64 = 1;
/// Bytes in which the header of an array must lie.
const MOST_HEADER: u64 = 4096;

/// An npz file open for reading.
pub struct Archive {
    path: PathBuf,
    reader: NpzReader<BufReader<Box<dyn StorageInput>>>,
    names: Vec<String>,
}

impl Archive {
    pub fn open(path: &Path) -> Result<Self> {
        ensure!(!path.is_dir(), "{path:?} is a folder, not an npz file");
        let file = storage::open(path).with_context(|| format!("cannot open {path:?}"))?;
        let unreadable =
            || format!("{path:?} is not a readable npz file: truncated, or something else; delete it and get it again");
        let mut reader = NpzReader::new(BufReader::new(file)).with_context(unreadable)?;
        let names = reader.names().with_context(unreadable)?;
        Ok(Self { path: path.to_owned(), reader, names })
    }

    pub fn names(&self) -> &[String] {
        &self.names
    }

    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|known| known == name)
    }

    /// Reads an array of any shape, in row-major order. `dtype` is the name of `T` in messages.
    pub fn array<T: ReadableElement + Clone>(&mut self, name: &str, dtype: &str) -> Result<ArrayD<T>> {
        if !self.has(name) {
            bail!("{:?} has no array {name:?}; its arrays are {:?}", self.path, self.names);
        }
        self.check_size(name)?;
        let array: ArrayD<T> = self.reader.by_name(name).map_err(|error| match error {
            ReadNpzError::Npy(ReadNpyError::WrongDescriptor(found)) => {
                anyhow!(self.wrong_dtype(name, &found.to_string(), dtype))
            }
            error => anyhow::Error::new(error).context(format!(
                "cannot read array {name:?} of {:?}: the file is damaged; delete it and get it again",
                self.path
            )),
        })?;
        Ok(if array.is_standard_layout() { array } else { array.as_standard_layout().into_owned() })
    }

    /// Room is made for as many numbers as an array's header claims, so the claim must fit into memory.
    fn check_size(&self, name: &str) -> Result<()> {
        self.entry(name, |header, _| {
            // The array, and its copy in row-major order.
            memory::ensure_free(header.bytes.saturating_mul(2))
                .with_context(|| format!("array {name:?} of {:?}", self.path))
        })
    }

    /// What the header of an array of bytes says, checked against the archive.
    pub fn header(&self, name: &str) -> Result<NpyHeader> {
        self.entry(name, |header, _| Ok(header))
    }

    /// Reads an array of bytes in row-major order piece by piece: `read` gets its header and what follows it.
    pub fn stream<T>(&self, name: &str, read: impl FnOnce(NpyHeader, &mut dyn Read) -> Result<T>) -> Result<T> {
        self.entry(name, |header, file| {
            ensure!(header.kind == "|u1", "{}", self.wrong_dtype(name, &header.kind, "uint8"));
            ensure!(
                header.row_major,
                "array {name:?} of {:?} is in column-major (Fortran) order; to be read from the disk it must be saved in \
                 row-major order",
                self.path
            );
            read(header, file)
        })
    }

    /// Opens an array. More numbers than the archive holds, or than its bytes can be unpacked to,
    /// are damage.
    fn entry<T>(&self, name: &str, read: impl FnOnce(NpyHeader, &mut dyn Read) -> Result<T>) -> Result<T> {
        let mut archive = zip::ZipArchive::new(BufReader::new(storage::open(&self.path)?))?;
        let named = [format!("{name}.npy"), name.to_string()];
        let entry = named.iter().find_map(|name| archive.index_for_name(name));
        let mut entry = archive.by_index(entry.with_context(|| format!("{:?} has no array {name:?}", self.path))?)?;
        let (held, packed) = (entry.size(), entry.compressed_size());
        let damaged = || format!("array {name:?} of {:?}: the file is damaged; delete it and get it again", self.path);
        let damage = |what: String| Error::new(ErrorKind::Corrupt, anyhow!("{}: {what}", damaged()));
        if held > packed.saturating_mul(MOST_PACKED).saturating_add(MOST_HEADER) {
            return Err(damage(format!("it claims {held} bytes, which {packed} cannot be unpacked to")).into());
        }
        let mut header = NpyHeader::read(&mut entry).with_context(damaged)?;
        let claimed = header.shape.iter().try_fold(header.bytes_each(), |product, count| product.checked_mul(*count));
        let claimed = claimed.filter(|bytes| *bytes <= held);
        header.bytes = claimed.ok_or_else(|| damage("its header claims more numbers than it holds".into()))?;
        read(header, &mut entry)
    }

    fn wrong_dtype(&self, name: &str, found: &str, expected: &str) -> String {
        let range = if expected == "uint8" { ", 0 to 255" } else { "" };
        format!(
            "array {name:?} of {:?} has dtype {found}, expected {expected}; save it as {expected}{range}",
            self.path
        )
    }

    /// The same for numbers of either float type, as float32.
    pub fn floats(&mut self, name: &str) -> Result<ArrayD<f32>> {
        if self.has(name) && self.header(name)?.kind == "<f8" {
            Ok(self.array::<f64>(name, "float64")?.mapv(|value| value as f32))
        } else {
            self.array(name, "float32 or float64")
        }
    }
}

/// What the header of an npy file says.
#[derive(Debug)]
pub struct NpyHeader {
    /// As numpy writes it: `|u1` for uint8.
    pub kind: String,
    pub row_major: bool,
    pub shape: Vec<u64>,
    /// Of all numbers together.
    pub bytes: u64,
}

impl NpyHeader {
    /// Reads it, and no more: what follows may be damaged without being claimed.
    fn read(file: &mut impl Read) -> Result<Self> {
        let mut start = [0; 8];
        file.read_exact(&mut start)?;
        ensure!(start.starts_with(b"\x93NUMPY"), "it is no npy array");
        // Version 1 gives the header's length in two bytes, later ones in four (the npy format, NEP 1).
        let mut length = [0; 4];
        file.read_exact(&mut length[..if start[6] == 1 { 2 } else { 4 }])?;
        let mut header = Vec::new();
        file.take(u64::from(u32::from_le_bytes(length)).min(MOST_HEADER)).read_to_end(&mut header)?;
        let text = String::from_utf8_lossy(&header);
        let after = |key: &str| text.split_once(key).map(|(_, rest)| rest);
        let shape = after("'shape'").and_then(|rest| rest.split_once('(')?.1.split_once(')'));
        let (shape, _) = shape.context("its header has no shape")?;
        let numbers = shape.split(',').map(str::trim).filter(|number| !number.is_empty());
        let numbers = numbers.map(|number| number.trim_end_matches('L').parse().ok());
        let shape = numbers.collect::<Option<_>>().with_context(|| format!("its header claims the shape ({shape})"))?;
        let kind = after("'descr'").and_then(|rest| rest.split('\'').nth(1)).unwrap_or_default().to_string();
        let row_major =
            !after("'fortran_order'").is_some_and(|rest| rest.trim_start_matches([':', ' ']).starts_with("True"));
        Ok(NpyHeader { kind, row_major, shape, bytes: 0 })
    }

    /// Of a number: what stands last in numpy's name of a kind. Text has so many letters of four bytes.
    fn bytes_each(&self) -> u64 {
        let letters = self.kind.find(|c: char| c.is_ascii_digit()).and_then(|at| self.kind[at..].parse::<u64>().ok());
        letters.unwrap_or(1).saturating_mul(if self.kind.contains('U') { 4 } else { 1 })
    }
}

/// Collects arrays into a compressed npz and puts it at `path` in one step.
pub(crate) fn write(path: &Path, fill: impl FnOnce(&mut ArchiveWriter) -> Result<()>) -> Result<()> {
    write_whole(path, &compressed(path, fill)?)
}

/// The same for floating-point numbers.
pub(crate) fn write_floats(path: &Path, fill: impl FnOnce(&mut ArchiveWriter) -> Result<()>) -> Result<()> {
    let options = SimpleFileOptions::default().compression_level(Some(FASTEST));
    write_whole(path, &collected(path, options, fill)?)
}

/// Collects arrays into a compressed npz that is to be written to `path`.
pub(crate) fn compressed(path: &Path, fill: impl FnOnce(&mut ArchiveWriter) -> Result<()>) -> Result<Vec<u8>> {
    collected(path, SimpleFileOptions::default(), fill)
}

fn collected(
    path: &Path,
    options: SimpleFileOptions,
    fill: impl FnOnce(&mut ArchiveWriter) -> Result<()>,
) -> Result<Vec<u8>> {
    let mut npz = NpzWriter::new_with_options(Cursor::new(Vec::new()), options);
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
