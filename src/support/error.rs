//! Errors of the library by kind: what a program decides by, such as its exit code.
//!
//! Inside, errors are [`anyhow`]'s. The calls that programs make return an [`Error`]. Its kind is that of the outermost
//! cause that has one: a cause marked where it arose ([`OfKind`]), or an error of the system or of a reader.

use std::error::Error as StdError;
use std::io;

use ndarray_npy::{ReadNpyError, ReadNpzError};
use safetensors::SafeTensorError;
use zip::result::ZipError;

/// What kind of thing went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// Options, settings or files that say what cannot be.
    Input,
    /// A file, folder or run that is not there.
    Missing,
    /// A file that is damaged or of another form.
    Corrupt,
    /// A disk that takes no more, too little memory.
    Resources,
    /// A GPU that is not there.
    Device,
    /// The work was asked to stop.
    Interrupted,
    /// The work failed although its input was found sound.
    Failed,
    /// A defect of this library.
    Defect,
}

/// An error with its causes. `{:#}` shows all of them.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(transparent)]
    Input(anyhow::Error),
    #[error(transparent)]
    Missing(anyhow::Error),
    #[error(transparent)]
    Corrupt(anyhow::Error),
    #[error(transparent)]
    Resources(anyhow::Error),
    #[error(transparent)]
    Device(anyhow::Error),
    #[error(transparent)]
    Interrupted(anyhow::Error),
    #[error(transparent)]
    Failed(anyhow::Error),
    #[error(transparent)]
    Defect(anyhow::Error),
}

/// What the calls of the library return.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// An error of a kind.
    pub fn new(kind: ErrorKind, error: impl Into<anyhow::Error>) -> Self {
        let variant = match kind {
            ErrorKind::Input => Error::Input,
            ErrorKind::Missing => Error::Missing,
            ErrorKind::Corrupt => Error::Corrupt,
            ErrorKind::Resources => Error::Resources,
            ErrorKind::Device => Error::Device,
            ErrorKind::Interrupted => Error::Interrupted,
            ErrorKind::Failed => Error::Failed,
            ErrorKind::Defect => Error::Defect,
        };
        variant(error.into())
    }

    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::Input(_) => ErrorKind::Input,
            Error::Missing(_) => ErrorKind::Missing,
            Error::Corrupt(_) => ErrorKind::Corrupt,
            Error::Resources(_) => ErrorKind::Resources,
            Error::Device(_) => ErrorKind::Device,
            Error::Interrupted(_) => ErrorKind::Interrupted,
            Error::Failed(_) => ErrorKind::Failed,
            Error::Defect(_) => ErrorKind::Defect,
        }
    }

    /// An error of work whose input was found sound: no fault of the input.
    pub fn of_work(error: impl Into<anyhow::Error>) -> Self {
        let error = error.into();
        let kind = match kind_of(&error) {
            ErrorKind::Input | ErrorKind::Missing | ErrorKind::Corrupt => ErrorKind::Failed,
            other => other,
        };
        Error::new(kind, error)
    }
}

impl From<anyhow::Error> for Error {
    fn from(error: anyhow::Error) -> Self {
        // An error within a context would lose it.
        if error.chain().next().is_some_and(|outermost| outermost.is::<Error>()) {
            return error.downcast::<Error>().expect("it is the outermost");
        }
        Error::new(kind_of(&error), error)
    }
}

/// A message of several lines, which programs print as they are: a text with a mark under a place in it.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Excerpt(pub String);

/// Marks errors with a kind where they arise. Their messages stay as they are.
pub trait OfKind<T> {
    /// # Errors
    /// The error there is, of this kind.
    fn of_kind(self, kind: ErrorKind) -> anyhow::Result<T>;
}

impl<T, E: Into<anyhow::Error>> OfKind<T> for Result<T, E> {
    fn of_kind(self, kind: ErrorKind) -> anyhow::Result<T> {
        self.map_err(|error| Error::new(kind, error).into())
    }
}

/// Without a typed cause, something was asked for that cannot be.
fn kind_of(error: &anyhow::Error) -> ErrorKind {
    error.chain().find_map(kind_of_cause).unwrap_or(ErrorKind::Input)
}

/// Where a reader only hands on an error of the system, that one decides.
fn kind_of_cause(cause: &(dyn StdError + 'static)) -> Option<ErrorKind> {
    if let Some(error) = cause.downcast_ref::<Error>() {
        return Some(error.kind());
    }
    if let Some(error) = cause.downcast_ref::<io::Error>() {
        return kind_of_system(error.kind());
    }
    let zip = cause.downcast_ref::<ZipError>().is_some_and(|error| !matches!(error, ZipError::Io(_)));
    let npz = cause.downcast_ref::<ReadNpzError>().is_some();
    let npy = cause.downcast_ref::<ReadNpyError>().is_some_and(|error| !matches!(error, ReadNpyError::Io(_)));
    let json = cause.downcast_ref::<serde_json::Error>().is_some_and(|error| !error.is_io());
    let weights = cause.downcast_ref::<SafeTensorError>().is_some();
    (zip || npz || npy || json || weights).then_some(ErrorKind::Corrupt)
}

fn kind_of_system(kind: io::ErrorKind) -> Option<ErrorKind> {
    Some(match kind {
        io::ErrorKind::NotFound => ErrorKind::Missing,
        io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => ErrorKind::Corrupt,
        io::ErrorKind::StorageFull
        | io::ErrorKind::QuotaExceeded
        | io::ErrorKind::WriteZero
        | io::ErrorKind::ReadOnlyFilesystem
        | io::ErrorKind::OutOfMemory => ErrorKind::Resources,
        io::ErrorKind::Interrupted => ErrorKind::Interrupted,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use anyhow::{Context, anyhow};

    use super::*;

    fn kind(error: anyhow::Error) -> ErrorKind {
        Error::from(error).kind()
    }

    #[test]
    fn the_kind_is_that_of_a_typed_cause() {
        let system = |kind: io::ErrorKind| anyhow::Error::from(io::Error::from(kind)).context("cannot write a");
        assert_eq!(kind(system(io::ErrorKind::StorageFull)), ErrorKind::Resources);
        assert_eq!(kind(system(io::ErrorKind::NotFound)), ErrorKind::Missing);
        assert_eq!(kind(system(io::ErrorKind::NotADirectory)), ErrorKind::Input);
        assert_eq!(kind(anyhow!("--jobs must be at least 1")), ErrorKind::Input);
        let json = serde_json::from_str::<u8>("{").context("scores.json is damaged").unwrap_err();
        assert_eq!(kind(json), ErrorKind::Corrupt);
    }

    #[test]
    fn a_mark_keeps_the_message_and_outlasts_contexts() {
        let marked = Err::<(), _>(anyhow!("no GPU").context("device cuda")).of_kind(ErrorKind::Device);
        let error = Error::from(marked.context("run").unwrap_err());
        assert_eq!((format!("{error:#}").as_str(), error.kind()), ("run: device cuda: no GPU", ErrorKind::Device));
        // Through a program and back.
        let error = Error::from(anyhow::Error::from(error));
        assert_eq!((error.to_string().as_str(), error.kind()), ("run", ErrorKind::Device));
    }

    #[test]
    fn work_is_never_refused_as_input() {
        assert_eq!(Error::of_work(anyhow!("the loss is not finite")).kind(), ErrorKind::Failed);
        assert_eq!(Error::of_work(io::Error::from(io::ErrorKind::NotFound)).kind(), ErrorKind::Failed);
        assert_eq!(Error::of_work(io::Error::from(io::ErrorKind::StorageFull)).kind(), ErrorKind::Resources);
        assert_eq!(kind(Error::of_work(anyhow!("the loss is not finite")).into()), ErrorKind::Failed);
    }
}
