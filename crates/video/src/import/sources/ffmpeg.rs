//! Everything else: decoded by the program `ffmpeg`, if there is one on the PATH.

use std::ffi::OsString;
use std::io::{BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use anyhow::{Context, Result, ensure};
use image::RgbImage;

use super::{Facts, Frames, MOST_FRAMES, check_size, check_square};

/// Whether there is one.
pub(super) fn is_there() -> bool {
    let mut version = Command::new("ffmpeg");
    version.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    version.status().is_ok_and(|status| status.success())
}

/// Every frame of the first film track as it is, none doubled or dropped, upright.
fn command(path: &Path, output: &[&str]) -> Command {
    let mut command = Command::new("ffmpeg");
    let mut input = OsString::from("file:");
    input.push(path);
    command.args(["-v", "error", "-nostdin", "-i"]).arg(input);
    command.args(["-map", "0:v:0", "-fps_mode", "passthrough"]).args(output).arg("-");
    command.stdin(Stdio::null());
    command
}

/// Size and times, from a list of all frames.
pub(super) fn facts(path: &Path) -> Result<Facts> {
    let output = command(path, &["-f", "framecrc"]).output().context("cannot start ffmpeg")?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(
        !said.contains("fps_mode"),
        "it needs ffmpeg 5.1 or newer (the one on the PATH knows no -fps_mode); or convert it to H.264 in mp4"
    );
    // What it says last is the reason. Of damage that it can read over it says something, and ends well.
    let last = said.trim().lines().last();
    ensure!(output.status.success(), "ffmpeg cannot read it: {}", last.unwrap_or("it says no more"));
    Ok(Facts { complaint: last.map(String::from), ..listed(&String::from_utf8_lossy(&output.stdout))? })
}

/// What ffmpeg's list of all frames says.
fn listed(list: &str) -> Result<Facts> {
    let (mut tick, mut size, mut stamps) = (None, None, Vec::new());
    for line in list.lines() {
        if let Some(base) = line.strip_prefix("#tb 0: ") {
            tick = base.split_once('/').and_then(|(n, d)| Some(n.parse::<f64>().ok()? / d.parse::<f64>().ok()?));
        } else if let Some(sides) = line.strip_prefix("#dimensions 0: ") {
            size = sides.split_once('x').and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
        } else if let Some(sides) = line.strip_prefix("#sar 0: ") {
            let sides = sides.split_once('/').and_then(|(x, y)| Some((x.parse::<f64>().ok()?, y.parse::<f64>().ok()?)));
            // 0/1 where the video does not say.
            sides.filter(|(x, y)| *x > 0.0 && *y > 0.0).map_or(Ok(()), |(x, y)| check_square(x / y))?;
        } else if !line.starts_with('#') {
            let stamp = line.split(',').nth(2).and_then(|stamp| stamp.trim().parse::<f64>().ok());
            stamps.push(stamp.with_context(|| format!("ffmpeg lists a frame without a time: {line:?}"))?);
        }
        ensure!(stamps.len() <= MOST_FRAMES, "it has more than {MOST_FRAMES} frames");
    }
    let size: (u32, u32) = size.context("ffmpeg tells no size of its frames")?;
    check_size(size.0, size.1)?;
    let tick = tick.context("ffmpeg tells no time base")?;
    let first = stamps.first().copied().context("it has no frames")?;
    let times: Vec<f64> = stamps.iter().map(|stamp| (stamp - first) * tick).collect();
    Ok(Facts { size, frames: times.len(), times: Some(times), complaint: None })
}

/// Raw frames from a running ffmpeg.
pub(super) struct Pipe {
    process: Child,
    output: BufReader<ChildStdout>,
    size: (u32, u32),
    /// Frames read so far, and the last of them.
    taken: usize,
    last: RgbImage,
}

impl Pipe {
    pub(super) fn open(path: &Path, width: u32, height: u32) -> Result<Self> {
        let mut command = command(path, &["-f", "rawvideo", "-pix_fmt", "rgb24"]);
        // What it has to say of the video it said when it listed the frames.
        command.stdout(Stdio::piped()).stderr(Stdio::null());
        let mut process = command.spawn().context("cannot start ffmpeg")?;
        let output = BufReader::new(process.stdout.take().context("ffmpeg has no output")?);
        Ok(Pipe { process, output, size: (width, height), taken: 0, last: RgbImage::new(width, height) })
    }
}

impl Frames for Pipe {
    fn frame(&mut self, number: usize) -> Result<RgbImage> {
        let (width, height) = self.size;
        while self.taken <= number {
            let mut bytes = vec![0; 3 * width as usize * height as usize];
            let ended = || format!("ffmpeg ended before frame {}", self.taken);
            self.output.read_exact(&mut bytes).with_context(ended)?;
            self.last = RgbImage::from_raw(width, height, bytes).expect("three bytes for each pixel");
            self.taken += 1;
        }
        Ok(self.last.clone())
    }
}

impl Drop for Pipe {
    /// What is left of the video is not wanted: ffmpeg may have ended already.
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::listed;

    #[test]
    fn pixels_that_are_not_square_are_refused() {
        let list = |aspect: &str| {
            listed(&format!("#tb 0: 1/25\n#dimensions 0: 1440x1080\n#sar 0: {aspect}\n0, 0, 0, 1, 9, 0x0\n"))
        };
        assert!(list("1/1").is_ok() && list("0/1").is_ok());
        assert!(list("4/3").err().unwrap().to_string().contains("1.333 times as wide"));
    }
}
