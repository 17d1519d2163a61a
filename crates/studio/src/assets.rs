//! The page's files, which the program holds.

use axum::http::header::{CONTENT_TYPE, HeaderValue};
use axum::response::{IntoResponse, Response};

macro_rules! page {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("../page/", $name)))),*]
    };
}

const FILES: [(&str, &str); 14] = page![
    "index.html",
    "style.css",
    "icon.svg",
    "main.js",
    "api.js",
    "dom.js",
    "home.js",
    "project.js",
    "stage.js",
    "timeline.js",
    "setup.js",
    "result.js",
    "learn.js",
    "charts.js",
];

/// A file of the page by its name; none of an unknown one.
pub fn asset(name: &str) -> Option<Response> {
    let (_, text) = FILES.iter().find(|(file, _)| *file == name)?;
    let kind = match name.rsplit_once('.').map(|(_, extension)| extension) {
        Some("html") => "text/html; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        _ => "text/javascript; charset=utf-8",
    };
    Some(([(CONTENT_TYPE, HeaderValue::from_static(kind))], *text).into_response())
}
