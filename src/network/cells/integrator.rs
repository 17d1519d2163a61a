//! Methods of integration, each once: on plain numbers, on tensors, and on the places of a list for a GPU.

use num_traits::{Float, One, Zero};
use serde::{Deserialize, Serialize};

/// Steps for one frame, unless a text says otherwise.
pub const SUBSTEPS: usize = 5;

/// How the state moves on by a time h.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Integrator {
    /// Semi-implicit: the velocity first, then the position with the new velocity. Of the first order; the original's.
    #[default]
    Euler,
    /// Velocity Verlet, of the second order; where a force depends on the velocity, that of the end is extrapolated.
    Verlet,
    /// The classical method of Runge and Kutta, of the fourth order.
    Rk4,
}

/// What is integrated: the accelerations, and the arithmetic on states of whatever kind of number.
pub(super) trait Integrand {
    /// A number for each coordinate of all states: plain numbers, a tensor, places in a list.
    type Values;
    /// A number that they are multiplied by.
    type Scalar: Float;

    /// Accelerations in a state a time `since` after the beginning of the step.
    fn acceleration(&mut self, pos: &Self::Values, vel: &Self::Values, since: Self::Scalar) -> Self::Values;

    /// `from + rate * h`.
    fn along(&mut self, from: Self::Values, rate: &Self::Values, h: Self::Scalar) -> Self::Values;

    fn plus(&mut self, a: Self::Values, b: &Self::Values) -> Self::Values;

    fn twice(&mut self, values: Self::Values) -> Self::Values;

    fn copy(&mut self, values: &Self::Values) -> Self::Values;

    /// Takes back values that are not needed any more.
    fn release(&mut self, values: Self::Values) {
        drop(values);
    }
}

impl Integrator {
    /// Positions and velocities a time `h` later.
    pub(super) fn step<I: Integrand>(self, of: &mut I, [pos, vel]: [I::Values; 2], h: I::Scalar) -> [I::Values; 2] {
        let now = I::Scalar::zero();
        let two = I::Scalar::one() + I::Scalar::one();
        let half = two.recip();
        match self {
            Integrator::Euler => {
                let acceleration = of.acceleration(&pos, &vel, now);
                let vel = of.along(vel, &acceleration, h);
                of.release(acceleration);
                [of.along(pos, &vel, h), vel]
            }
            Integrator::Verlet => {
                let first = of.acceleration(&pos, &vel, now);
                let full = of.copy(&vel);
                let full = of.along(full, &first, h);
                let pos = of.along(pos, &vel, h);
                let pos = of.along(pos, &first, half * h * h);
                let second = of.acceleration(&pos, &full, h);
                let both = of.plus(first, &second);
                let vel = of.along(vel, &both, half * h);
                [full, second, both].into_iter().for_each(|values| of.release(values));
                [pos, vel]
            }
            Integrator::Rk4 => {
                let [v1, a1] = [of.copy(&vel), of.acceleration(&pos, &vel, now)];
                let [v2, a2] = slope(of, [&pos, &vel], [&v1, &a1], half * h);
                let [v3, a3] = slope(of, [&pos, &vel], [&v2, &a2], half * h);
                let [v4, a4] = slope(of, [&pos, &vel], [&v3, &a3], h);
                let sixth = h / (two + two + two);
                [along_mean(of, pos, [v1, v2, v3, v4], sixth), along_mean(of, vel, [a1, a2, a3, a4], sixth)]
            }
        }
    }
}

/// The slope of a state where another slope leads to in a time `by`.
fn slope<I: Integrand>(
    of: &mut I,
    [pos, vel]: [&I::Values; 2],
    [rate, acceleration]: [&I::Values; 2],
    by: I::Scalar,
) -> [I::Values; 2] {
    let (pos, vel) = (of.copy(pos), of.copy(vel));
    let (pos, vel) = (of.along(pos, rate, by), of.along(vel, acceleration, by));
    let acceleration = of.acceleration(&pos, &vel, by);
    of.release(pos);
    [vel, acceleration]
}

/// Where four slopes lead to, those in the middle counted twice; a `sixth` of the step's time.
fn along_mean<I: Integrand>(of: &mut I, from: I::Values, slopes: [I::Values; 4], sixth: I::Scalar) -> I::Values {
    let [first, second, third, fourth] = slopes;
    let middle = of.plus(second, &third);
    let middle = of.twice(middle);
    let sum = of.plus(first, &middle);
    let sum = of.plus(sum, &fourth);
    let end = of.along(from, &sum, sixth);
    [third, middle, sum, fourth].into_iter().for_each(|values| of.release(values));
    end
}
