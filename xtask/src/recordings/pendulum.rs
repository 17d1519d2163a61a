//! The pendulum of all recordings: a bob on a string with slight friction, in metres and seconds.

use paig_video::measure::motion;

/// Acceleration of gravity, m/s^2: that of the measured equation.
const GRAVITY: f64 = 9.80665;
/// Length of the string, m, friction, 1/s, and first angle, radians.
pub const LENGTH: f64 = 0.65;
const FRICTION: f64 = 0.03;
const ANGLE: f64 = 0.35;
/// Steps of the integration in a second: their error is far below a rounding of the pictures.
const STEPS: f64 = 4000.0;
/// Samples a second of which the true period is taken.
const FINE: f64 = 480.0;

/// Angles over time.
pub struct Pendulum {
    angles: Vec<f64>,
}

impl Pendulum {
    /// Let go at rest, for so many seconds.
    pub fn new(seconds: f64) -> Self {
        let acceleration = |[angle, speed]: [f64; 2]| -GRAVITY / LENGTH * angle.sin() - FRICTION * speed;
        let slope = |state: [f64; 2]| [state[1], acceleration(state)];
        let ahead = |state: [f64; 2], slope: [f64; 2], time: f64| [0, 1].map(|k| state[k] + time * slope[k]);
        let (step, mut state, mut angles) = (1.0 / STEPS, [ANGLE, 0.0], Vec::new());
        // Fourth-order Runge-Kutta.
        for _ in 0..=(seconds * STEPS) as usize + 1 {
            angles.push(state[0]);
            let first = slope(state);
            let second = slope(ahead(state, first, 0.5 * step));
            let third = slope(ahead(state, second, 0.5 * step));
            let fourth = slope(ahead(state, third, step));
            let mean = [0, 1].map(|k| (first[k] + 2.0 * second[k] + 2.0 * third[k] + fourth[k]) / 6.0);
            state = ahead(state, mean, step);
        }
        Pendulum { angles }
    }

    /// Place of the bob from where the string hangs, x right and y down, m.
    pub fn place(&self, time: f64) -> [f64; 2] {
        let at = (time * STEPS).clamp(0.0, (self.angles.len() - 2) as f64);
        let (before, part) = (at as usize, at.fract());
        let angle = self.angles[before] + part * (self.angles[before + 1] - self.angles[before]);
        [LENGTH * angle.sin(), LENGTH * angle.cos()]
    }

    /// Mean period over a time, s: what a measurement quotes.
    pub fn period(&self, seconds: f64) -> Option<f64> {
        let across: Vec<f64> = (0..(seconds * FINE) as usize).map(|k| self.place(k as f64 / FINE)[0]).collect();
        motion::period(&across).map(|frames| frames / FINE)
    }
}
