//! The one function through which a path is opened.

use std::fs::{self, File, FileType, OpenOptions};
use std::io;
use std::path::Path;

use crate::error::{DecodeError, Result};

/// Opens a regular file for reading, and never blocks.
///
/// # Errors
/// [`DecodeError::NotAFile`] for a FIFO, device, socket, folder or a link to nothing; [`DecodeError::Io`] where the system refuses.
pub fn open_regular(path: &Path) -> Result<File> {
    let described = match fs::metadata(path) {
        Ok(described) => described,
        Err(error) if error.kind() == io::ErrorKind::NotFound && fs::symlink_metadata(path).is_ok() => {
            return Err(DecodeError::NotAFile { found: "a link to nothing" });
        }
        Err(error) => return Err(error.into()),
    };
    check(described.file_type())?;
    let mut options = OpenOptions::new();
    options.read(true);
    // The path may have become a FIFO since: opening one blocks without this flag.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK | libc::O_CLOEXEC);
    let file = options.open(path)?;
    check(file.metadata()?.file_type())?;
    Ok(file)
}

fn check(kind: FileType) -> Result<()> {
    if kind.is_file() {
        return Ok(());
    }
    Err(DecodeError::NotAFile { found: if kind.is_dir() { "a folder" } else { special(kind) } })
}

#[cfg(unix)]
fn special(kind: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match () {
        () if kind.is_fifo() => "a FIFO",
        () if kind.is_char_device() || kind.is_block_device() => "a device",
        () if kind.is_socket() => "a socket",
        () => "a special file",
    }
}

#[cfg(not(unix))]
fn special(_: FileType) -> &'static str {
    "a special file"
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;
    use std::os::unix::net::UnixListener;
    use std::process::Command;

    #[test]
    fn only_regular_files_are_opened_and_none_blocks() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "bytes").unwrap();
        symlink(at("file"), at("link")).unwrap();
        assert!(open_regular(&at("file")).is_ok() && open_regular(&at("link")).is_ok());
        symlink(at("nothing"), at("dangling")).unwrap();
        fs::create_dir(at("folder")).unwrap();
        let _socket = UnixListener::bind(at("socket")).unwrap();
        let mut cases = vec![("dangling", "a link to nothing"), ("folder", "a folder"), ("socket", "a socket")];
        if Command::new("mkfifo").arg(at("fifo")).status().is_ok_and(|status| status.success()) {
            cases.push(("fifo", "a FIFO"));
        }
        for (name, expected) in cases {
            let Err(DecodeError::NotAFile { found }) = open_regular(&at(name)) else { panic!("{name} was opened") };
            assert_eq!(found, expected);
        }
        assert!(matches!(open_regular(Path::new("/dev/zero")), Err(DecodeError::NotAFile { found: "a device" })));
        assert!(matches!(open_regular(&at("absent")), Err(DecodeError::Io(_))));
    }
}
