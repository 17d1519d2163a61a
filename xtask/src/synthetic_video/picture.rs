//! How a motion is filmed: looks, shadow, blur, noise, light, and the compression of the video.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use paig_track::Size;
use paig_track::synthetic::{MovingEllipse, Shadow, SyntheticRenderer, SyntheticScene};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::kinds::{HEIGHT, WIDTH};

/// Least distance of the colour of an object from that of the background, levels, over all channels.
const CONTRAST: f64 = 60.0;

/// What a camera sees of objects at these positions.
pub fn scene(random: &mut ChaCha8Rng, positions: Vec<Vec<[f64; 2]>>) -> SyntheticScene {
    let colour = |random: &mut ChaCha8Rng| [0; 3].map(|_| random.random_range(30.0..225.0));
    let background: [f64; 3] = colour(random);
    let shadows = random.random_bool(0.4);
    let movers = positions.into_iter().map(|positions| {
        let apart = |other: &[f64; 3]| {
            let squares = other.iter().zip(&background).map(|(a, b)| (a - b).powi(2));
            squares.sum::<f64>().sqrt() > CONTRAST
        };
        let colour = std::iter::repeat_with(|| colour(random)).find(apart).expect("one of many is unlike");
        let radius: f64 = random.random_range(6.0..32.0);
        let slim = random.random_range(0.7..1.0);
        let turn = if random.random_bool(0.5) { random.random_range(-0.1..0.1) } else { 0.0 };
        let shadow = Shadow {
            offset: [random.random_range(-1.5..1.5) * radius, random.random_range(0.8..2.0) * radius],
            axes: [radius, 0.7 * radius],
            light: random.random_range(0.5..0.9),
        };
        MovingEllipse {
            angles: (0..positions.len()).map(|frame| turn * frame as f64).collect(),
            positions,
            axes: [radius, slim * radius],
            colour,
            texture: random.random_range(0.0..25.0),
            shadow: shadows.then_some(shadow),
        }
    });
    SyntheticScene {
        size: Size { width: WIDTH, height: HEIGHT },
        movers: movers.collect(),
        background,
        background_texture: random.random_range(5.0..35.0),
        shutter: random.random_range(0.05..0.6),
        noise: random.random_range(1.0..5.0),
        drift: random.random_range(-0.05..0.05),
        flicker: random.random_range(0.0..0.01),
        seed: random.random(),
        ..SyntheticScene::default()
    }
}

/// Renders a scene into an H.264 video, by way of `ffmpeg`.
///
/// # Errors
/// No `ffmpeg`, or one that fails.
pub fn film(scene: &SyntheticScene, rate: f64, quality: u32, video: &Path) -> Result<()> {
    let size = format!("{}x{}", scene.size.width, scene.size.height);
    let (rate, quality) = (rate.to_string(), quality.to_string());
    let mut encoder = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", &size, "-r", &rate, "-i", "-"])
        .args(["-c:v", "libx264", "-preset", "veryfast", "-crf", &quality, "-pix_fmt", "yuv420p"])
        .arg(video)
        .stdin(Stdio::piped())
        .spawn()
        .context("ffmpeg cannot be started; the videos of this tool are compressed by it")?;
    let renderer = SyntheticRenderer::new(scene);
    let mut image = vec![0; scene.size.width * scene.size.height * 3];
    let mut pipe = encoder.stdin.take().context("ffmpeg has no input")?;
    for frame in 0..scene.frames() {
        renderer.frame(frame, &mut image);
        pipe.write_all(&image).context("ffmpeg stopped reading")?;
    }
    drop(pipe);
    let status = encoder.wait()?;
    ensure!(status.success(), "ffmpeg ended with {status} at {}", video.display());
    Ok(())
}
