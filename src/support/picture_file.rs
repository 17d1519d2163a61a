//! Pictures that users name: PNG, JPEG, GIF.

use std::path::Path;

use anyhow::{Context, Result};
use image::DynamicImage;

use super::storage;

/// Reads a picture file.
///
/// # Errors
/// No such file, a folder, a pipe, a device, no readable picture; the message names the file.
pub fn read(path: &Path) -> Result<DynamicImage> {
    let read = || Ok::<_, anyhow::Error>(image::load_from_memory(&storage::read(path)?)?);
    read().with_context(|| format!("cannot read the picture {}", path.display()))
}
