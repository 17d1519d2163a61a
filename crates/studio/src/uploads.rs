//! Uploaded files, streamed to disk.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use axum::body::Body;
use axum::http::StatusCode;
use http_body_util::BodyExt;
use paig::support::atomic;
use tokio::fs::{self, File};
use tokio::io::AsyncWriteExt;

use crate::answers::Refusal;

/// A file that is removed unless it got its name.
struct HalfWritten(PathBuf);

impl Drop for HalfWritten {
    /// Also where the request's task is dropped with its connection.
    fn drop(&mut self) {
        // It may never have been made, or have its name already.
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Writes a request's body into a new file of at most so many bytes; half a file is never left under its name. The last one of
/// several that arrive together stays.
///
/// # Errors
/// A body that is too large or ends early, a full disk.
pub async fn receive(body: Body, path: &Path, limit: u64) -> Result<(), Refusal> {
    atomic::remove_leftovers(path);
    let partial = HalfWritten(atomic::partial_name(path));
    write(body, &partial.0, limit).await?;
    Ok(fs::rename(&partial.0, path).await?)
}

async fn write(mut body: Body, path: &Path, limit: u64) -> Result<(), Refusal> {
    let named = || format!("cannot write {}", path.display());
    let mut file = File::create(path).await.with_context(named)?;
    let mut length = 0;
    while let Some(frame) = body.frame().await {
        let frame = frame.map_err(|error| anyhow!("the upload ended early: {error}"))?;
        let Ok(bytes) = frame.into_data() else { continue };
        length += bytes.len() as u64;
        if length > limit {
            let megabytes = limit / 1_000_000;
            let words =
                format!("the file is larger than {megabytes} MB; start `paig studio` with a larger --upload-limit");
            return Err(Refusal(StatusCode::PAYLOAD_TOO_LARGE, words));
        }
        file.write_all(&bytes).await.with_context(named)?;
    }
    file.sync_all().await.with_context(named)?;
    Ok(())
}
