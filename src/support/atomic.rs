//! Files and folders that appear whole or not at all: written beside their place, synced, then renamed.
//!
//! A link in a file's place is replaced itself; [`target`] follows one that a user names. A device or a pipe is written to as it is.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::{Context, Result, ensure};

use super::storage::{StorageOutput, storage};

/// What a file is filled through.
pub type FileWriter = BufWriter<Box<dyn StorageOutput>>;

/// Bytes that are written at a time.
const CHUNK: usize = 1 << 18;
/// Links behind links.
const MOST_LINKS: usize = 40;
/// Bytes of the longest name on Linux file systems, and room in it for the ending of what is half-written.
const LONGEST_NAME: usize = 255;
const PARTIAL_ENDING: usize = 55;
const PARTIAL: &str = "partial";

/// Writes a file in one step; what stood there before stays until the new one is complete.
///
/// # Errors
/// A full disk, a missing folder, a folder in the file's place; nothing is left behind then.
pub fn write_file(path: &Path, write: impl FnOnce(&mut FileWriter) -> Result<()>) -> Result<()> {
    let write = |place: &Path| -> Result<()> {
        let mut file = BufWriter::with_capacity(CHUNK, storage().create(place)?);
        let written = write(&mut file).and_then(|()| Ok(file.flush()?));
        // What is left in the buffer after an error must not be tried again.
        drop(file.into_parts());
        written
    };
    let attempt = || -> Result<()> {
        if is_stream_itself(path) {
            return write(path);
        }
        ensure!(path.is_symlink() || !path.is_dir(), "a folder is there");
        let partial = partial_name(path);
        let replace = || -> Result<()> {
            write(&partial)?;
            storage().sync(&partial)?;
            storage().rename(&partial, path)?;
            sync_folder(path)
        };
        remove_leftovers(path);
        replace().inspect_err(|_| drop(storage().remove_file(&partial)))
    };
    attempt().with_context(|| format!("cannot write {}", path.display()))
}

/// Fills a new folder in one step. A folder of that name must not exist yet, or be empty.
///
/// # Errors
/// As for [`write_file`].
pub fn write_folder(path: &Path, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let partial = partial_name(path);
    let attempt = || -> Result<()> {
        fill_partial(path, &partial, fill)?;
        storage().rename(&partial, path)?;
        sync_folder(path)
    };
    attempt()
        .inspect_err(|_| drop(storage().remove_folder(&partial)))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Replaces a folder in one step: `fill` makes the new one, into which everything of the old one goes that `drops` does not
/// name. Until then the old one stays as it is.
///
/// # Errors
/// As for [`write_file`]; the working directory; a file system without hard links or on which nothing can be exchanged.
pub fn replace_folder(
    path: &Path,
    drops: &dyn Fn(&OsStr) -> bool,
    fill: impl FnOnce(&Path) -> Result<()>,
) -> Result<()> {
    let attempt = || -> Result<()> {
        let place = fs::canonicalize(path)?;
        let inside = std::env::current_dir().and_then(fs::canonicalize).is_ok_and(|here| here.starts_with(&place));
        ensure!(!inside, "the program runs in this folder, which is replaced as a whole; call it from another one");
        let partial = partial_name(&place);
        let attempt = || -> Result<()> {
            fill_partial(&place, &partial, fill)?;
            carry_over(&place, &partial, &|name| drops(name) || is_partial(name))?;
            storage().sync(&partial)?;
            storage()
                .exchange(&partial, &place)
                .context("its file system cannot exchange folders; choose another one")?;
            sync_folder(&place)
        };
        let replaced = attempt();
        // The old folder, or the new one where it failed. A second time where it fails once.
        let _ = storage().remove_folder(&partial).or_else(|_| storage().remove_folder(&partial));
        replaced
    };
    attempt().with_context(|| format!("cannot replace {}", path.display()))
}

/// Fills a folder beside its place, to the disk.
fn fill_partial(path: &Path, partial: &Path, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    remove_leftovers(path);
    if partial.exists() {
        storage().remove_folder(partial)?;
    }
    storage().create_folder(partial)?;
    fill(partial)?;
    for entry in fs::read_dir(partial)? {
        storage().sync(&entry?.path())?;
    }
    Ok(storage().sync(partial)?)
}

/// Gives the files of a folder, but for those that stay behind, their names in another one, too.
fn carry_over(from: &Path, to: &Path, stays: &dyn Fn(&OsStr) -> bool) -> Result<()> {
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let name = entry.file_name();
        if stays(&name) {
            continue;
        }
        let (old, new) = (entry.path(), to.join(&name));
        if entry.file_type()?.is_dir() {
            storage().create_folder(&new)?;
            fs::set_permissions(&new, fs::metadata(&old)?.permissions())?;
            carry_over(&old, &new, &|_| false)?;
            storage().sync(&new)?;
        } else {
            storage().link(&old, &new).with_context(|| format!("cannot carry {} over; move it away", old.display()))?;
        }
    }
    Ok(())
}

/// Tries whether a file could be written: what takes long should not fail at its end.
///
/// # Errors
/// A missing folder or one that cannot be written, a folder in the file's place, a name that is too long.
pub fn check_place(path: &Path) -> Result<()> {
    try_place(path).with_context(|| format!("cannot write {}", path.display()))
}

/// The same with the reason alone as the error.
pub(super) fn try_place(path: &Path) -> Result<()> {
    ensure!(path.is_symlink() || !path.is_dir(), "a folder is there");
    if is_stream_itself(path) {
        return Ok(());
    }
    // The half-written file's name is cut, this one is not.
    match fs::symlink_metadata(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error.into()),
        _ => {}
    }
    let partial = partial_name(path);
    storage().create(&partial)?;
    // A second time where it fails once: nothing is to be left behind.
    Ok(storage().remove_file(&partial).or_else(|_| storage().remove_file(&partial))?)
}

/// Removes what processes that are gone left half-written in a folder.
pub(crate) fn remove_partials(folder: &Path) {
    remove_abandoned(folder, |_| true);
}

/// Whether a name is that of something half-written.
pub fn is_partial(name: &OsStr) -> bool {
    Path::new(name).extension().is_some_and(|extension| extension == PARTIAL)
}

/// Removes what processes that are gone left half-written of a file or folder.
pub fn remove_leftovers(path: &Path) {
    let (folder, name) = (path.parent().unwrap_or(Path::new("")), path.file_name().unwrap_or_default());
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let name = beginning(name);
    remove_abandoned(folder, |file| file == name);
}

/// Removes half-written files and folders whose process is gone, of the final names that are meant. What cannot be
/// listed or removed is in nobody's way.
fn remove_abandoned(folder: &Path, meant: impl Fn(&OsStr) -> bool) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let (name, path) = (entry.file_name(), entry.path());
        let Some((file, process)) = name.to_str().and_then(split_partial) else { continue };
        if !meant(OsStr::new(file)) || Path::new("/proc").join(process.to_string()).exists() {
            continue;
        }
        let _ = if path.is_dir() { storage().remove_folder(&path) } else { storage().remove_file(&path) };
    }
}

/// The final name and the process of `NAME.PROCESS-COUNT.partial`.
fn split_partial(name: &str) -> Option<(&str, u32)> {
    let (file, writer) = name.strip_suffix(PARTIAL)?.strip_suffix('.')?.rsplit_once('.')?;
    let process = writer.split_once('-').map_or(writer, |(process, _)| process);
    Some((file, process.parse().ok()?))
}

/// A new name beside a place, for what is written there: no two writes share one.
pub fn partial_name(path: &Path) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let mut name = beginning(path.file_name().unwrap_or_default());
    name.push(format!(".{}-{count}.{PARTIAL}", std::process::id()));
    path.with_file_name(name)
}

/// What stands of a name in that of its half-written file.
fn beginning(name: &OsStr) -> OsString {
    if name.len() > LONGEST_NAME - PARTIAL_ENDING { named_after(name, "", PARTIAL_ENDING).into() } else { name.into() }
}

/// A name as long as file systems take: this one with an ending, its end cut off where both, with so many bytes of `room`, would
/// be too long.
pub fn named_after(name: &OsStr, ending: &str, room: usize) -> String {
    let name = name.to_string_lossy();
    let most = LONGEST_NAME.saturating_sub(ending.len() + room);
    let end = (0..=most.min(name.len())).rfind(|end| name.is_char_boundary(*end)).unwrap_or(0);
    format!("{}{ending}", &name[..end])
}

/// Where a path leads, through links, also to what is not there yet.
///
/// # Errors
/// Links that lead in a circle.
pub fn target(path: &Path) -> Result<PathBuf> {
    let mut target = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        match fs::read_link(&target) {
            Ok(next) => target = target.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(target),
        }
    }
    anyhow::bail!("cannot write {}: its links lead in a circle", path.display())
}

/// Whether something is there that is neither a file nor a folder: a device, a pipe.
pub fn is_stream(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|kind| !kind.is_file() && !kind.is_dir())
}

/// The same without following a link.
fn is_stream_itself(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|kind| !kind.is_file() && !kind.is_dir() && !kind.is_symlink())
}

/// Makes a rename last through a power cut.
fn sync_folder(path: &Path) -> Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        storage().sync(folder)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    fn write(path: &Path, text: &str) -> Result<()> {
        write_file(path, |file| Ok(file.write_all(text.as_bytes())?))
    }

    #[test]
    fn links_are_replaced_or_followed_and_devices_stay() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link, new, device] = ["file", "link", "new", "device"].map(|name| folder.path().join(name));
        fs::write(&file, "before").unwrap();
        symlink("file", &link).unwrap();
        write(&target(&link).unwrap(), "after").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&file).unwrap(), "after");
        fs::remove_file(&file).unwrap();
        write(&target(&link).unwrap(), "again").unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "again");
        write(&link, "own").unwrap();
        assert!(!link.is_symlink());
        assert_eq!([&file, &link].map(|path| fs::read_to_string(path).unwrap()), ["again", "own"]);
        symlink("/dev/full", &device).unwrap();
        assert!(format!("{:#}", write(&target(&device).unwrap(), "much").unwrap_err()).contains("No space left"));
        assert!(device.is_symlink() && !fs::metadata("/dev/full").unwrap().is_file());
        symlink("new", &new).unwrap();
        assert!(format!("{:#}", target(&new).unwrap_err()).contains("circle"));
        assert!(format!("{:#}", write(folder.path(), "").unwrap_err()).contains("a folder is there"));
    }

    #[test]
    fn a_folder_is_replaced_with_what_others_have_in_it() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("folder");
        fs::create_dir_all(folder.join("notes/more")).unwrap();
        fs::write(place.path().join("outside"), "mine").unwrap();
        symlink("../outside", folder.join("film")).unwrap();
        for (name, text) in [("task", "old"), ("notes/more/diary", "dear"), ("stale", "old")] {
            fs::write(folder.join(name), text).unwrap();
        }
        let drops = |name: &OsStr| name == "task" || name == "film" || name == "stale";
        let fails = replace_folder(&folder, &drops, |new| {
            fs::write(new.join("task"), "half")?;
            anyhow::bail!("no space")
        });
        assert!(fails.is_err());
        assert_eq!(fs::read_to_string(folder.join("task")).unwrap(), "old");
        replace_folder(&folder, &drops, |new| {
            fs::write(new.join("task"), "new")?;
            Ok(fs::write(new.join("film"), "new")?)
        })
        .unwrap();
        let text = |name: &str| fs::read_to_string(folder.join(name)).ok();
        assert_eq!(["task", "film"].map(text), [Some("new".into()), Some("new".into())]);
        assert_eq!((text("notes/more/diary"), text("stale")), (Some("dear".into()), None));
        assert_eq!(fs::read_to_string(place.path().join("outside")).unwrap(), "mine");
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 2, "something half-written was left");
    }

    #[test]
    fn what_a_dead_process_left_goes_and_what_a_living_one_writes_stays() {
        let folder = tempfile::tempdir().unwrap();
        // No process has a number as large as the kernel's limit of them (4194304).
        let (dead, other, living) = ("a.4194305-7.partial", "b.4194305.partial", format!("a.{}-0.partial", 1));
        for name in [dead, other, &living] {
            fs::write(folder.path().join(name), "half").unwrap();
        }
        write(&folder.path().join("a"), "whole").unwrap();
        let there = |name: &str| folder.path().join(name).exists();
        assert_eq!([there("a"), there(dead), there(other), there(&living)], [true, false, true, true]);
        remove_partials(folder.path());
        assert_eq!([there(other), there(&living)], [false, true]);
        assert!(is_partial(OsStr::new(dead)) && !is_partial(OsStr::new("a")));
    }

    #[test]
    fn names_may_be_as_long_as_the_file_system_takes() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let longest = "é".repeat(127) + "x";
        check_place(&at(&longest)).unwrap();
        write(&at(&longest), "whole").unwrap();
        let dead = PathBuf::from(format!("{}.4194305-7.partial", beginning(longest.as_ref()).display()));
        fs::write(folder.path().join(&dead), "half").unwrap();
        write(&at(&longest), "again").unwrap();
        assert!(!folder.path().join(dead).exists());
        let error = format!("{:#}", check_place(&at(&(longest.clone() + "x"))).unwrap_err());
        assert!(error.contains("name too long"), "{error}");
        assert_eq!(named_after(longest.as_ref(), "-measurement", 0), "é".repeat(121) + "-measurement");
        assert_eq!(named_after("a".as_ref(), "-measurement", 0), "a-measurement");
    }

    #[test]
    fn threads_that_write_one_file_leave_it_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let texts: Vec<_> = (0..8).map(|number| number.to_string().repeat(1000 * (number + 1))).collect();
        std::thread::scope(|scope| {
            for text in &texts {
                scope.spawn(|| (0..20).for_each(|_| write(&path, text).unwrap()));
            }
        });
        assert!(texts.contains(&fs::read_to_string(&path).unwrap()));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "something half-written was left");
    }
}
