//! Jumps of a tracked object that no motion makes: where one throw ends and the next one begins, or the tracker goes on with
//! something else.

use super::recording::{Observation, RecordedSystem};

/// Jump, in units of the path that the speeds before and after it explain, and in diameters of the object beyond that.
const STEPS: f64 = 3.0;
const DIAMETERS: f64 = 0.5;
/// Way, in diameters, below which a frame shows the picture before it once more.
const REPEATED: f64 = 0.02;
/// Diameter where it is not known, pixels of a frame.
const UNKNOWN_DIAMETER: f64 = 2.0;
/// Longest gap in which a jump is looked for, in times between two frames.
const GAP: f64 = 3.5;

/// A jump between two frames of a recording, given by their places in it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Jump {
    frames: [usize; 2],
    /// Distance between the paths before and after it in the middle of the gap.
    distance: f64,
}

impl RecordedSystem {
    /// A doubt about recordings in which an object jumps; `diameters` are the objects', pixels of the video.
    pub(super) fn jumps(&self, observation: &Observation, diameters: &[f64]) -> Option<String> {
        let objects = self.system.objects;
        let mut found = Vec::new();
        for (recording, positions) in self.recordings.iter().zip(&observation.recordings) {
            for object in 0..objects {
                let of_object =
                    positions.pixels.chunks(2 * objects).map(|frame| [frame[2 * object], frame[2 * object + 1]]);
                let diameter = diameters.get(object).map_or(UNKNOWN_DIAMETER, |size| size / self.scale.video_pixels);
                let path: Vec<_> = of_object.collect();
                let number = |place: usize| recording.numbers.get(place).copied().unwrap_or(place as u64);
                let jumps = jumps(&recording.times, &path, diameter, GAP * self.dt);
                found.extend(
                    jumps.into_iter().map(|Jump { frames, distance }| (recording, frames.map(number), distance)),
                );
            }
        }
        let (recording, [last, next], distance) = *found.first()?;
        let more = match found.len() {
            1 => String::new(),
            count => format!(" (the first of {count} jumps)"),
        };
        Some(format!(
            "{}: the object jumps by {:.0} px between frames {last} and {next}{more}, as from one throw to the next: give each \
             motion as a part of its own, such as --frames ..{next},{next}..",
            recording.name,
            distance * self.scale.video_pixels
        ))
    }
}

/// Jumps of one object; frames without a position are passed over.
fn jumps(times: &[f64], path: &[[f64; 2]], diameter: f64, longest: f64) -> Vec<Jump> {
    let mut seen: Vec<usize> = (0..path.len().min(times.len())).filter(|place| path[*place][0].is_finite()).collect();
    // The speed beside a repeated picture is none.
    let apart = |a: usize, b: usize| (path[b][0] - path[a][0]).hypot(path[b][1] - path[a][1]);
    seen.dedup_by(|place, kept| apart(*kept, *place) < REPEATED * diameter);
    let velocity = |from: usize, to: usize| {
        let time = times[to] - times[from];
        [0, 1].map(|axis| (path[to][axis] - path[from][axis]) / time)
    };
    let jump = |four: &[usize]| {
        let [a, b, c, d] = *four else { return None };
        let gap = times[c] - times[b];
        let (before, after) = (velocity(a, b), velocity(c, d));
        let apart = [0, 1].map(|axis| path[c][axis] - path[b][axis] - 0.5 * gap * (before[axis] + after[axis]));
        let distance = apart[0].hypot(apart[1]);
        let speeds = before[0].hypot(before[1]) + after[0].hypot(after[1]);
        let explained = STEPS * gap * speeds + DIAMETERS * diameter;
        (gap <= longest && distance > explained).then_some(Jump { frames: [b, c], distance })
    };
    seen.windows(4).filter_map(jump).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A throw of 40 frames, 25 a second, at 75 px/s^2.
    fn throw([x, y]: [f64; 2], [vx, vy]: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
        (0..40).map(move |frame| {
            let time = f64::from(frame) / 25.0;
            [x + vx * time, y + vy * time + 37.5 * time * time]
        })
    }

    fn of(path: &[[f64; 2]]) -> Vec<[usize; 2]> {
        let times: Vec<f64> = (0..path.len()).map(|frame| frame as f64 / 25.0).collect();
        jumps(&times, path, 12.0, GAP / 25.0).into_iter().map(|jump| jump.frames).collect()
    }

    #[test]
    fn throws_that_follow_each_other_are_told_apart() {
        let first = throw([40.0, 60.0], [30.0, -55.0]);
        let next = throw([120.0, 62.0], [-28.0, -60.0]);
        let both: Vec<_> = first.chain(next).collect();
        assert_eq!(of(&both), [[39, 40]]);
    }

    /// A bounce at full speed, an outlier, pictures that are shown twice, and a gap in the middle of a throw are none.
    #[test]
    fn bounces_outliers_and_repeated_pictures_are_no_jumps() {
        let bounce: Vec<_> =
            (0..40).map(|frame| [5.0 * f64::from(frame), (20.0 * f64::from(frame) - 400.0).abs()]).collect();
        assert_eq!(of(&bounce), [[0; 2]; 0]);
        let mut outlier: Vec<_> = throw([40.0, 60.0], [30.0, -55.0]).collect();
        outlier[20][0] += 50.0;
        assert_eq!(of(&outlier), [[0; 2]; 0]);
        let twice: Vec<_> = throw([40.0, 60.0], [80.0, -55.0]).flat_map(|place| [place; 2]).collect();
        assert_eq!(of(&twice), [[0; 2]; 0]);
        let mut gap: Vec<_> = throw([40.0, 60.0], [30.0, -55.0]).collect();
        gap[10..16].fill([f64::NAN; 2]);
        assert_eq!(of(&gap), [[0; 2]; 0]);
    }
}
