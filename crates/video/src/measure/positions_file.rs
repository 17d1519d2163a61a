//! positions.csv: where every object was seen in every frame and where the equation has it.

use std::io::Write;
use std::path::Path;

use anyhow::Result;

use super::dynamics::Dynamics;
use super::measured::MeasuredSubject;
use paig::network::cells::Coordinates;
use paig::support::atomic;
use paig::support::significant::six_digits;
use paig::support::statistics::upper_median;

/// The file's name.
pub(super) const FILE: &str = "positions.csv";

/// Where the equation has what is seen of an object in one frame: pixels of a frame, and those per unit of `dt`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PredictedPoint {
    pub at: [f64; 2],
    pub velocity: [f64; 2],
}

impl PredictedPoint {
    /// The same with what is seen beside the state.
    fn beside(self, dynamics: &Dynamics, unconstrained: &[f64], object: usize, time: f64) -> Self {
        let coordinate = |axis: usize| 2 * object + axis;
        PredictedPoint {
            at: [0, 1].map(|axis| self.at[axis] + dynamics.beside(unconstrained, time, coordinate(axis))),
            velocity: [0, 1].map(|axis| self.velocity[axis] + dynamics.drift(unconstrained, coordinate(axis))),
        }
    }
}

impl MeasuredSubject<'_> {
    /// Where the equation has the objects of a video, frame by frame, object by object.
    pub(super) fn places(&self, video: usize) -> Vec<PredictedPoint> {
        let system = &self.explained.dynamics.system;
        let (objects, per_object) = (system.objects, system.cell.coordinates.per_object());
        let state_size = 2 * objects * per_object;
        let middle = system.side as f64 / 2.0;
        let distances = self.distances(self.pixels[video], middle);
        let of_state = |state: &[f64]| {
            let (pos, vel) = state.split_at(objects * per_object);
            let place = |object: usize| match system.cell.coordinates {
                Coordinates::Position => PredictedPoint {
                    at: [pos[2 * object], pos[2 * object + 1]],
                    velocity: [vel[2 * object], vel[2 * object + 1]],
                },
                // What turns is seen at one distance from the middle; 0 is up, positive clockwise.
                Coordinates::Angle => {
                    let ((sin, cos), distance) = (pos[object].sin_cos(), distances[object]);
                    PredictedPoint {
                        at: [middle + distance * sin, middle - distance * cos],
                        velocity: [distance * cos * vel[object], distance * sin * vel[object]],
                    }
                }
            };
            (0..objects).map(place).collect::<Vec<_>>()
        };
        let states = self.explained.states[video].chunks(state_size);
        let dynamics = &self.explained.dynamics;
        let unconstrained = &self.explained.fitted.unconstrained;
        let of_frame = |(state, time): (&[f64], &f64)| {
            let places = of_state(state).into_iter().enumerate();
            places.map(|(object, place)| place.beside(dynamics, unconstrained, object, *time)).collect::<Vec<_>>()
        };
        states.zip(&self.scene.recordings[video].times).flat_map(of_frame).collect()
    }

    /// Of each object, the median distance from the middle.
    fn distances(&self, pixels: &[f64], middle: f64) -> Vec<f64> {
        let objects = self.explained.dynamics.system.objects;
        (0..objects)
            .map(|object| {
                let places = pixels.chunks(2).skip(object).step_by(objects);
                upper_median(places.map(|at| (at[0] - middle).hypot(at[1] - middle))).unwrap_or(0.0)
            })
            .collect()
    }
}

/// One line for each object in each frame.
pub(super) fn write(path: &Path, measured: &MeasuredSubject) -> Result<()> {
    let (scale, objects) = (&measured.scene.scale, measured.explained.dynamics.system.objects);
    let unit = scale.length_unit();
    let second = scale.seconds;
    atomic::write_file(path, |file| {
        writeln!(
            file,
            "video,frame,seconds,object,part,seen_x_video_px,seen_y_video_px,fitted_x_video_px,fitted_y_video_px,\
             seen_x_{unit},seen_y_{unit},fitted_x_{unit},fitted_y_{unit},fitted_vx_{unit}_per_s,fitted_vy_{unit}_per_s"
        )?;
        for (video, recording) in measured.scene.recordings.iter().enumerate() {
            let places = measured.places(video);
            for (row, (at, fitted)) in measured.pixels[video].chunks(2).zip(places).enumerate() {
                let (frame, object) = (row / objects, row % objects + 1);
                let part = match frame < recording.trained {
                    true if recording.teaches => "learned",
                    true => "begin",
                    false => "held out",
                };
                let number = recording.numbers.get(frame).map_or(frame, |number| *number as usize);
                let name = recording.name.replace(',', "_");
                let seconds = recording.first_seconds + second * recording.times[frame];
                write!(file, "{name},{number},{},{object},{part}", six_digits(seconds))?;
                let at = [at[0], at[1]];
                let numbers = [
                    scale.in_video(at),
                    scale.in_video(fitted.at),
                    scale.on_axes(at),
                    scale.on_axes(fitted.at),
                    scale.velocity_on_axes(fitted.velocity),
                ];
                for number in numbers.iter().flatten() {
                    write!(file, ",{}", six_digits(*number))?;
                }
                writeln!(file)?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use paig::network::System;

    /// What drifts moves as fast as its places say.
    #[test]
    fn a_drift_is_in_the_velocity_too() {
        let system = paig::tasks::builtin("falling").unwrap().system;
        let dynamics = Dynamics::new(System { objects: 1, ..system }, 0.1).unwrap();
        let unconstrained = [12.0_f64.ln(), 0.5, -2.0];
        let rests = PredictedPoint { at: [3.0, 4.0], velocity: [0.0, 0.0] };
        let [first, later] = [0.0, 1.0].map(|time| rests.beside(&dynamics, &unconstrained, 0, time));
        assert_eq!((first.at, first.velocity), (rests.at, [0.5, -2.0]));
        // Rounding of float64.
        for axis in 0..2 {
            assert!((later.at[axis] - first.at[axis] - first.velocity[axis]).abs() < 1e-12, "{later:?}");
        }
    }
}
