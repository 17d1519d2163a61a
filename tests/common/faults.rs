//! A storage that fails, tears or stops at an operation of its choice.
//!
//! What had not been synced when it stops is lost in part, as after a power cut: files are cut to half of what was written
//! since, and a rename whose folder was not synced is taken back.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use paig::support::storage::{FileSystem, Storage, StorageInput, StorageOutput};

/// What happens at the operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The disk is full, once.
    NoSpace,
    /// Half of what is to be written is, then nothing works any more.
    Tear,
    /// The machine stops before it, and what was not synced is lost.
    PowerCut,
}

pub const FAULTS: [Fault; 3] = [Fault::NoSpace, Fault::Tear, Fault::PowerCut];

/// Counts operations and fails at one of them.
#[derive(Debug, Clone)]
pub struct FaultyStorage(Arc<Mutex<FaultState>>);

#[derive(Debug)]
struct FaultState {
    fault: Fault,
    /// The operation that fails, from 1 on; 0 for none.
    at: u64,
    done: u64,
    stopped: bool,
    /// Length of each file when it was last synced.
    unsynced: BTreeMap<PathBuf, u64>,
    /// Moves whose folder was not synced.
    moves: Vec<Move>,
}

/// A change of names.
#[derive(Debug)]
enum Move {
    Renamed { from: PathBuf, to: PathBuf, replaced: Option<Vec<u8>> },
    Exchanged(PathBuf, PathBuf),
}

impl Move {
    /// The folder that must be synced for it to last.
    fn folder(&self) -> Option<&Path> {
        let (Move::Renamed { to, .. } | Move::Exchanged(_, to)) = self;
        to.parent()
    }

    fn undo(self) {
        match self {
            Move::Renamed { from, to, replaced } => {
                if fs::rename(&to, &from).is_ok()
                    && let Some(bytes) = replaced
                {
                    fs::write(&to, bytes).unwrap();
                }
            }
            Move::Exchanged(one, other) => FileSystem.exchange(&one, &other).unwrap(),
        }
    }
}

impl FaultyStorage {
    pub fn new(fault: Fault, at: u64) -> Self {
        let state = FaultState { fault, at, done: 0, stopped: false, unsynced: BTreeMap::new(), moves: Vec::new() };
        FaultyStorage(Arc::new(Mutex::new(state)))
    }

    /// Whether the fault has come.
    pub fn struck(&self) -> bool {
        let state = self.0.lock().unwrap();
        state.at > 0 && state.done >= state.at
    }

    /// Counts an operation; `tear` does half of it.
    fn before(&self, tear: impl FnOnce()) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        state.done += 1;
        if state.stopped {
            return Err(io::Error::other("the machine has stopped"));
        }
        if state.done != state.at {
            return Ok(());
        }
        match state.fault {
            Fault::NoSpace => return Err(ErrorKind::StorageFull.into()),
            Fault::Tear => tear(),
            Fault::PowerCut => state.lose(),
        }
        state.stopped = true;
        Err(io::Error::other("the machine has stopped"))
    }
}

impl FaultState {
    fn lose(&mut self) {
        for (path, synced) in &self.unsynced {
            if let Ok(file) = fs::OpenOptions::new().write(true).open(path) {
                let length = file.metadata().unwrap().len();
                file.set_len((*synced).max(synced + length.saturating_sub(*synced) / 2)).unwrap();
            }
        }
        self.moves.drain(..).rev().for_each(Move::undo);
    }
}

#[derive(Debug)]
struct FaultyFile {
    inner: Box<dyn StorageOutput>,
    storage: FaultyStorage,
}

impl Write for FaultyFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let storage = self.storage.clone();
        storage.before(|| drop(self.inner.write(&bytes[..bytes.len() / 2])))?;
        self.inner.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl Seek for FaultyFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

impl StorageOutput for FaultyFile {
    fn length(&self) -> io::Result<u64> {
        self.inner.length()
    }
}

#[derive(Debug)]
struct FaultySource(Box<dyn StorageInput>);

impl Read for FaultySource {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.0.read(bytes)
    }
}

impl Seek for FaultySource {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.seek(to)
    }
}

impl StorageInput for FaultySource {}

impl Storage for FaultyStorage {
    fn create(&self, path: &Path) -> io::Result<Box<dyn StorageOutput>> {
        self.before(|| ())?;
        self.0.lock().unwrap().unsynced.insert(path.into(), 0);
        Ok(Box::new(FaultyFile { inner: FileSystem.create(path)?, storage: self.clone() }))
    }

    fn append(&self, path: &Path) -> io::Result<Box<dyn StorageOutput>> {
        self.before(|| ())?;
        let inner = FileSystem.append(path)?;
        let length = inner.length()?;
        self.0.lock().unwrap().unsynced.entry(path.into()).or_insert(length);
        Ok(Box::new(FaultyFile { inner, storage: self.clone() }))
    }

    fn nameless(&self, folder: &Path) -> io::Result<fs::File> {
        self.before(|| ())?;
        FileSystem.nameless(folder)
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn StorageInput>> {
        self.before(|| ())?;
        Ok(Box::new(FaultySource(FileSystem.open(path)?)))
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        self.before(|| ())?;
        let mut state = self.0.lock().unwrap();
        if path.is_dir() {
            state.moves.retain(|moved| moved.folder() != Some(path));
        } else if let Some(length) = state.unsynced.get_mut(path) {
            // What is appended later is not synced again by this.
            *length = fs::metadata(path)?.len();
        }
        drop(state);
        FileSystem.sync(path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.before(|| ())?;
        let replaced = fs::read(to).ok();
        FileSystem.rename(from, to)?;
        let mut state = self.0.lock().unwrap();
        state.unsynced = std::mem::take(&mut state.unsynced)
            .into_iter()
            .filter(|(path, _)| path != from && !path.starts_with(from))
            .collect();
        state.moves.push(Move::Renamed { from: from.into(), to: to.into(), replaced });
        Ok(())
    }

    fn exchange(&self, one: &Path, other: &Path) -> io::Result<()> {
        self.before(|| ())?;
        FileSystem.exchange(one, other)?;
        let mut state = self.0.lock().unwrap();
        state.unsynced.retain(|path, _| !path.starts_with(one) && !path.starts_with(other));
        state.moves.push(Move::Exchanged(one.into(), other.into()));
        Ok(())
    }

    fn link(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.before(|| ())?;
        FileSystem.link(from, to)
    }

    fn remove_file(&self, path: &Path) -> io::Result<()> {
        self.before(|| ())?;
        FileSystem.remove_file(path)
    }

    fn remove_folder(&self, path: &Path) -> io::Result<()> {
        self.before(|| {
            // Half of what is in it is gone.
            let entries: Vec<_> = fs::read_dir(path).into_iter().flatten().flatten().collect();
            for entry in entries.iter().take(entries.len().div_ceil(2)) {
                drop(fs::remove_file(entry.path()));
            }
        })?;
        FileSystem.remove_folder(path)
    }

    fn create_folder(&self, path: &Path) -> io::Result<()> {
        self.before(|| ())?;
        FileSystem.create_folder(path)
    }

    fn shorten(&self, path: &Path, length: u64) -> io::Result<()> {
        self.before(|| ())?;
        FileSystem.shorten(path, length)
    }
}

/// What became of trying every operation.
#[derive(Debug, Default)]
pub struct FaultTrials {
    pub faults: u64,
}

/// Does something with a fault at its first operation, its second, and so on until it ends well, with each kind of fault.
/// `prepare` makes what it starts from; `check` looks at what is left after the fault (whether the work said it failed).
pub fn at_every_operation<T>(
    stride: u64,
    prepare: impl Fn() -> T,
    work: impl Fn(&T) -> anyhow::Result<()>,
    check: impl Fn(&T, Fault, u64),
) -> FaultTrials {
    let tried = RefCell::new(FaultTrials::default());
    for fault in FAULTS {
        let before = tried.borrow().faults;
        let mut at = 1;
        loop {
            let place = prepare();
            let storage = FaultyStorage::new(fault, at);
            let done = paig::support::storage::with(std::rc::Rc::new(storage.clone()), || work(&place));
            if !storage.struck() {
                done.unwrap_or_else(|error| panic!("without a fault it failed: {error:#}"));
                break;
            }
            tried.borrow_mut().faults += 1;
            check(&place, fault, at);
            at += stride;
        }
        assert!(tried.borrow().faults > before, "{fault:?} struck nothing");
    }
    tried.into_inner()
}
