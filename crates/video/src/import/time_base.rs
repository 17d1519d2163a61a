//! Which frames are kept, and the time between them.

use std::ops::Range;

use anyhow::{Result, bail, ensure};

use super::sources::MOST_FRAMES;
use paig::support::statistics::upper_median;

/// Frames that stand further from a regular clock than this part of its interval are put onto one: the nearest frame for
/// each tick.
const REGULAR: f64 = 0.25;
/// A difference of two stamps that is off the median by no more than this part of it is one interval: coarse stamps round 1.5
/// ticks to 1 or 2, and a missing frame doubles it.
const ONE_INTERVAL: f64 = 0.6;

/// Ticks of a regular clock to a frame of the video, at most: beyond that the clip is mostly one frame that stands.
const MOST_REPEATED: f64 = 3.0;

/// Frames beyond the last one at which a part in seconds may end: players show the time at which that one ends.
const BEYOND: f64 = 2.0;

/// A part of a video.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VideoPart {
    All,
    /// Frames by number, from 0 on; without the last.
    Frames(usize, Option<usize>),
    /// Seconds from the first frame, as a player shows them.
    Seconds(f64, Option<f64>),
}

/// The frames of one video that become clips.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// Numbers of the frames in the video; ascending, the same one again where a regular clock needs it.
    pub frames: Vec<usize>,
    /// Time between two of them, seconds.
    pub interval: f64,
    /// When the first one is shown, seconds.
    pub first_seconds: f64,
    /// Largest distance of a frame from the even clock that it is put onto, seconds.
    pub off: f64,
    /// What was found of the video's own clock.
    pub clock: FrameSpacing,
}

/// How even the frames of a video stand in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameSpacing {
    /// Frames a second were given.
    Given,
    Regular,
    /// Frames had to be put onto a regular clock: so many were shown twice, so many left out.
    Resampled {
        repeated: usize,
        left_out: usize,
    },
}

impl Kept {
    /// Chooses every `step`-th frame of a part of a video. `fps` replaces the times that the video has.
    ///
    /// # Errors
    /// A part outside of the video, a video without times and no `fps`, times that do not run on.
    pub fn choose(
        frames: usize,
        times: Option<&[f64]>,
        fps: Option<f64>,
        part: VideoPart,
        step: usize,
    ) -> Result<Self> {
        ensure!(step > 0, "--step 0: every frame is 1");
        let range = range(frames, times, fps, part)?;
        let Some(all) = times.filter(|_| fps.is_none()) else {
            let Some(fps) = fps else { bail!("it has no time stamps; say with --fps how many frames it has a second") };
            let first_seconds = range.start as f64 / fps;
            let (frames, interval) = (range.step_by(step).collect(), step as f64 / fps);
            return Ok(Kept { frames, interval, first_seconds, off: 0.0, clock: FrameSpacing::Given });
        };
        let times = &all[range.clone()];
        let (first, last) = (times[0], times[times.len() - 1]);
        if let ([only], [begin, .., end]) = (times, all)
            && end > begin
        {
            // A frame alone lasts as long as those of the video do.
            let interval = (end - begin) / (all.len() - 1) as f64 * step as f64;
            let frames = vec![range.start];
            return Ok(Kept { frames, interval, first_seconds: *only, off: 0.0, clock: FrameSpacing::Regular });
        }
        ensure!(
            times.len() > 1 && last > first,
            "its {} frames have no times that run on; say with --fps how many it has a second",
            times.len()
        );
        let mean = (last - first) / (times.len() - 1) as f64;
        let off = |(place, time): (usize, &f64)| (time - first - mean * place as f64).abs();
        let furthest = times.iter().enumerate().map(off).fold(0.0, f64::max);
        if furthest <= REGULAR * mean {
            let frames = range.step_by(step).collect();
            let interval = mean * step as f64;
            return Ok(Kept { frames, interval, first_seconds: first, off: furthest, clock: FrameSpacing::Regular });
        }
        let (tick, nearest) = best_clock(times)?;
        let repeated = nearest.windows(2).filter(|pair| pair[0] == pair[1]).count();
        let left_out = times.len() - (nearest.len() - repeated);
        let of_tick = |(number, place): (usize, &usize)| (times[*place] - first - tick * number as f64).abs();
        let off = nearest.iter().enumerate().map(of_tick).fold(0.0, f64::max);
        let frames = nearest.iter().step_by(step).map(|place| range.start + place).collect();
        let clock = FrameSpacing::Resampled { repeated, left_out };
        Ok(Kept { frames, interval: tick * step as f64, first_seconds: first, off, clock })
    }
}

/// The frames of a part of a video.
///
/// # Errors
/// A part outside of the video, seconds of a video without times.
pub fn range(frames: usize, times: Option<&[f64]>, fps: Option<f64>, part: VideoPart) -> Result<Range<usize>> {
    let range = match part {
        VideoPart::All => 0..frames,
        VideoPart::Frames(start, end) => start..end.unwrap_or(frames),
        VideoPart::Seconds(start, end) => {
            let time = |frame: usize| match (times, fps) {
                (Some(times), _) => Ok(times[frame]),
                (None, Some(fps)) => Ok(frame as f64 / fps),
                (None, None) => bail!("it has no time stamps; say with --fps how many frames it has a second"),
            };
            // Stamps are rounded to the ticks of the video's clock.
            let before = |seconds: f64| -> Result<usize> {
                let mut count = 0;
                while count < frames && time(count)? < seconds - 1e-4 {
                    count += 1;
                }
                Ok(count)
            };
            if let (Some(end), true) = (end, frames > 1) {
                let (last, one) = (time(frames - 1)?, time(frames - 1)? / (frames - 1) as f64);
                ensure!(
                    end <= last + BEYOND * one,
                    "seconds {start}..{end} are asked for; it has {frames} frames, the last at {last:.3} s"
                );
            }
            before(start)?..end.map_or(Ok(frames), before)?
        }
    };
    let length =
        times.and_then(|times| times.last()).map_or(String::new(), |last| format!(", the last at {last:.3} s"));
    ensure!(
        range.start < range.end && range.end <= frames,
        "frames {}..{} are asked for; it has {frames}, counted from 0{length}",
        range.start,
        range.end
    );
    Ok(range)
}

/// The regular clock on which uneven times stand best: its interval, and for each tick the place of the nearest frame. Either
/// most frames keep to one interval, or coarse stamps round all of them, and only their mean is right.
fn best_clock(times: &[f64]) -> Result<(f64, Vec<usize>)> {
    let differences: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let median = upper_median(differences.iter().copied()).unwrap_or(0.0);
    ensure!(
        median > 0.0,
        "most of its frames have the time of the one before; say with --fps how many it has a second"
    );
    let single = || differences.iter().filter(|difference| (**difference / median - 1.0).abs() <= ONE_INTERVAL);
    let mean = single().sum::<f64>() / single().count() as f64;
    // Gaps count, too, once it is known how many intervals each spans.
    let intervals: f64 = differences.iter().map(|difference| (difference / mean).round()).sum();
    let mean = (times[times.len() - 1] - times[0]) / intervals;
    // How far its frames are from their ticks, in intervals.
    let off = |(tick, nearest): &(f64, Vec<usize>)| {
        let of_tick = |(number, &place): (usize, &usize)| (times[place] - times[0] - tick * number as f64).abs();
        nearest.iter().enumerate().map(of_tick).sum::<f64>() / (tick * nearest.len() as f64)
    };
    let (of_most, of_mean) = ((median, on_clock(times, median)?), (mean, on_clock(times, mean)?));
    Ok(if off(&of_mean) < off(&of_most) { of_mean } else { of_most })
}

/// For each tick from the first time to the last the place of the nearest frame.
fn on_clock(times: &[f64], tick: f64) -> Result<Vec<usize>> {
    let (first, last) = (times[0], times[times.len() - 1]);
    let (mut place, mut nearest) = (0, Vec::new());
    let ticks = ((last - first) / tick).round();
    ensure!(ticks <= MOST_FRAMES as f64, "its times leap: from {first:.3} s to {last:.3} s by {tick:.5} s; give --fps");
    if ticks > MOST_REPEATED * times.len() as f64 {
        let longest = times.windows(2).map(|pair| pair[1] - pair[0]).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let (place, seconds) = longest.expect("there are several times");
        bail!(
            "frame {place} of the part lasts {seconds:.3} s, most others {tick:.5} s; choose a part before or after it with \
             --frames, or give the frame rate with --fps"
        );
    }
    for number in 0..=ticks as usize {
        let time = first + tick * number as f64;
        while place + 1 < times.len() && (times[place + 1] - time).abs() <= (times[place] - time).abs() {
            place += 1;
        }
        nearest.push(place);
    }
    Ok(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_times_are_kept_and_uneven_ones_put_onto_a_clock() {
        let even: Vec<f64> = (0..10).map(|frame| frame as f64 * 0.1 + 0.001 * (frame % 2) as f64).collect();
        let kept = Kept::choose(10, Some(&even), None, VideoPart::All, 3).unwrap();
        assert_eq!((kept.frames, kept.clock), (vec![0, 3, 6, 9], FrameSpacing::Regular));
        assert!((kept.interval - 0.3).abs() < 1e-3);
        // The frame at 0.3 s is missing, one at 0.52 s is too many.
        let uneven = [0.0, 0.1, 0.2, 0.39, 0.5, 0.52, 0.6, 0.7, 0.8];
        let kept = Kept::choose(9, Some(&uneven), None, VideoPart::All, 1).unwrap();
        assert_eq!(kept.frames, [0, 1, 2, 3, 3, 4, 6, 7, 8]);
        assert_eq!(kept.clock, FrameSpacing::Resampled { repeated: 1, left_out: 1 });
    }

    /// One frame is missing: 60 frames a second with stamps in milliseconds (16, 17, 17, ..), and 30 in hundredths (3, 3, 4, ..)
    /// as a gif has them. A median of the differences would be 17 ms, and 30 ms.
    #[test]
    fn coarse_stamps_do_not_change_the_rate() {
        let milliseconds: fn(usize) -> f64 = |frame| ((1000 * frame + 30) / 60) as f64 / 1000.0;
        let hundredths: fn(usize) -> f64 = |frame| (100 * frame / 30) as f64 / 100.0;
        for (stamp, last, missing, rate) in [(milliseconds, 600, 300, 60.0), (hundredths, 90, 40, 30.0)] {
            let times: Vec<f64> = (0..=last).filter(|frame| *frame != missing).map(stamp).collect();
            let kept = Kept::choose(times.len(), Some(&times), None, VideoPart::All, 1).unwrap();
            // The first and the last stamp are exact.
            assert!((kept.interval - 1.0 / rate).abs() < 1e-9, "{} for {rate}", kept.interval);
            assert_eq!(kept.clock, FrameSpacing::Resampled { repeated: 1, left_out: 0 }, "{rate}");
        }
    }

    /// Where the camera changes its rate, the one that it mostly has stays: a mean of both would fit neither.
    #[test]
    fn a_second_rate_does_not_change_the_first() {
        let stamp = |frame: i32| f64::from(if frame < 40 { 4 * frame } else { 5 * frame - 40 }) / 120.0;
        let times: Vec<f64> = (0..60).map(stamp).collect();
        let kept = Kept::choose(60, Some(&times), None, VideoPart::All, 1).unwrap();
        assert!((kept.interval - 1.0 / 30.0).abs() < 1e-9, "{}", kept.interval);
    }

    #[test]
    fn parts_are_cut_by_number_and_by_time() {
        let times: Vec<f64> = (0..10).map(|frame| frame as f64 * 0.1).collect();
        let frames = |part| Kept::choose(10, Some(&times), None, part, 1).map(|kept| kept.frames);
        assert_eq!(frames(VideoPart::Frames(2, Some(5))).unwrap(), [2, 3, 4]);
        assert_eq!(frames(VideoPart::Seconds(0.2, Some(0.5))).unwrap(), [2, 3, 4]);
        assert_eq!(frames(VideoPart::Frames(8, None)).unwrap(), [8, 9]);
        assert_eq!(frames(VideoPart::Seconds(0.8, Some(1.0))).unwrap(), [8, 9]);
        let outside = [VideoPart::Seconds(1.0, None), VideoPart::Seconds(0.1, Some(99.0))];
        for outside in [VideoPart::Frames(5, Some(11)), VideoPart::Frames(5, Some(5))].into_iter().chain(outside) {
            assert!(frames(outside).is_err(), "{outside:?}");
        }
    }

    #[test]
    fn given_frames_a_second_replace_the_times() {
        let times: Vec<f64> = (0..10).map(|frame| frame as f64 / 30.0).collect();
        let kept = Kept::choose(10, Some(&times), Some(120.0), VideoPart::All, 2).unwrap();
        assert_eq!((kept.interval, kept.clock), (2.0 / 120.0, FrameSpacing::Given));
        assert!(Kept::choose(10, None, None, VideoPart::All, 1).unwrap_err().to_string().contains("--fps"));
    }
}
