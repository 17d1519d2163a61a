//! Answers of the server: files, and refusals in words.

use std::fs;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use axum::Json;
use axum::body::Body;
use axum::http::StatusCode;
use axum::http::header::{CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};
use serde_json::json;
use tokio_util::io::ReaderStream;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// A page that was written for downloading may hold its own pictures and styles, and nothing else.
const PAGE_POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; sandbox";

/// Why a request is refused.
#[derive(Debug)]
pub struct Refusal(pub StatusCode, pub String);

impl<E: Into<anyhow::Error>> From<E> for Refusal {
    fn from(error: E) -> Self {
        Refusal(StatusCode::BAD_REQUEST, format!("{:#}", error.into()))
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.0, Json(json!({ "error": self.1 }))).into_response()
    }
}

pub type Answer = Result<Response, Refusal>;

/// What does not exist.
pub fn missing(error: anyhow::Error) -> Refusal {
    Refusal(StatusCode::NOT_FOUND, format!("{error:#}"))
}

/// A file; to be saved under a name, if one is given.
///
/// # Errors
/// A file that cannot be read.
pub async fn file(path: &Path, save_as: Option<&str>) -> Answer {
    let extension = path.extension().and_then(|it| it.to_str()).unwrap_or_default();
    let kind = match extension {
        "jpg" => "image/jpeg",
        "png" => "image/png",
        "gif" => "image/gif",
        "json" => "application/json",
        "csv" => "text/csv; charset=utf-8",
        "html" => "text/html; charset=utf-8",
        _ => "application/octet-stream",
    };
    let file = tokio::fs::File::open(path).await.map_err(|error| missing(error.into()))?;
    let length = file.metadata().await?.len();
    let mut response = Response::builder().header(CONTENT_TYPE, kind).header(CONTENT_LENGTH, length);
    if extension == "jpg" {
        // Its address holds when the project was made.
        response = response.header(CACHE_CONTROL, "private, max-age=3600");
    }
    if extension == "html" {
        response = response.header(CONTENT_SECURITY_POLICY, PAGE_POLICY);
    }
    if let Some(name) = save_as {
        response = response.header(CONTENT_DISPOSITION, saved_as(name));
    }
    Ok(response.body(Body::from_stream(ReaderStream::new(file)))?)
}

/// A folder as an archive, to be saved under a name.
///
/// # Errors
/// A file that cannot be read.
pub async fn archive(folder: PathBuf, save_as: &str) -> Result<Response> {
    let bytes =
        tokio::task::spawn_blocking(move || zipped(&folder)).await.context("the archive was not finished")??;
    let named = [(CONTENT_TYPE, "application/zip".into()), (CONTENT_DISPOSITION, saved_as(save_as))];
    Ok((named, bytes).into_response())
}

fn saved_as(name: &str) -> String {
    format!("attachment; filename=\"{name}\"")
}

fn zipped(folder: &Path) -> Result<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    add(&mut archive, folder, "").with_context(|| format!("cannot archive {}", folder.display()))?;
    Ok(archive.finish()?.into_inner())
}

/// Adds what a folder holds; links are left out.
fn add(archive: &mut ZipWriter<Cursor<Vec<u8>>>, folder: &Path, within: &str) -> Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let (kind, name) = (entry.file_type()?, format!("{within}{}", entry.file_name().to_string_lossy()));
        if kind.is_dir() {
            add(archive, &entry.path(), &format!("{name}/"))?;
        } else if kind.is_file() {
            archive.start_file(name, SimpleFileOptions::default().large_file(true))?;
            io::copy(&mut fs::File::open(entry.path())?, archive)?;
        }
    }
    Ok(())
}
