//! Damaged streams end in an error, or in frames: never in a panic of this crate, a hang, or unbounded memory.

use std::fs;
use std::panic::{PanicHookInfo, set_hook, take_hook};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use paig_decode::VideoFile;
use proptest::prelude::*;

/// Damaged copies of each stream; more by the environment variable `DAMAGED_COPIES`.
const COPIES: u64 = 12;
/// Most memory of the process, KiB: a few frames of the largest size that is read.
const MOST_MEMORY: u64 = 3 << 20;
/// Panics in this crate itself, whose sources have relative paths; those of foreign decoders become errors.
static PANICS: AtomicUsize = AtomicUsize::new(0);
static HOOK: Mutex<bool> = Mutex::new(false);

fn count_own_panics() {
    let mut is_set = HOOK.lock().unwrap();
    if !std::mem::replace(&mut *is_set, true) {
        let usual = take_hook();
        set_hook(Box::new(move |panic: &PanicHookInfo| {
            let is_foreign = panic.location().is_none_or(|location| !location.file().starts_with("src/"));
            if !is_foreign {
                PANICS.fetch_add(1, Ordering::SeqCst);
            }
            let name = std::thread::current().name().map(str::to_string);
            if !is_foreign || !matches!(name.as_deref(), Some("decoder")) {
                usual(panic);
            }
        }));
    }
}

/// Decodes what can be decoded; how many frames came.
fn decode(path: &Path) -> usize {
    let Ok(video) = VideoFile::open_built_in(path) else { return 0 };
    let Ok(frames) = video.frames() else { return 0 };
    let mut count = 0;
    for frame in frames {
        match frame {
            Ok(frame) => {
                let (width, height) = frame.size();
                assert_eq!(frame.rgb().dimensions(), (width, height));
                count += 1;
            }
            Err(_) => break,
        }
    }
    count
}

fn streams() -> Vec<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let paths = fs::read_dir(data).unwrap().map(|entry| entry.unwrap().path());
    let mut streams: Vec<_> =
        paths.filter(|path| !path.extension().is_some_and(|it| it == "framemd5" || it == "sh")).collect();
    streams.sort();
    streams
}

/// Pseudo-random numbers (Numerical Recipes' generator).
struct Congruential(u64);

impl Congruential {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end.max(1)
    }
}

#[test]
fn damaged_streams_end_without_a_panic_of_this_crate() {
    count_own_panics();
    let copies = std::env::var("DAMAGED_COPIES").ok().and_then(|count| count.parse().ok()).unwrap_or(COPIES);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged");
    let (mut whole, mut some) = (0, 0);
    for stream in streams() {
        let intact = fs::read(&stream).unwrap();
        for seed in 0..copies {
            let mut random = Congruential(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) + intact.len() as u64);
            let mut damaged = intact.clone();
            match seed % 4 {
                0 => damaged.truncate(random.below(intact.len())),
                // Headers lie at the beginning or at the end.
                kind => {
                    for _ in 0..=random.below(4) {
                        let near = random.below(intact.len().min(1500));
                        let at = [0, random.below(intact.len()), near, intact.len() - 1 - near][kind as usize];
                        damaged[at] ^= 1 << random.below(8);
                    }
                }
            }
            fs::write(&path, damaged).unwrap();
            match decode(&path) {
                0 => {}
                _ => some += 1,
            }
            whole += 1;
            assert_eq!(PANICS.load(Ordering::SeqCst), 0, "{} with seed {seed}", stream.display());
        }
    }
    println!("{whole} damaged files, {some} of which gave frames");
    if let Some(peak) = peak_memory() {
        println!("peak memory {peak} KiB");
        assert!(peak < MOST_MEMORY, "{peak} KiB");
    }
}

/// Peak of the process's memory, KiB, where the system tells it.
fn peak_memory() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse().ok()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Any bytes after the first ones of each container.
    #[test]
    fn any_bytes_are_refused_without_a_panic(kind in 0usize..4, bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        count_own_panics();
        let first: [&[u8]; 4] = [
            b"\0\0\0\x10ftypisom\0\0\0\0",
            b"\x1a\x45\xdf\xa3\x80\x18\x53\x80\x67\x01\xff\xff\xff\xff\xff\xff\xff",
            b"RIFF\xff\xff\0\0AVI ",
            b"GIF89a\x08\0\x08\0\0\0\0",
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("any");
        fs::write(&path, [first[kind], &bytes].concat()).unwrap();
        decode(&path);
        prop_assert_eq!(PANICS.load(Ordering::SeqCst), 0);
    }
}
