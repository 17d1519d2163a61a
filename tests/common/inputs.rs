//! All that reads what a stranger may have made, each as a function of bytes, with sound examples to begin from.

use std::fs;
use std::path::Path;

use clap::Parser;
use paig::datasets::dataset::Dataset;
use paig::datasets::files::{ClipShape, Split};
use paig::generators::source_images::SourceImages;
use paig::runs::metrics;
use paig::runs::run_config::RunConfig;
use paig::runs::summary::Summary;
use paig::runs::weights;
use paig::tasks::{self, Task};
use paig::training::config::Config;
use paig::training::layers::Overrides;
use paig_cli::Paig;
use paig_experiments::sweep::parse_seeds;
use paig_video::import::sources::SourceVideo;
use paig_video::import::tracker::TrackerFile;
use rand::Rng;
use tch::{Device, Kind, Tensor};

use crate::project::project;

/// One reader.
pub struct Target {
    pub name: &'static str,
    /// Sound inputs, from which others are made.
    pub examples: fn(&Path) -> Vec<Vec<u8>>,
    /// Reads the bytes; the folder is for those that read files. What it makes of them is of no interest here, only that it
    /// comes back.
    pub read: fn(&[u8], &Path),
    /// Whether no file is written for it.
    pub quick: bool,
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn file(folder: &Path, name: &str, bytes: &[u8]) -> std::path::PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    path
}

fn of_repository(name: &str) -> Vec<u8> {
    fs::read(project(name)).unwrap()
}

const RECORD: &str = "reports/seeds/records/spring_color/fast/seed=0";

fn video(bytes: &[u8], folder: &Path, name: &str) {
    let path = file(folder, name, bytes);
    if let Ok(video) = SourceVideo::open(&path)
        && video.width * video.height <= 1 << 16
        && let Ok(mut frames) = video.decode()
    {
        for number in 0..video.frames.min(3) {
            if frames.frame(number).is_err() {
                break;
            }
        }
    }
}

fn pictures() -> Vec<image::RgbImage> {
    (0..3)
        .map(|t| image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([(x * 30) as u8, (y * 30) as u8, t * 80])))
        .collect()
}

fn gif() -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::gif::GifEncoder::new(&mut bytes);
    for picture in pictures() {
        encoder.encode_frame(image::Frame::new(image::DynamicImage::ImageRgb8(picture).into_rgba8())).unwrap();
    }
    drop(encoder);
    bytes
}

fn png() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    pictures()[0].write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn npz(compressed: bool) -> Vec<u8> {
    let bytes = std::io::Cursor::new(Vec::new());
    let mut npz =
        if compressed { ndarray_npy::NpzWriter::new_compressed(bytes) } else { ndarray_npy::NpzWriter::new(bytes) };
    for name in ["train_x", "valid_x", "test_x"] {
        npz.add_array(name, &ndarray::Array5::<u8>::from_elem((1, 12, 32, 32, 3), 7)).unwrap();
    }
    npz.finish().unwrap().into_inner()
}

fn safetensors(folder: &Path) -> Vec<u8> {
    let path = folder.join("sound.safetensors");
    let tensor = |size: &[i64]| Tensor::ones(size, (Kind::Float, Device::Cpu));
    weights::write(&path, &[("a.weight".into(), tensor(&[2, 3])), ("b".into(), tensor(&[]))]).unwrap();
    fs::read(path).unwrap()
}

fn idx() -> Vec<u8> {
    let header: Vec<u8> = [0x0803u32, 2, 28, 28].iter().flat_map(|number| number.to_be_bytes()).collect();
    [header, vec![9; 2 * 28 * 28]].concat()
}

const TRACKER: &str = r#"<?xml version="1.0"?><object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">
<property name="coords" type="object"><object class="ImageCoordSystem"><property name="framedata" type="array">
<property name="[0]" type="object"><object><property name="xorigin" type="double">10.0</property>
<property name="yorigin" type="double">20.0</property><property name="angle" type="double">0.0</property>
<property name="xscale" type="double">100.0</property><property name="yscale" type="double">100.0</property>
</object></property></property></object></property><property name="delta_t" type="double">33.3</property></object>"#;

/// All readers.
pub const TARGETS: &[Target] = &[
    Target {
        name: "metrics",
        examples: |_| vec![of_repository(&format!("{RECORD}/metrics.jsonl"))[..2000].to_vec()],
        read: |bytes, _| drop(metrics::parse(bytes)),
        quick: true,
    },
    Target {
        name: "summary",
        examples: |_| vec![of_repository(&format!("{RECORD}/summary.json"))],
        read: |bytes, folder| {
            file(folder, "summary.json", bytes);
            drop(Summary::read(folder));
        },
        quick: false,
    },
    Target {
        name: "run_config",
        examples: |_| vec![of_repository(&format!("{RECORD}/config.toml"))],
        read: |bytes, folder| {
            let path = file(folder, "config.toml", bytes);
            drop((Config::read(&path), RunConfig::read(&path)));
        },
        quick: false,
    },
    Target {
        name: "config",
        examples: |_| vec![of_repository("configs/fast.toml")],
        read: |bytes, folder| {
            let path = file(folder, "config.toml", bytes);
            let overrides = Overrides { task: Some("spring_color".into()), ..Overrides::default() };
            drop(Config::load(Some(&path), &overrides));
        },
        quick: false,
    },
    Target {
        name: "task",
        examples: |_| ["configs/tasks/spring_color.toml", "configs/tasks/pendulum.toml"].map(of_repository).to_vec(),
        read: |bytes, _| drop(Task::from_toml(&text(bytes))),
        quick: true,
    },
    Target {
        name: "equation",
        examples: |_| {
            ["double_pendulum", "spring_chain", "lossy_bounce", "charges", "sliding_block"]
                .map(|name| of_repository(&format!("configs/gallery/{name}.toml")))
                .to_vec()
        },
        read: |bytes, _| drop(Task::from_toml(&text(bytes))),
        quick: true,
    },
    Target {
        name: "tracker",
        examples: |_| vec![TRACKER.into()],
        read: |bytes, _| drop(TrackerFile::parse(&text(bytes))),
        quick: true,
    },
    Target {
        name: "safetensors",
        examples: |folder| vec![safetensors(folder)],
        read: |bytes, _| drop(weights::parse(bytes)),
        quick: true,
    },
    Target {
        name: "npz",
        examples: |_| vec![npz(true), npz(false), of_repository("tests/data/numpy_savez_compressed.npz")],
        read: |bytes, folder| {
            let path = file(folder, "data.npz", bytes);
            let task = tasks::find("spring_color").unwrap();
            let shape = ClipShape::of_either(&task, Split::Train);
            drop(Dataset::open_within(&path, &shape, u64::MAX));
            drop(Dataset::open_within(&path, &shape, 0));
        },
        quick: false,
    },
    Target {
        name: "npz_video",
        examples: |_| vec![of_repository("tests/data/numpy_savez.npz")],
        read: |bytes, folder| video(bytes, folder, "video.npz"),
        quick: false,
    },
    Target {
        name: "mp4",
        examples: |_| vec![of_repository("tests/data/numbered.mp4")],
        read: |bytes, folder| video(bytes, folder, "video.mp4"),
        quick: false,
    },
    Target {
        name: "gif",
        examples: |_| vec![gif()],
        read: |bytes, folder| video(bytes, folder, "a.gif"),
        quick: false,
    },
    Target {
        name: "png",
        examples: |_| vec![png()],
        read: |bytes, folder| {
            let pictures = folder.join("pictures");
            fs::create_dir_all(&pictures).unwrap();
            file(&pictures, "0.png", bytes);
            if let Ok(video) = SourceVideo::open(&pictures) {
                drop(video.decode().and_then(|mut frames| frames.frame(0)));
            }
        },
        quick: false,
    },
    Target {
        name: "idx",
        examples: |_| vec![idx()],
        read: |bytes, folder| {
            file(folder, "train-images-idx3-ubyte", bytes);
            drop(SourceImages::original().unwrap().with_mnist(folder, [0, 1]));
        },
        quick: false,
    },
    Target {
        name: "cifar",
        examples: |_| vec![vec![3; 2 * 3073]],
        read: |bytes, folder| {
            file(folder, "data_batch_1.bin", bytes);
            drop(SourceImages::original().unwrap().with_cifar(folder, 1));
        },
        quick: false,
    },
    Target {
        name: "seeds",
        examples: |_| vec![b"0-9".to_vec(), b"1,4,7-8".to_vec()],
        read: |bytes, _| drop(parse_seeds(&text(bytes))),
        quick: true,
    },
    Target {
        name: "command_line",
        examples: |_| vec![b"paig train --task spring_color --seed 1 --set join.batch=5 --threads 2 --resume".to_vec()],
        read: |bytes, _| drop(Paig::try_parse_from(text(bytes).split_whitespace())),
        quick: true,
    },
    Target {
        name: "set",
        examples: |_| vec![b"join.batch=5".to_vec(), b"task.system.dt=0.1".to_vec(), b"model.fixed={g=1.0}".to_vec()],
        read: |bytes, _| {
            let set = vec![text(bytes)];
            drop(Config::load(None, &Overrides { task: Some("pendulum".into()), set, ..Overrides::default() }));
        },
        quick: true,
    },
];

/// What a mutation puts into a text or a header: ends of ranges, and what means something to the formats.
const TOKENS: &[&str] = &[
    "0",
    "-1",
    "1e30",
    "1e-30",
    "1e400",
    "nan",
    "inf",
    "-inf",
    "18446744073709551615",
    "9223372036854775808",
    "4294967296",
    "999999999999",
    "../../x",
    "/dev/zero",
    "\"",
    "'",
    "{",
    "}",
    "[",
    "]",
    "=",
    "\n",
    ",",
    "(",
    ")",
    "*",
    "^",
    "null",
    "true",
    "((((((((((((((((",
    "\u{0}",
    "ü",
    "--",
    "sqrt(",
    "norm(x)",
    "<!ENTITY a \"b\">",
    "&a;",
];

/// Another input made from a sound one, or from two.
pub fn mutate(random: &mut impl Rng, examples: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = examples[random.random_range(0..examples.len())].clone();
    for _ in 0..random.random_range(1..=6) {
        let at = if bytes.is_empty() { 0 } else { random.random_range(0..bytes.len()) };
        // The beginning decides more than the rest.
        let at = if random.random_bool(0.3) { at.min(random.random_range(0..200)) } else { at };
        match random.random_range(0..8) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << random.random_range(0..8),
            1 if !bytes.is_empty() => bytes[at] = random.random(),
            2 => bytes.truncate(at),
            3 => {
                let token = TOKENS[random.random_range(0..TOKENS.len())];
                bytes.splice(at..at, token.bytes());
            }
            4 => {
                let token = TOKENS[random.random_range(0..TOKENS.len())];
                let end = (at + token.len()).min(bytes.len());
                bytes.splice(at..end, token.bytes());
            }
            5 if !bytes.is_empty() => {
                let end = (at + random.random_range(1..40)).min(bytes.len());
                bytes.drain(at..end);
            }
            6 if !bytes.is_empty() => {
                let end = (at + random.random_range(1..40)).min(bytes.len());
                let part = bytes[at..end].to_vec();
                let to = random.random_range(0..=bytes.len());
                bytes.splice(to..to, part);
            }
            7 if bytes.len() >= at + 8 => {
                let number = [0u64, 1, u64::MAX, 1 << 31, 1 << 40, 0x7fff_ffff][random.random_range(0..6)];
                let width = [2, 4, 8][random.random_range(0..3)];
                let number = if random.random() { number.to_le_bytes() } else { number.to_be_bytes() };
                let part = if random.random() { &number[..width] } else { &number[8 - width..] };
                bytes[at..at + width].copy_from_slice(part);
            }
            _ => {}
        }
        bytes.truncate(1 << 18);
    }
    bytes
}
