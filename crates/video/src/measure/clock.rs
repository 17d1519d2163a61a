//! Frames that the camera or a converter has lost, or shows twice, without a word in the times of the file.
//!
//! A frame that is missing shows as a step twice as long as those before and after it, one that is shown twice as no step
//! at all. One lost frame in twenty seconds puts a fitted swing off by a frame for the rest of the video. Only positions
//! are looked at, no equation: what was held out may be looked at in the same way.
//!
//! A video that was converted from another frame rate shows frames twice, or lacks some, all over, and lasts as long as it
//! should. Only where the object is fast would that be found, so a clock made of it would be wrong: where more is found than
//! a camera does, the frames are taken as even in time.

use paig::support::statistics::upper_median;

/// Steps before and after that are compared with.
const NEIGHBOURS: usize = 5;
/// A step differs by more than so many times what steps usually differ by.
const CLEAR: f64 = 6.0;
/// How far from a whole number of steps it may be, and how far those before and after may be from each other.
const WHOLE: f64 = 0.3;
const EVEN: f64 = 0.3;
/// Most frames that are lost at once.
const MOST_LOST: f64 = 4.0;
/// More frames than these, and than one in so many of all, a camera neither doubles nor loses. Those that make up for each
/// other do not count. Doubled ones are the rarer: of those of a conversion two or three are found in a short fall.
const FEW_TWICE: [usize; 2] = [1, 400];
const FEW_LOST: [usize; 2] = [2, 100];

/// When each frame was filmed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameTimes {
    /// In frames of an even clock, from 0 on.
    pub ticks: Vec<usize>,
    /// Frames after which some are lost, and frames that the next one shows again.
    pub lost_after: Vec<usize>,
    pub shown_twice: Vec<usize>,
    /// Whether there are too many of them for a camera; the ticks are even then.
    pub converted: bool,
}

impl FrameTimes {
    /// That of frames at even times.
    pub fn even(frames: usize) -> Self {
        FrameTimes { ticks: (0..frames).collect(), lost_after: Vec::new(), shown_twice: Vec::new(), converted: false }
    }

    /// From the positions of all objects, `coordinates` numbers a frame.
    pub fn of(positions: &[f64], coordinates: usize) -> Self {
        let frames = positions.len() / coordinates;
        let mut clock = FrameTimes::even(frames);
        let steps: Vec<Vec<f64>> = positions
            .chunks(coordinates)
            .zip(positions.chunks(coordinates).skip(1))
            .map(|(from, to)| from.iter().zip(to).map(|(from, to)| to - from).collect())
            .collect();
        let mut ahead = 0_isize;
        for frame in 0..frames.saturating_sub(1) {
            match whole_steps(&steps, frame) {
                Some(0) => {
                    clock.shown_twice.push(frame);
                    ahead -= 1;
                }
                Some(count) => {
                    clock.lost_after.push(frame);
                    ahead += count as isize - 1;
                }
                None => {}
            }
            clock.ticks[frame + 1] = (frame + 1).saturating_add_signed(ahead);
        }
        let [least, one_in] = if ahead < 0 { FEW_TWICE } else { FEW_LOST };
        if ahead.unsigned_abs() > least + frames / one_in {
            return FrameTimes { ticks: (0..frames).collect(), converted: true, ..clock };
        }
        clock
    }

    /// For people; none where nothing was found. `numbers`: which frames of the video these are, if that is known.
    pub fn text(&self, numbers: &[u64]) -> Option<String> {
        if self.converted {
            return Some(format!(
                "{} frames are shown twice and after {} some are lost: too many for a camera. The video was rather converted \
                 from another frame rate; its frames are taken as even in time. Better import it as the camera made it",
                self.shown_twice.len(),
                self.lost_after.len()
            ));
        }
        let number = |frame: &usize| numbers.get(*frame).copied().unwrap_or(*frame as u64).to_string();
        let list = |frames: &[usize]| frames.iter().map(number).collect::<Vec<_>>().join(", ");
        let lost = (!self.lost_after.is_empty()).then(|| format!("frames are lost after {}", list(&self.lost_after)));
        let twice = (!self.shown_twice.is_empty()).then(|| format!("shown twice are {}", list(&self.shown_twice)));
        let said: Vec<_> = lost.into_iter().chain(twice).collect();
        (!said.is_empty()).then(|| said.join("; ") + " (taken into account)")
    }
}

/// Over how many steps the object went from a frame to the next, if it is clearly not one.
fn whole_steps(steps: &[Vec<f64>], place: usize) -> Option<usize> {
    let before = median_step(steps.get(place.checked_sub(NEIGHBOURS)?..place)?)?;
    let after = median_step(steps.get(place + 1..place + 1 + NEIGHBOURS)?)?;
    let usual: Vec<f64> = before.iter().zip(&after).map(|(a, b)| (a + b) / 2.0).collect();
    let length = dot(&usual, &usual).sqrt();
    let turned = before.iter().zip(&after).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    // An object that is turned round, or stands, says nothing.
    if !(length > 0.0 && turned <= EVEN * length) {
        return None;
    }
    let off = |step: &[f64]| step.iter().zip(&usual).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let neighbours = (place - NEIGHBOURS..=place + NEIGHBOURS).filter(|it| *it != place);
    let usual_scatter = upper_median(neighbours.map(|it| off(&steps[it])))?;
    let step = &steps[place];
    let count = dot(step, &usual) / (length * length);
    let across: Vec<f64> = step.iter().zip(&usual).map(|(step, usual)| step - count * usual).collect();
    let clear = off(step) > CLEAR * usual_scatter && dot(&across, &across).sqrt() < WHOLE * length;
    let whole = count.round();
    let other = whole != 1.0 && (0.0..=MOST_LOST).contains(&whole) && (count - whole).abs() < WHOLE;
    (clear && other).then_some(whole as usize)
}

/// Of each coordinate.
fn median_step(steps: &[Vec<f64>]) -> Option<Vec<f64>> {
    (0..steps[0].len()).map(|coordinate| upper_median(steps.iter().map(|step| step[coordinate]))).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use paig::support::random::{named_generator, normal};

    fn seen(times: &[f64]) -> Vec<f64> {
        let mut random = named_generator(2, "clock");
        let mut place = |time: f64| {
            let angle = 0.5 * (0.05 * time).cos();
            [40.0 * angle.sin() + 0.03 * normal(&mut random), 40.0 * angle.cos() + 0.03 * normal(&mut random)]
        };
        times.iter().flat_map(|time| place(*time)).collect()
    }

    #[test]
    fn lost_and_doubled_frames_are_found_where_the_object_is_fast() {
        let even: Vec<f64> = (0..240).map(f64::from).collect();
        assert_eq!(FrameTimes::of(&seen(&even), 2), FrameTimes::even(240));
        // The swing is fastest at 31, 94 and 157.
        let lost: Vec<f64> = (0..240).filter(|tick| *tick != 32).map(f64::from).collect();
        let clock = FrameTimes::of(&seen(&lost), 2);
        assert_eq!((clock.lost_after.as_slice(), clock.ticks[31], clock.ticks[32]), (&[31][..], 31, 33));
        let mut twice = even.clone();
        twice.insert(95, 94.0);
        let clock = FrameTimes::of(&seen(&twice), 2);
        assert_eq!((clock.shown_twice.as_slice(), clock.ticks[95], clock.ticks[96]), (&[94][..], 94, 95));
        assert_eq!(clock.text(&[]).unwrap(), "shown twice are 94 (taken into account)");
        // By their numbers in the video, where these are known.
        let numbers: Vec<u64> = (118..318).collect();
        assert_eq!(clock.text(&numbers).unwrap(), "shown twice are 212 (taken into account)");
        // A frame that comes late: shown twice the one before, then a step of two. However many, they make up for each other.
        let late: Vec<f64> = (0..240).map(|tick| f64::from(if tick % 63 == 32 { tick - 1 } else { tick })).collect();
        let clock = FrameTimes::of(&seen(&late), 2);
        assert!(
            clock.shown_twice.len() >= 3
                && clock.lost_after == clock.shown_twice.iter().map(|it| it + 1).collect::<Vec<_>>()
        );
        assert_eq!(clock.ticks, (0..240).map(|tick| tick - usize::from(tick % 63 == 32)).collect::<Vec<_>>());
    }

    /// A fall that was filmed at one rate and stored at another: the nearest frame before at each time.
    #[test]
    fn a_video_of_another_rate_keeps_its_even_clock() {
        for (filmed, stored) in [(25.0, 30.0), (24.0, 30.0), (50.0, 60.0), (30.0, 60.0), (60.0, 50.0)] {
            let mut random = named_generator(2, "fall");
            let fallen: Vec<[f64; 2]> = (0..90)
                .map(|frame| f64::from(frame) / filmed)
                .map(|time| [5.0 + 2.0 * time, 2.0 + 15.0 * time * time].map(|x: f64| x + 0.03 * normal(&mut random)))
                .collect();
            let frames = (1.4 * stored) as usize;
            let at = |frame: usize| fallen[(frame as f64 / stored * filmed + 0.83) as usize];
            let clock = FrameTimes::of(&(0..frames).flat_map(at).collect::<Vec<_>>(), 2);
            assert_eq!(clock.ticks, FrameTimes::even(frames).ticks, "{filmed} as {stored}: {:?}", clock.text(&[]));
            assert!(clock.text(&[]).unwrap().contains("another frame rate"), "{:?}", clock.text(&[]));
        }
    }

    #[test]
    fn a_bounce_is_no_lost_frame() {
        let bounces: Vec<f64> = (0..90).flat_map(|frame| [10.0, (f64::from(frame % 30) - 14.6).abs()]).collect();
        assert_eq!(FrameTimes::of(&bounces, 2), FrameTimes::even(90));
    }
}
