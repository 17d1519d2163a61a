//! What is decoded nowhere else: the program `ffmpeg`, if there is one on the PATH.

use std::ffi::OsString;
use std::io::{BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;

use image::RgbImage;

use crate::error::{DecodeError, Result, printable};
use crate::frame::{Frame, Presentation};
use crate::info::{Info, Note, VideoDecoder};
use crate::limits::{check_frames, check_size};
use crate::picture::DecodedPicture;
use crate::stream::Sink;

/// Demuxers that ffmpeg may use: containers of one file. Playlists and lists of files would open others.
const CONTAINERS: &str = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,ogg,mpeg,mpegts,mpegvideo,m4v,asf,flv,h264,hevc,ivf,rm,dv,\
                          nut,mxf,gxf,wtv,mjpeg,apng,gif,obu,av1,vc1,rawvideo,swf,smjpeg,y4m,yuv4mpegpipe";
/// A complaint that should not happen.
const NO_FFMPEG: &str = "is there an ffmpeg on the PATH?";

/// Whether there is one.
pub(crate) fn is_there() -> bool {
    let mut version = Command::new("ffmpeg");
    version.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    version.status().is_ok_and(|status| status.success())
}

/// Every frame of the first video track as it is, none doubled or dropped, upright. Only this file is opened.
fn command(path: &Path, output: &[&str]) -> Command {
    let mut command = Command::new("ffmpeg");
    let mut input = OsString::from("file:");
    input.push(path);
    command.args(["-v", "error", "-nostdin", "-protocol_whitelist", "file", "-format_whitelist", CONTAINERS]);
    command.arg("-i").arg(input).args(["-map", "0:v:0", "-fps_mode", "passthrough"]).args(output).arg("-");
    command.stdin(Stdio::null());
    command
}

/// Facts and times, from a list of all frames.
///
/// # Errors
/// What ffmpeg complains of where it cannot go on; sizes beyond the limits.
pub(crate) fn list(path: &Path) -> Result<(Info, Vec<f64>, Arc<Presentation>)> {
    // In the container's clock: in that of its mean frame rate, uneven times are rounded.
    let output = command(path, &["-enc_time_base", "-1", "-f", "framecrc"]).output()?;
    let complaints = String::from_utf8_lossy(&output.stderr);
    if complaints.contains("fps_mode") {
        return Err(DecodeError::Unsupported {
            what: "a video that needs ffmpeg".into(),
            remedy: "install ffmpeg 5.1 or newer: the one on the PATH knows no -fps_mode".into(),
        });
    }
    // Its last line is the reason. Where it can read over damage it says so and goes on.
    let complaint = complaints.trim().lines().last().map(printable);
    if !output.status.success() {
        let complaint = complaint.unwrap_or_else(|| "it says no more".into());
        return Err(DecodeError::corrupt(format!("ffmpeg cannot read it: {complaint}")));
    }
    let listed = Listed::parse(&String::from_utf8_lossy(&output.stdout))?;
    let start = listed.stamps.first().copied().unwrap_or(0.0);
    // ffmpeg turns and converts.
    let (info, display) = Info::of_rgb("ffmpeg", "decoded by ffmpeg", listed.size, listed.stamps.len())?;
    let notes = complaint.map(Note::Ffmpeg).into_iter().collect();
    let info = Info { decoder: VideoDecoder::Ffmpeg, pixel_aspect: listed.pixel_aspect, start, notes, ..info };
    let times = listed.stamps.iter().map(|stamp| stamp - start).collect();
    Ok((info, times, display))
}

/// What ffmpeg's list of all frames states.
struct Listed {
    size: (u32, u32),
    pixel_aspect: f64,
    /// Presentation times, seconds.
    stamps: Vec<f64>,
}

impl Listed {
    fn parse(list: &str) -> Result<Self> {
        fn pair(text: &str, between: char) -> Option<(f64, f64)> {
            let (first, second) = text.split_once(between)?;
            Some((first.trim().parse().ok()?, second.trim().parse().ok()?))
        }
        let (mut tick, mut size, mut pixel_aspect, mut stamps) = (None, None, 1.0, Vec::new());
        for line in list.lines() {
            if let Some(base) = line.strip_prefix("#tb 0: ") {
                tick = pair(base, '/').map(|(count, second)| count / second);
            } else if let Some(sides) = line.strip_prefix("#dimensions 0: ") {
                size = pair(sides, 'x').map(|(width, height)| (width as u32, height as u32));
            } else if let Some(sides) = line.strip_prefix("#sar 0: ") {
                // 0/1 where the video does not state it.
                let sides = pair(sides, '/').filter(|(width, height)| *width > 0.0 && *height > 0.0);
                pixel_aspect = sides.map_or(1.0, |(width, height)| width / height);
            } else if !line.starts_with('#') {
                let stamp = line.split(',').nth(2).and_then(|stamp| stamp.trim().parse::<f64>().ok());
                let stamp = stamp.ok_or_else(|| DecodeError::corrupt("ffmpeg lists a frame without a time"))?;
                stamps.push(stamp);
                check_frames(stamps.len())?;
            }
        }
        let missing = |what: &str| DecodeError::corrupt(format!("ffmpeg states no {what}"));
        let size: (u32, u32) = size.ok_or_else(|| missing("size of its frames"))?;
        check_size(size.0, size.1)?;
        let tick = tick.ok_or_else(|| missing("time base"))?;
        if stamps.is_empty() {
            return Err(DecodeError::corrupt("it has no frames"));
        }
        stamps.iter_mut().for_each(|stamp| *stamp *= tick);
        Ok(Listed { size, pixel_aspect, stamps })
    }
}

/// A running ffmpeg, ended with its owner.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Decodes the frames from a display number on; those before are decoded, too.
///
/// # Errors
/// An ffmpeg that ends before the last frame.
pub(crate) fn decode(
    path: &Path,
    (width, height): (u32, u32),
    times: &[f64],
    display: &Arc<Presentation>,
    from: usize,
    sink: &Sink,
) -> Result<()> {
    let mut command = command(path, &["-f", "rawvideo", "-pix_fmt", "rgb24"]);
    // Its complaints came with the list.
    command.stdout(Stdio::piped()).stderr(Stdio::null());
    let mut process = Process(command.spawn()?);
    let output = process.0.stdout.take().ok_or_else(|| DecodeError::corrupt(NO_FFMPEG))?;
    let mut output = BufReader::new(output);
    for (number, &seconds) in times.iter().enumerate() {
        let mut bytes = vec![0; 3 * width as usize * height as usize];
        let ended = |_| DecodeError::at_frame(number, Some(seconds), DecodeError::corrupt("ffmpeg ended before it"));
        output.read_exact(&mut bytes).map_err(ended)?;
        if number < from {
            continue;
        }
        let picture = RgbImage::from_raw(width, height, bytes).expect("three bytes for each pixel");
        if !sink.send(Frame {
            number,
            seconds: Some(seconds),
            picture: DecodedPicture::Rgb(picture),
            display: display.clone(),
            field: None,
        }) {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_gives_size_aspect_and_times() {
        let list = "#tb 0: 1/50\n#dimensions 0: 1440x1080\n#sar 0: 4/3\n0, 2, 2, 1, 9, 0x0\n0, 4, 5, 1, 9, 0x0\n";
        let listed = Listed::parse(list).unwrap();
        assert_eq!((listed.size, listed.pixel_aspect, listed.stamps), ((1440, 1080), 4.0 / 3.0, vec![0.04, 0.1]));
        assert_eq!(Listed::parse(&list.replace("4/3", "0/1")).unwrap().pixel_aspect, 1.0);
        assert!(matches!(Listed::parse(&list.replace("1440x", "99999x")), Err(DecodeError::TooLarge { .. })));
        assert!(Listed::parse("#tb 0: 1/50\n").is_err());
    }
}
