//! One pendulum, recorded in many ways and measured: `cargo xtask recordings`. Prints a table.
//!
//! Needs `paig` in `target/release`, and ffmpeg with libx264 and libx265 to encode the pictures.

mod pendulum;
mod ways;

use std::fmt::Write as _;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig_track::Size;
use paig_track::synthetic::{MovingEllipse, SyntheticScene};
use paig_video::measure::results::{Measurement, Outcome};

use self::pendulum::{LENGTH, Pendulum};
use self::ways::{ExpectedOutcome, SIZE, Way};
use crate::programs::{self, done};

/// Records a pendulum of known period and length in many ways, measures each recording, and prints a table.
#[derive(Debug, Args)]
pub struct RecordingsArguments {
    /// Folder for the recordings and what was measured; those that are there are measured again, not made again
    #[arg(long, default_value = "recordings")]
    out: PathBuf,
    /// Only ways whose name contains this
    #[arg(long, default_value = "")]
    only: String,
}

/// # Errors
/// No ffmpeg, a program that is not built, a way that ends otherwise than expected.
pub fn run(arguments: &RecordingsArguments) -> Result<()> {
    let paig = programs::paig()?;
    fs::create_dir_all(&arguments.out)?;
    println!("| recording | options of `paig measure` | verdict | period, s | length, m | as expected |");
    println!("|---|---|---|---|---|---|");
    let mut wrong = Vec::new();
    for (number, way) in ways::all().iter().enumerate().filter(|(_, way)| way.name.contains(&arguments.only)) {
        let video = arguments.out.join(format!("{number:02}.{}", way.extension));
        if !video.exists() {
            record(way, &video).with_context(|| way.name)?;
        }
        let ending = measured(&paig, way, &video)?;
        let options = if way.options.is_empty() { String::new() } else { format!("`{}`", way.options) };
        let as_expected = if ending.as_expected { "yes" } else { "no" };
        println!("| {} | {options} | {} | {as_expected} |", way.name, ending.cells);
        if !ending.as_expected {
            wrong.push(way.name);
        }
    }
    ensure!(wrong.is_empty(), "otherwise than expected: {}", wrong.join("; "));
    Ok(())
}

/// How a measurement ended.
struct RecordingOutcome {
    /// Verdict, period and length.
    cells: String,
    as_expected: bool,
}

fn measured(paig: &Path, way: &Way, video: &Path) -> Result<RecordingOutcome> {
    let truth = Pendulum::new(way.seconds() + 1.0).period(way.seconds()).context("the pendulum has no period")?;
    let out = video.with_extension("measurement");
    let mut command = Command::new(paig);
    command.arg("measure").arg(video).args(["--equation", "configs/gallery/swing.toml", "--threads", "1"]);
    command.args(way.options.split_whitespace()).arg("--out").arg(&out);
    let output = command.stdin(Stdio::null()).output()?;
    fs::write(video.with_extension("log"), [&output.stdout[..], &output.stderr].concat())?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let reason = said.lines().rfind(|line| line.starts_with("error")).unwrap_or_default();
        let reason = reason.trim_start_matches("error: ").replace(&video.display().to_string(), "");
        let cells = format!("refused: {reason} | | ");
        return Ok(RecordingOutcome { cells, as_expected: way.expected == ExpectedOutcome::Rejected });
    }
    let measurement = Measurement::read(&out)?;
    let verdict = measurement.verdict.context("a measurement without a verdict")?;
    let (mut cells, mut within) = (verdict.outcome.to_string(), verdict.outcome == Outcome::Found);
    if let (false, Some(reason)) = (within, verdict.reasons.first()) {
        write!(cells, ": {reason}")?;
    }
    for (name, truth) in [("period", truth), ("l", LENGTH)] {
        let quantity = measurement.quantities.iter().find(|quantity| quantity.name == name);
        let interval = quantity.and_then(|quantity| Some((quantity.value, quantity.low?, quantity.high?)));
        within &= interval.is_some_and(|(value, low, high)| (value - truth).abs() <= high - low);
        match interval {
            Some((value, low, high)) => write!(cells, " | {value:.4} ({low:.4} to {high:.4}; true {truth:.4})")?,
            None => cells.push_str(" | none"),
        }
    }
    let rejected = verdict.outcome != Outcome::Found;
    let as_expected = if way.expected == ExpectedOutcome::Measured { within } else { rejected };
    Ok(RecordingOutcome { cells, as_expected })
}

fn record(way: &Way, path: &Path) -> Result<()> {
    let pictures = pictures(way);
    let [width, height] = SIZE;
    let mut command = Command::new("ffmpeg");
    command.args(["-v", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
    command.args(["-s", &format!("{width}x{height}"), "-r", &way.rate.to_string(), "-i", "pipe:0"]);
    command.args(way.encoder.split_whitespace()).arg(path);
    let encoder = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let mut encoder = encoder.context("cannot start ffmpeg")?;
    let mut pipe = encoder.stdin.take().context("ffmpeg takes no input")?;
    let written = pictures.iter().try_for_each(|picture| pipe.write_all(picture));
    drop(pipe);
    done(&encoder.wait_with_output()?)?;
    Ok(written?)
}

/// Frames as they are encoded, `[height, width, 3]` each.
fn pictures(way: &Way) -> Vec<Vec<u8>> {
    let seconds = way.times.iter().copied().fold(0.0, f64::max) + 1.0;
    let positions = way.positions(&Pendulum::new(seconds));
    let [width, height] = SIZE;
    let scene = |camera: Vec<[f64; 3]>, seed: u64| SyntheticScene {
        size: Size { width, height },
        camera,
        seed,
        ..SyntheticScene::of(MovingEllipse { axes: way.axes(), ..MovingEllipse::at(positions.clone()) })
    };
    let filmed = scene(way.camera.clone(), 11).render();
    let mut pictures: Vec<Vec<u8>> = filmed.outer_iter().map(|picture| picture.iter().copied().collect()).collect();
    if way.depth > 0.0 {
        // The lower third is nearer: it moves more.
        let nearer = way.camera.iter().map(|place| place.map(|it| it * (1.0 + way.depth))).collect();
        let nearer = scene(nearer, 12).render();
        for (picture, nearer) in pictures.iter_mut().zip(nearer.outer_iter()) {
            let from = width * height * 2;
            picture.iter_mut().zip(nearer).skip(from).for_each(|(byte, nearer)| *byte = *nearer);
        }
    }
    if way.interlaced { pictures.chunks_exact(2).map(|pair| woven(&pair[0], &pair[1])).collect() } else { pictures }
}

/// Even lines of one picture and odd ones of the next.
fn woven(first: &[u8], second: &[u8]) -> Vec<u8> {
    let rows = first.chunks(3 * SIZE[0]).zip(second.chunks(3 * SIZE[0]));
    rows.enumerate().flat_map(|(row, (first, second))| if row % 2 == 0 { first } else { second }).copied().collect()
}
