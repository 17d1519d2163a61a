//! Any bytes as a video: containers, codecs, gifs and archives. A panic of this project ends the process; one of a foreign
//! decoder has to become an error.

#![no_main]

use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use paig_decode::VideoFile;

/// Larger frames are opened and not decoded: a few bytes can ask for seconds of work.
const MOST_PIXELS: u32 = 1 << 16;
const MOST_FRAMES: usize = 12;

static PATH: OnceLock<PathBuf> = OnceLock::new();

fn prepare() {
    // Only panics that are not caught reach libFuzzer's hook.
    paig_decode::quiet_decoders();
    let caught = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        caught(panic);
        if panic.location().is_some_and(|location| location.file().contains("crates/decode")) {
            eprintln!("{panic}");
            std::process::abort();
        }
    }));
    let folder = if PathBuf::from("/dev/shm").is_dir() { "/dev/shm".into() } else { std::env::temp_dir() };
    let path = folder.join(format!("paig-fuzz-{}", std::process::id()));
    PATH.set(path).expect("it is set once");
}

fuzz_target!(init: prepare(), |bytes: &[u8]| {
    let path = PATH.get().expect("prepare() ran");
    fs::write(path, bytes).expect("the folder can be written");
    let Ok(video) = VideoFile::open_built_in(path) else { return };
    let (width, height) = video.info().size;
    if width.saturating_mul(height) > MOST_PIXELS {
        return;
    }
    let middle = video.info().frames / 2;
    for first in [0, middle] {
        let Ok(frames) = video.frames_from(first) else { return };
        for frame in frames.take(MOST_FRAMES) {
            let Ok(frame) = frame else { break };
            assert_eq!(frame.rgb().dimensions(), frame.size(), "a frame's samples and its size");
        }
    }
});
