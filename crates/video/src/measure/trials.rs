//! Made trajectories: how often the equation that is chosen is the true one, and the missing term the one that was left out.

use std::sync::Arc;

use anyhow::{Context, Result};

use super::candidates::{SIDE, candidates, for_frames};
use super::explain::explain;
use super::missing_term::missing_term;
use super::recording::{Observation, Positions, RecordedSystem, Recording, learned_from};
use super::results::MissingTerm;
use super::scale::Scale;
use super::selection::Selection;
use super::starts::starts;
use paig::network::cells::{CellKind, Equations, Walls};
use paig::network::{System, system::SystemTable};
use paig::support::random::{named_generator, normal};
use paig::tasks::equation_file::EquationFile;
use paig::tasks::video::Video;

/// Pixels of the made video to a pixel of a frame of [`SIDE`] pixels.
const PIXELS: f64 = 10.0;
/// Frames of the pieces with which fits begin.
const PIECE: usize = 12;

/// Positions of objects in one made video.
#[derive(Debug, Clone)]
pub struct Trial {
    pub objects: usize,
    /// `(x, y)` of each object, in frames of `side` pixels, frame by frame.
    pub positions: Vec<f64>,
    pub side: f64,
    /// Distance of the walls from the frame's edges, pixels.
    pub wall_margin: f64,
    /// Time between two frames, seconds.
    pub interval: f64,
    /// Standard deviation of the noise, pixels of a video ten times as large as a frame of 64 pixels.
    pub noise: f64,
    pub seed: u64,
}

/// The equations that explain a trial, the best first, and whether the best one does.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    pub equations: Vec<String>,
    pub explained: bool,
}

impl Trial {
    /// # Errors
    /// No equation that can be fitted.
    pub fn choice(&self) -> Result<Choice> {
        let candidates = candidates(self.objects, self.interval, true);
        let first = candidates.first().context("no equation for so many objects")?;
        let (mut scene, mut observations) = self.scene(&first.cell)?;
        let selection = Selection::of(&mut scene, &mut observations, &candidates)?;
        let equations = selection.ranked.iter().map(|ranked| ranked.candidate.name.clone()).collect();
        Ok(Choice { equations, explained: selection.explained })
    }

    /// The term that an equation lacks for this motion.
    ///
    /// # Errors
    /// An equation that cannot be fitted.
    pub fn missing(&self, equation: &EquationFile) -> Result<Option<MissingTerm>> {
        let cell = for_frames(equation, SIDE, self.interval).kind(self.objects, &Equations::default())?;
        let (scene, observations) = self.scene(&cell)?;
        let tracks = scene.tracks(&observations[0]);
        let dynamics = scene.dynamics(&cell)?;
        let judged = explain(&dynamics, &tracks, &starts(&dynamics, &tracks, PIECE, (&[], true), None))?;
        Ok(missing_term(&scene, &tracks, &judged, self.seed))
    }

    fn scene(&self, cell: &Arc<CellKind>) -> Result<(RecordedSystem, Vec<Observation>)> {
        let per_pixel = SIDE as f64 / self.side;
        let side = (SIDE as f64 * PIXELS) as u32;
        let record = Video {
            size: [side, side],
            crop: [0, 0, i64::from(side)],
            step: 1,
            film_step: Some(1),
            time_unit: "s".into(),
            frame_seconds: self.interval,
            pixels_per_metre: None,
            scale_percent: 0.0,
            time_percent: 0.0,
            origin: None,
            angle: 0.0,
            y_up: false,
            sources: Vec::new(),
        };
        let table = SystemTable {
            side: SIDE,
            channels: 3,
            objects: self.objects,
            input_steps: 4,
            pred_steps: 6,
            dt: self.interval,
            equation: EquationFile::built_in("falling").equation,
            wall_margin: None,
        };
        let walls = Walls::new(SIDE, per_pixel * self.wall_margin);
        let system = System { cell: cell.clone(), walls, ..table.system(0.0, &Equations::default())? };
        let frames = self.positions.len() / (2 * self.objects);
        let mut random = named_generator(self.seed, "noise of a trial");
        let pixels: Vec<f64> =
            self.positions.iter().map(|x| per_pixel * x + self.noise / PIXELS * normal(&mut random)).collect();
        let recording = Recording {
            name: "trial".into(),
            first_seconds: 0.0,
            times: (0..frames).map(|frame| frame as f64 * self.interval).collect(),
            numbers: Vec::new(),
            trained: learned_from(frames),
            teaches: true,
        };
        let observation = Observation { by: "made".into(), recordings: vec![Positions::even(pixels.clone(), pixels)] };
        let scene = RecordedSystem {
            scale: Scale::new(&record, &system),
            record,
            dt: system.dt,
            system,
            may_drift: false,
            piece: PIECE,
            recordings: vec![recording],
        };
        Ok((scene, vec![observation]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::results::Quantity;

    /// A throw from (8, 40), its vertex within the frame; positions have a drag along the path where `drag` says so.
    fn throw(drag: f64) -> Trial {
        let (interval, steps) = (1.0 / 30.0, 100);
        let step = interval / f64::from(steps);
        let (mut at, mut speed) = ([8.0, 40.0], [22.0, -24.0]);
        let mut positions = Vec::new();
        for _ in 0..60 {
            positions.extend(at);
            for _ in 0..steps {
                let size = f64::hypot(speed[0], speed[1]);
                speed = [speed[0] - step * drag * size * speed[0], speed[1] + step * (20.0 - drag * size * speed[1])];
                at = [0, 1].map(|axis| at[axis] + step * speed[axis]);
            }
        }
        Trial { objects: 1, positions, side: 64.0, wall_margin: 0.0, interval, noise: 0.5, seed: 1 }
    }

    #[test]
    fn a_throw_is_a_fall_and_lacks_nothing() {
        let choice = throw(0.0).choice().unwrap();
        assert!(choice.explained && choice.equations[0] == "falling", "{choice:?}");
        assert_eq!(throw(0.0).missing(&EquationFile::built_in("falling")).unwrap(), None);
    }

    /// Euler's steps of a hundredth of a frame move the drag by less than 1 %; the noise does so by some 3 %.
    #[test]
    fn the_drag_of_a_throw_is_named_with_its_size() {
        let choice = throw(0.02).choice().unwrap();
        assert!(choice.explained && choice.equations[0] == "fall_quadratic_drag", "{choice:?}");
        let missing = throw(0.02).missing(&EquationFile::built_in("falling")).unwrap().unwrap();
        assert_eq!(missing.name, "quadratic friction (drag)");
        // 0.02 to a pixel of the frame is 0.002 to one of the ten times larger video.
        let Quantity { value, .. } = missing.quantities[0];
        assert!((value / 0.002 - 1.0).abs() < 0.1, "{value}");
        let again = EquationFile::from_text("extended", &missing.equation.unwrap()).unwrap();
        assert_eq!(throw(0.02).missing(&again).unwrap(), None);
    }
}
