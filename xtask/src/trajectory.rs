//! Trajectories of made motions, integrated apart from the library's integrators.

/// Integration steps between two frames.
const SUBSTEPS: usize = 200;

/// Times of the frames.
pub struct SampleTimes {
    pub frames: usize,
    /// Frames a second.
    pub rate: f64,
}

impl SampleTimes {
    /// From the first frame to the last.
    pub fn seconds(&self) -> f64 {
        (self.frames - 1) as f64 / self.rate
    }
}

/// State of all objects: positions and velocities.
pub type MotionState = (Vec<[f64; 2]>, Vec<[f64; 2]>);

/// Positions of each object at the frames, by many steps of the explicit midpoint rule; `event` may change the state after
/// each.
pub fn integrate(
    clock: &SampleTimes,
    (mut at, mut speed): MotionState,
    acceleration: impl Fn(&[[f64; 2]], &[[f64; 2]]) -> Vec<[f64; 2]>,
    mut event: impl FnMut(&mut MotionState),
) -> Vec<Vec<[f64; 2]>> {
    let step = 1.0 / clock.rate / SUBSTEPS as f64;
    let moved = |from: &[[f64; 2]], by: &[[f64; 2]], time: f64| -> Vec<[f64; 2]> {
        from.iter().zip(by).map(|(x, v)| [x[0] + time * v[0], x[1] + time * v[1]]).collect()
    };
    let mut positions = vec![Vec::with_capacity(clock.frames); at.len()];
    for _ in 0..clock.frames {
        positions.iter_mut().zip(&at).for_each(|(all, at)| all.push(*at));
        for _ in 0..SUBSTEPS {
            let half = (moved(&at, &speed, step / 2.0), moved(&speed, &acceleration(&at, &speed), step / 2.0));
            let push = acceleration(&half.0, &half.1);
            let mut state = (moved(&at, &half.1, step), moved(&speed, &push, step));
            event(&mut state);
            (at, speed) = state;
        }
    }
    positions
}
