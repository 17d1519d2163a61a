//! Uploaded files, streamed to disk.

use std::path::Path;

use anyhow::{Context, anyhow};
use axum::body::Body;
use axum::http::StatusCode;
use http_body_util::BodyExt;
use tokio::fs::{self, File};
use tokio::io::AsyncWriteExt;

use crate::answers::Refusal;

/// Writes a request's body into a new file of at most so many bytes; half a file is never left under its name.
///
/// # Errors
/// A body that is too large or ends early, a full disk.
pub async fn receive(body: Body, path: &Path, limit: u64) -> Result<(), Refusal> {
    let partial = path.with_extension("partial");
    let received = write(body, &partial, limit).await;
    if received.is_err() {
        // It may never have been made.
        let _ = fs::remove_file(&partial).await;
    }
    received?;
    Ok(fs::rename(&partial, path).await?)
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
