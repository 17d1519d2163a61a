//! Videos of known motions, rendered and compressed as filmed ones are, then measured: `cargo xtask synthetic-video`.

mod kinds;
mod picture;
mod report;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use clap::Args;
use paig_video::import::sources::Filming;
use paig_video::import::time_base::VideoPart;
use paig_video::measure::results::Measurement;
use paig_video::measure::{VideoRequest, measure_videos};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use self::kinds::{KINDS, MotionKind, TrueMotion};
use self::report::SyntheticRow;
use crate::trajectory::SampleTimes;
use paig::tasks::equation_file::EquationFile;

/// Videos between two reports; as many at a time as there are cores.
const BETWEEN_REPORTS: usize = 8;
/// Frame rates of the videos.
const RATES: [f64; 4] = [24.0, 30.0, 50.0, 60.0];

/// Makes videos of known motions, measures them, and writes results.json and report.md.
#[derive(Debug, Args)]
pub struct SyntheticVideoArguments {
    /// Videos, of ten kinds in turn
    #[arg(long, default_value_t = 200)]
    videos: u64,
    /// First video
    #[arg(long, default_value_t = 0)]
    first: u64,
    /// Draws other videos
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Leaves the videos and measurements there [default: a temporary folder]
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,
    /// Folder of results.json and report.md
    #[arg(long, value_name = "DIR", default_value = "reports/synthetic-video")]
    out: PathBuf,
}

/// # Errors
/// No ffmpeg, a full disk.
pub fn run(arguments: &SyntheticVideoArguments) -> Result<()> {
    let temporary = tempfile::tempdir()?;
    let folder = arguments.keep.as_deref().unwrap_or(temporary.path());
    fs::create_dir_all(folder)?;
    let numbers: Vec<u64> = (arguments.first..arguments.first + arguments.videos).collect();
    let mut rows = Vec::new();
    for some in numbers.chunks(BETWEEN_REPORTS) {
        let measured: Vec<Vec<SyntheticRow>> =
            some.par_iter().map(|&number| arguments.rows(number, folder)).collect::<Result<_>>()?;
        rows.extend(measured.into_iter().flatten());
        report::write(&arguments.out, &rows)?;
    }
    Ok(())
}

impl SyntheticVideoArguments {
    /// Makes a video, measures it, and leaves it where that was asked for.
    fn rows(&self, number: u64, folder: &Path) -> Result<Vec<SyntheticRow>> {
        let kind = &KINDS[number as usize % KINDS.len()];
        let made = VideoPlan::new(kind, self.seed, number);
        let video = folder.join(format!("{number}.mp4"));
        picture::film(&made.scene, made.clock.rate, made.quality, &video)?;
        let begun = Instant::now();
        let measured = measure(&video, kind);
        let rows = report::rows(number, kind, &made, measured.as_ref(), begun.elapsed().as_secs_f64());
        rows.iter().for_each(SyntheticRow::print);
        if let Err(error) = &measured {
            println!("{number} {}: {error:#}", kind.name);
        }
        if self.keep.is_none() {
            fs::remove_file(&video)?;
        }
        Ok(rows)
    }
}

/// A video before it is filmed.
struct VideoPlan {
    clock: SampleTimes,
    motion: TrueMotion,
    scene: paig_track::synthetic::SyntheticScene,
    /// Constant rate factor of the encoder: 18 is nearly lossless, 30 poor.
    quality: u32,
}

impl VideoPlan {
    fn new(kind: &MotionKind, seed: u64, number: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed.wrapping_mul(1_000_003).wrapping_add(number));
        let [least, most] = kind.frames.map(|frames| (frames as f64).ln());
        let frames = random.random_range(least..=most).exp().round() as usize;
        let clock = SampleTimes { frames, rate: RATES[random.random_range(0..RATES.len())] };
        let mut motion = (kind.motion)(&mut random, &clock);
        let scene = picture::scene(&mut random, std::mem::take(&mut motion.positions));
        VideoPlan { clock, motion, scene, quality: random.random_range(18..30) }
    }
}

fn measure(video: &Path, kind: &MotionKind) -> Result<Measurement> {
    let equation = EquationFile::named(kind.equation)?;
    let request = VideoRequest {
        videos: vec![video.into()],
        parts: vec![VideoPart::All],
        filming: Filming::default(),
        crop: None,
        pixels_per_metre: None,
        scale_percent: 0.0,
        time_percent: 0.0,
        origin: None,
        angle: 0.0,
        y_up: false,
        scale_points: None,
        tracker: None,
        equation: Some(equation),
        objects: None,
        hints: Vec::new(),
        ignore: Vec::new(),
        takes: false,
    };
    let out = video.with_extension("");
    measure_videos(&request, &[], &out).with_context(|| format!("video {}", video.display()))
}
