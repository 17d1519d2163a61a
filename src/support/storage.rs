//! The one way to the disk for all that runs, datasets and reports write, and for what they read back.
//!
//! Two backends: the file system, and in tests one that fails, tears or stops at an operation of its choice (see
//! [`with`]). What only looks (whether a file is there, what a folder holds) goes past it.

use std::cell::RefCell;
use std::fmt::Debug;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, Write};
use std::path::Path;
use std::rc::Rc;

use nix::fcntl::{AT_FDCWD, RenameFlags, renameat2};

/// A file that is being written.
pub trait StorageOutput: Write + Seek + Debug + Send {
    /// Length so far, bytes.
    ///
    /// # Errors
    /// What the system says.
    fn length(&self) -> io::Result<u64>;
}

/// A file that is being read.
pub trait StorageInput: Read + Seek + Debug + Send {}

/// What is done to files and folders. Every error is the system's.
#[expect(clippy::missing_errors_doc, reason = "they are the system's")]
pub trait Storage: Debug {
    /// A new file, empty, in the place of what is there.
    fn create(&self, path: &Path) -> io::Result<Box<dyn StorageOutput>>;
    /// A file that is written at its end; made if it is not there.
    fn append(&self, path: &Path) -> io::Result<Box<dyn StorageOutput>>;
    /// A new file in a folder, to write and to read, without a name: it is gone when it is closed.
    fn nameless(&self, folder: &Path) -> io::Result<File>;
    /// A file to read.
    fn open(&self, path: &Path) -> io::Result<Box<dyn StorageInput>>;
    /// Makes what a file or a folder holds last through a power cut.
    fn sync(&self, path: &Path) -> io::Result<()>;
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Exchanges two files or folders of one file system in one step.
    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()>;
    /// Gives a file a second name on its file system; of a link, the link itself.
    fn link(&self, from: &Path, to: &Path) -> io::Result<()>;
    fn remove_file(&self, path: &Path) -> io::Result<()>;
    /// A file that is not there is no error.
    fn remove_if_there(&self, path: &Path) -> io::Result<()> {
        match self.remove_file(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            removed => removed,
        }
    }
    /// With all that is in it.
    fn remove_folder(&self, path: &Path) -> io::Result<()>;
    /// With those above it; one that is there is no error.
    fn create_folder(&self, path: &Path) -> io::Result<()>;
    /// Cuts a file off at a length, bytes; one that is shorter stays.
    fn shorten(&self, path: &Path, length: u64) -> io::Result<()>;
}

/// The disk.
#[derive(Debug, Clone, Copy, Default)]
pub struct FileSystem;

impl StorageOutput for File {
    fn length(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }
}

impl StorageInput for File {}

impl Storage for FileSystem {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StorageOutput>> {
        Ok(Box::new(File::create(path)?))
    }

    fn append(&self, path: &Path) -> io::Result<Box<dyn StorageOutput>> {
        Ok(Box::new(OpenOptions::new().create(true).append(true).open(path)?))
    }

    fn nameless(&self, folder: &Path) -> io::Result<File> {
        tempfile::tempfile_in(folder)
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn StorageInput>> {
        Ok(Box::new(File::open(path)?))
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        File::open(path)?.sync_all()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        Ok(renameat2(AT_FDCWD, one, AT_FDCWD, other, RenameFlags::RENAME_EXCHANGE)?)
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::hard_link(from, to)
    }

    fn remove_file(&self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }

    fn remove_folder(&self, path: &Path) -> io::Result<()> {
        fs::remove_dir_all(path)
    }

    fn create_folder(&self, path: &Path) -> io::Result<()> {
        fs::create_dir_all(path)
    }

    fn shorten(&self, path: &Path, length: u64) -> io::Result<()> {
        let file = OpenOptions::new().write(true).open(path)?;
        file.set_len(length.min(file.metadata()?.len()))
    }
}

thread_local! {
    static BACKEND: RefCell<Rc<dyn Storage>> = RefCell::new(Rc::new(FileSystem));
}

/// Does something with another backend for all that this thread writes and reads meanwhile.
pub fn with<T>(backend: Rc<dyn Storage>, work: impl FnOnce() -> T) -> T {
    struct Back(Rc<dyn Storage>);
    impl Drop for Back {
        fn drop(&mut self) {
            BACKEND.set(self.0.clone());
        }
    }
    let _back = Back(BACKEND.replace(backend));
    work()
}

/// The backend of this thread.
pub fn storage() -> Rc<dyn Storage> {
    BACKEND.with_borrow(Rc::clone)
}

/// A file without a name in this folder, or, where nothing can be written there, in the system's folder for such files.
///
/// # Errors
/// Neither folder can be written to.
pub(crate) fn nameless(folder: &Path) -> io::Result<File> {
    // The folder of a bare file name is empty, and means this one.
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    storage().nameless(folder).or_else(|_| storage().nameless(&std::env::temp_dir()))
}

/// A file to read, if it is one: a pipe would make a program wait without a word.
///
/// # Errors
/// No such file, a folder, a pipe, a device.
pub fn open(path: &Path) -> io::Result<Box<dyn StorageInput>> {
    let kind = fs::metadata(path)?;
    if kind.is_dir() {
        return Err(ErrorKind::IsADirectory.into());
    }
    if !kind.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is no file on a disk but a pipe or a device"));
    }
    storage().open(path)
}

/// All bytes of a file.
///
/// # Errors
/// As for [`open`]; a file of more bytes than memory holds.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let length = fs::metadata(path)?.len();
    super::memory::ensure_free(length).map_err(|error| io::Error::new(ErrorKind::OutOfMemory, error.to_string()))?;
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a file.
///
/// # Errors
/// As for [`read`]; bytes that are not UTF-8, with the place of the first.
pub fn read_to_string(path: &Path) -> io::Result<String> {
    String::from_utf8(read(path)?).map_err(|error| io::Error::new(ErrorKind::InvalidData, error.utf8_error()))
}
