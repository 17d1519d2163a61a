//! The streams of tests/data, made by make.sh, against what ffmpeg decoded of them.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{decode, difference, parse};

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data")
}

#[test]
fn every_decoder_gives_the_samples_and_times_of_ffmpeg() {
    let mut differing = Vec::new();
    let mut streams = 0;
    for entry in fs::read_dir(data()).unwrap() {
        let list = entry.unwrap().path();
        if list.extension().is_some_and(|it| it == "framemd5") {
            let stream = list.with_extension("");
            let name = stream.file_name().unwrap().to_string_lossy().into_owned();
            if name.starts_with("av1") && !cfg!(feature = "av1") {
                continue;
            }
            let expected = parse(&fs::read_to_string(&list).unwrap());
            let outcome = match decode(&stream) {
                Ok(found) => difference(&found, &expected),
                Err(error) => Some(error.to_string()),
            };
            differing.extend(outcome.map(|how| format!("{name}: {how}")));
            streams += 1;
        }
    }
    assert!(differing.is_empty() && streams > 15, "{streams} streams; {differing:#?}");
}
