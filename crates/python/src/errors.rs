//! Errors of the library as exceptions of `paig.errors`.

use paig::{Error, ErrorKind};
use paig_terminal::ending::text;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

/// The exception of an error, by its kind; its text has all causes.
pub fn raised(py: Python, error: anyhow::Error) -> PyErr {
    let message = text(&error);
    let name = match Error::from(error).kind() {
        ErrorKind::Input => "InputError",
        ErrorKind::Missing => "MissingError",
        ErrorKind::Corrupt => "CorruptError",
        ErrorKind::Resources => "ResourcesError",
        ErrorKind::Device => "DeviceError",
        ErrorKind::Failed => "FailedError",
        ErrorKind::Defect => "DefectError",
        ErrorKind::Interrupted => return PyKeyboardInterrupt::new_err(message),
    };
    let class = py.import("paig.errors").and_then(|errors| errors.getattr(name));
    class.and_then(|class| class.call1((message,))).map_or_else(|error| error, PyErr::from_value)
}
