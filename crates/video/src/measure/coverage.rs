//! How often the intervals hold the truth: made trajectories with noise, fitted and bootstrapped as those of a video.

use anyhow::Result;
use rand::Rng;

use super::bootstrap::bootstrap;
use super::dynamics::Dynamics;
use super::explain::explain;
use super::fit::{Observations, Start};
use super::results::Quantity;
use paig::support::random::{named_generator, normal};
use paig::tasks::Task;

/// Standard deviation of the noise, pixels.
const NOISE: f64 = 0.1;

/// Trajectories of one kind.
#[derive(Debug, Clone, Copy)]
pub struct TrajectoryKind {
    pub name: &'static str,
    task: &'static str,
    /// Videos, and frames of each that are learned from.
    videos: usize,
    frames: usize,
    /// Correlation of the noise of neighbouring frames.
    pub correlation: f64,
    /// Where the object begins and how fast, and how both are spread.
    begin: [f64; 2],
    speed: [f64; 2],
    spread: [f64; 2],
}

const FALL: &str = include_str!("../../../../configs/gallery/fall_linear_drag.toml");
const SWING: &str = include_str!("../../../../configs/gallery/damped_pendulum.toml");

/// Small sets: few and short videos.
pub const KINDS: [TrajectoryKind; 4] = [
    TrajectoryKind {
        name: "fall with drag, independent noise",
        task: FALL,
        videos: 3,
        frames: 24,
        correlation: 0.0,
        begin: [10.0, 6.0],
        speed: [2.0, 0.0],
        spread: [3.0, 2.0],
    },
    TrajectoryKind {
        name: "fall with drag, correlated noise",
        task: FALL,
        videos: 3,
        frames: 24,
        correlation: 0.6,
        begin: [10.0, 6.0],
        speed: [2.0, 0.0],
        spread: [3.0, 2.0],
    },
    TrajectoryKind {
        name: "swing, independent noise",
        task: SWING,
        videos: 1,
        frames: 80,
        correlation: 0.0,
        begin: [46.0, 26.0],
        speed: [0.0, 0.0],
        spread: [3.0, 0.0],
    },
    TrajectoryKind {
        name: "swing, correlated noise",
        task: SWING,
        videos: 1,
        frames: 80,
        correlation: 0.6,
        begin: [46.0, 26.0],
        speed: [0.0, 0.0],
        spread: [3.0, 0.0],
    },
];

/// How often the interval of one parameter held the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct IntervalCoverage {
    pub parameter: String,
    pub held: usize,
    pub sets: usize,
}

impl TrajectoryKind {
    /// Fits `sets` data sets; one that cannot be fitted counts as not held.
    ///
    /// # Errors
    /// A task file that cannot be read.
    pub fn coverage(&self, sets: usize, seed: u64) -> Result<Vec<IntervalCoverage>> {
        let task = Task::from_toml(self.task)?;
        let parameters = &task.system.cell.parameters;
        let dynamics = Dynamics::new(task.system.clone(), task.system.dt)?;
        let truth: Vec<f64> =
            parameters.iter().map(|it| it.bounds.unconstrained(task.truth_of(&it.name).unwrap_or(f64::NAN))).collect();
        let mut held: Vec<_> =
            parameters.iter().map(|it| IntervalCoverage { parameter: it.name.to_string(), held: 0, sets }).collect();
        let mut random = named_generator(seed, self.name);
        let learned = vec![true; parameters.len()];
        for set in 0..sets {
            let tracks: Vec<_> = (0..self.videos).map(|_| self.track(&dynamics, &truth, &mut random)).collect();
            // What the phases before find is near the truth.
            let unconstrained = truth.iter().map(|unconstrained| unconstrained + 0.1 * normal(&mut random)).collect();
            let start = Start { unconstrained, learned: learned.clone(), piece: 12 };
            // A fit that leads to infinity holds nothing.
            let Ok(explained) = explain(&dynamics, &tracks, &[start]) else { continue };
            let uncertainty = bootstrap(&dynamics, &tracks, &learned, &explained.fitted, set as u64);
            let Ok(uncertainty) = uncertainty else { continue };
            for (place, held) in held.iter_mut().enumerate() {
                let draws = uncertainty.draws.iter().map(|draw| draw.unconstrained[place]).collect();
                let interval = Quantity::new(&held.parameter, explained.fitted.unconstrained[place], draws);
                let within = |(low, high)| (low..=high).contains(&truth[place]);
                held.held += usize::from(interval.low.zip(interval.high).is_some_and(within));
            }
        }
        Ok(held)
    }

    fn track(&self, dynamics: &Dynamics, truth: &[f64], random: &mut impl Rng) -> Observations {
        let mut around = |middle: [f64; 2], spread: f64| middle.map(|x| x + spread * normal(random));
        let state = [around(self.begin, self.spread[0]), around(self.speed, self.spread[1])].concat();
        let times = dynamics.even_times(self.frames);
        let mut positions = dynamics.positions(truth, &state, &times);
        let own = (1.0 - self.correlation.powi(2)).sqrt();
        for coordinate in 0..2 {
            let mut noise = normal(random);
            for frame in 0..self.frames {
                positions[2 * frame + coordinate] += NOISE * noise;
                noise = self.correlation * noise + own * normal(random);
            }
        }
        Observations::new(positions, times, self.frames)
    }
}
