//! Rules for outputs: an output replaces only files that this program wrote, and never an input of the same call. `--force` covers
//! the program's own files only. A set of files is replaced as a whole or not at all.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;

use super::storage::{self, storage};
use super::{atomic, guard};

/// A kind of file that the program recognizes as its own.
#[derive(Debug, Clone, Copy)]
pub struct FileKind {
    /// For messages, such as "scores of `paig evaluate`".
    pub name: &'static str,
    pub recognizes: fn(&[u8]) -> bool,
}

impl FileKind {
    /// Checks that a file may be written in this place, also by a trial. Returns the place that links lead to.
    ///
    /// # Errors
    /// A place among the checkpoints of a run, an input of the same call, a file of another kind, a folder, a missing folder or one
    /// that cannot be written.
    pub fn check(&self, path: &Path, inputs: &[&Path]) -> Result<PathBuf> {
        guard::ensure_outside_checkpoints(path)?;
        let place = atomic::target(path)?;
        for input in inputs {
            ensure!(!is_of(&place, input), "{} is an input of this call; choose another file to write", path.display());
        }
        if place.is_file() {
            let bytes = storage::read(&place).with_context(|| format!("cannot read {}", path.display()))?;
            ensure!(
                bytes.is_empty() || (self.recognizes)(&bytes),
                "{} is there already and does not hold {}; choose another file, or move it away",
                path.display(),
                self.name
            );
        }
        atomic::check_place(&place)?;
        Ok(place)
    }
}

/// Files in one folder that are replaced together. Files of other names in the folder stay.
#[derive(Debug, Clone, Copy)]
pub struct FileSet {
    /// For messages, such as "a report".
    pub name: &'static str,
    /// Their names, also of folders. The last is a file: where it is, all are.
    pub files: &'static [&'static str],
    /// Recognizes the last file.
    pub recognizes: fn(&[u8]) -> bool,
}

/// A complete set that is not in its place yet.
const NEW: &str = ".new";

impl FileSet {
    /// Checks that the set may be written into a folder: a new one, or one with an earlier set or with none of its names.
    ///
    /// # Errors
    /// As [`guard::check_folder`]; one of the set's names that this program did not write.
    pub fn check(&self, folder: &Path) -> Result<()> {
        guard::check_folder(folder)?;
        if self.is_complete(folder)? {
            return Ok(());
        }
        let taken = self.files.iter().find(|name| fs::symlink_metadata(folder.join(name)).is_ok());
        if let Some(name) = taken {
            bail!(
                "{} holds {name:?}, which is not of {} by this program; choose another folder",
                folder.display(),
                self.name
            );
        }
        Ok(())
    }

    /// The same for a folder in which the set has many more files: without the last one of the set it holds folders at most.
    ///
    /// # Errors
    /// As for [`FileSet::check`].
    pub fn check_alone(&self, folder: &Path) -> Result<()> {
        self.check(folder)?;
        if !folder.exists() || self.is_complete(folder)? {
            return Ok(());
        }
        for entry in fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
            let entry = entry.with_context(|| format!("cannot list {}", folder.display()))?;
            ensure!(
                entry.path().is_dir() || atomic::is_partial(&entry.file_name()),
                "{} holds {:?}, which is not of {} by this program; choose another folder",
                folder.display(),
                entry.file_name(),
                self.name
            );
        }
        Ok(())
    }

    /// Replaces the set in a folder, which is made where missing: `fill` writes all of it into another folder. Waits for another
    /// program that replaces it now.
    ///
    /// # Errors
    /// As for [`FileSet::check`] and [`atomic::write_folder`].
    pub fn replace(&self, folder: &Path, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
        guard::check_folder(folder)?;
        storage().create_folder(folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let _lock = locked(folder)?;
        self.put_in_place(folder)?;
        self.check(folder)?;
        atomic::write_folder(&folder.join(NEW), fill)?;
        self.put_in_place(folder)
    }

    /// Puts a complete set in its place that a killed process did not.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn settle(&self, folder: &Path) -> Result<()> {
        if !folder.join(NEW).exists() {
            return Ok(());
        }
        let _lock = locked(folder)?;
        self.put_in_place(folder)
    }

    fn put_in_place(&self, folder: &Path) -> Result<()> {
        let new = folder.join(NEW);
        if !new.exists() {
            return Ok(());
        }
        let ours = self.is_complete(&new)? || self.is_complete(folder)?;
        ensure!(ours, "{} is not of {} by this program; choose another folder", new.display(), self.name);
        for name in self.files {
            let (from, to) = (new.join(name), folder.join(name));
            let Ok(described) = fs::symlink_metadata(&from) else { continue };
            let replace = || {
                match fs::symlink_metadata(&to) {
                    Ok(before) if before.is_dir() => storage().remove_folder(&to)?,
                    Ok(_) if described.is_dir() => storage().remove_file(&to)?,
                    _ => {}
                }
                storage().rename(&from, &to)
            };
            replace().with_context(|| format!("cannot write {}", to.display()))?;
        }
        storage().sync(folder).with_context(|| format!("cannot write into {}", folder.display()))?;
        storage().remove_folder(&new).with_context(|| format!("cannot remove {}", new.display()))
    }

    /// Whether a whole set of this program lies in a folder.
    fn is_complete(&self, folder: &Path) -> Result<bool> {
        let mark = self.files.last().expect("a set has files");
        match storage::read(&folder.join(mark)) {
            Ok(bytes) => Ok((self.recognizes)(&bytes)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(false),
            Err(error) => Err(error).with_context(|| format!("cannot read {}", folder.join(mark).display())),
        }
    }
}

/// A folder that no other program replaces a set in as long as the lock is held. File systems without locks have none.
fn locked(folder: &Path) -> Result<File> {
    let lock = File::open(folder).with_context(|| format!("cannot open {}", folder.display()))?;
    let _ = lock.lock();
    Ok(lock)
}

/// Whether a JSON text is an object, or a list of objects, with all of these keys.
pub fn has_keys(bytes: &[u8], keys: &[&str]) -> bool {
    let has = |value: &Value| keys.iter().all(|key| value.get(key).is_some());
    match serde_json::from_slice(bytes) {
        Ok(Value::Array(rows)) => rows.iter().all(has),
        Ok(object) => has(&object),
        Err(_) => false,
    }
}

/// Checks that the outputs of a call are different files, but for devices and pipes.
///
/// # Errors
/// One place for two of them.
pub fn check_apart(outputs: &[&Path]) -> Result<()> {
    let mut taken = Vec::new();
    for output in outputs.iter().filter(|output| !atomic::is_stream(output)) {
        let place = real(output);
        ensure!(
            place.is_none() || !taken.contains(&place),
            "{} is given for two outputs; choose two files",
            output.display()
        );
        taken.push(place);
    }
    Ok(())
}

/// Whether a place, where nothing need be yet, is an input or lies in it.
fn is_of(place: &Path, input: &Path) -> bool {
    real(place).zip(fs::canonicalize(input).ok()).is_some_and(|(place, input)| place.starts_with(input))
}

/// A place without links, where nothing need be yet.
fn real(place: &Path) -> Option<PathBuf> {
    let folder = place.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let there = fs::canonicalize(place)
        .or_else(|_| fs::canonicalize(folder).map(|folder| folder.join(place.file_name().unwrap_or_default())));
    there.ok()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    const SCORES: FileKind = FileKind { name: "scores", recognizes: |bytes| has_keys(bytes, &["run", "scores"]) };
    const SET: FileSet =
        FileSet { name: "a result", files: &["pictures", "page", "mark"], recognizes: |bytes| bytes == b"ours" };

    #[test]
    fn a_file_is_replaced_if_the_program_wrote_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("ours"), r#"{"run": "r", "scores": {}}"#).unwrap();
        fs::write(at("other"), r#"{"run": "r"}"#).unwrap();
        fs::write(at("empty"), "").unwrap();
        symlink("other", at("link")).unwrap();
        symlink("nothing", at("open")).unwrap();
        for name in ["ours", "new", "empty", "open"] {
            SCORES.check(&at(name), &[]).unwrap();
        }
        assert_eq!(SCORES.check(&at("open"), &[]).unwrap(), at("nothing"));
        for name in ["other", "link"] {
            let error = SCORES.check(&at(name), &[]).unwrap_err().to_string();
            assert!(error.contains("does not hold scores"), "{error}");
        }
        let error = SCORES.check(&at("ours"), &[&at("./ours")]).unwrap_err().to_string();
        assert!(error.contains("input of this call"), "{error}");
        let two = |one: &str, other: &str| check_apart(&[&at(one), &at(other)]);
        two("ours", "new").unwrap();
        two("new", "newer").unwrap();
        check_apart(&[Path::new("/dev/null"); 2]).unwrap();
        for (one, other) in [("new", "./new"), ("other", "link"), ("ours", "ours")] {
            assert!(two(one, other).unwrap_err().to_string().contains("two outputs"), "{one} {other}");
        }
        // A file beside the pictures of a folder would be one of them.
        assert!(SCORES.check(&at("new"), &[folder.path()]).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 5, "a trial left something");
    }

    /// What a killed process left complete is put in its place; what is not ours is never replaced.
    #[test]
    fn a_set_is_replaced_as_a_whole() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        let text = |name: &str| fs::read_to_string(folder.join(name)).ok();
        let fill = |page: &'static str| {
            move |new: &Path| {
                fs::create_dir(new.join("pictures"))?;
                fs::write(new.join(format!("pictures/{page}")), "")?;
                fs::write(new.join("page"), page)?;
                Ok(fs::write(new.join("mark"), "ours")?)
            }
        };
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join("page"), "dear diary").unwrap();
        let error = SET.replace(&folder, fill("first")).unwrap_err().to_string();
        assert!(error.contains("\"page\", which is not of a result"), "{error}");
        assert_eq!(text("page").unwrap(), "dear diary");
        fs::rename(folder.join("page"), folder.join("diary")).unwrap();
        SET.replace(&folder, fill("first")).unwrap();
        SET.replace(&folder, |_| bail!("no space")).unwrap_err();
        assert_eq!(text("page").unwrap(), "first");
        atomic::write_folder(&folder.join(NEW), fill("second")).unwrap();
        fs::rename(folder.join(".new/page"), folder.join("page")).unwrap();
        SET.settle(&folder).unwrap();
        assert_eq!(["page", "mark", "diary"].map(text), ["second", "ours", "dear diary"].map(|it| Some(it.into())));
        assert!(folder.join("pictures/second").exists() && !folder.join("pictures/first").exists());
        assert!(!folder.join(NEW).exists());
    }

    /// Each of them finds the others' sets whole, and the last one's stays.
    #[test]
    fn sets_replaced_at_once_stay_whole() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("out");
        let replace = |number: usize| {
            SET.replace(&folder, |new| {
                fs::create_dir(new.join("pictures"))?;
                fs::write(new.join(format!("pictures/{number}")), "")?;
                fs::write(new.join("page"), number.to_string())?;
                Ok(fs::write(new.join("mark"), "ours")?)
            })
        };
        std::thread::scope(|scope| {
            let all: Vec<_> =
                (0..8).map(|number| scope.spawn(move || (0..5).try_for_each(|_| replace(number)))).collect();
            all.into_iter().for_each(|one| one.join().unwrap().unwrap());
        });
        let page = fs::read_to_string(folder.join("page")).unwrap();
        let pictures: Vec<_> =
            fs::read_dir(folder.join("pictures")).unwrap().map(|it| it.unwrap().file_name()).collect();
        assert_eq!(pictures, [page.as_str()]);
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 3);
    }
}
