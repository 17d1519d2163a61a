//! Where the objects of a clip start, how fast, and what acts on them. Original: `nn/datasets/generators.py`.

use std::f64::consts::{FRAC_PI_2, TAU};

use rand::Rng;

use super::simulate::{SceneState, World};
use crate::tasks::scene::{Begin, Motion};

impl World {
    /// One draw of the initial state, before any rule of [`World::clip`] is applied.
    pub fn draw_initial(&self, rng: &mut impl Rng) -> SceneState {
        match self.motion {
            Motion::Bouncing {} => self.draw_free_balls(rng),
            Motion::Equation {} => match self.law.as_ref().and_then(|law| law.begin.as_ref()) {
                Some(begin) => self.draw_around(begin, rng),
                None => self.draw_free_balls(rng),
            },
            Motion::Spring { equil, .. } => self.draw_spring(equil, rng),
            Motion::ThreeBodies { .. } => self.draw_three_bodies(rng),
            Motion::Falling { bounces, .. } => self.draw_falling(bounces, rng),
            Motion::Pendulum { angle, spin, .. } => SceneState {
                positions: vec![either_side(angle, rng)],
                velocities: vec![either_side(spin, rng)],
                action: 0.0,
            },
        }
    }

    /// What acts from outside from one frame to the next: a pendulum's torque, a push. A float32, as the file will hold it,
    /// so that the file says exactly what acted.
    pub(super) fn draw_action(&self, rng: &mut impl Rng) -> f64 {
        let largest = match (self.motion, &self.law) {
            (Motion::Pendulum { torque, .. }, _) => torque,
            (_, Some(law)) if law.push > 0.0 => law.push,
            _ => return 0.0,
        };
        f64::from(either_side(largest, rng) as f32)
    }

    /// Balls anywhere off the walls, each in its own direction. The authors released no generator for these; their
    /// file shows this speed and uniform positions.
    fn draw_free_balls(&self, rng: &mut impl Rng) -> SceneState {
        let positions = (0..self.objects).map(|_| self.uniform_point(self.wall_margin, rng)).collect();
        let velocities = (0..self.objects).map(|_| self.random_velocity(rng)).collect();
        SceneState::in_plane(positions, velocities)
    }

    /// Uniformly around the given places; a velocity in any direction on top of the given ones.
    fn draw_around(&self, begin: &Begin, rng: &mut impl Rng) -> SceneState {
        let (mut positions, mut velocities) = (Vec::new(), Vec::new());
        for (object, place) in begin.positions.iter().enumerate() {
            let given = begin.velocities.get(object).copied().unwrap_or_default();
            let random = self.random_velocity(rng);
            positions.push(place.map(|x| x + either_side(begin.spread, rng)));
            velocities.push([given[0] + random[0], given[1] + random[1]]);
        }
        SceneState::in_plane(positions, velocities)
    }

    /// Centre of mass at least `radius + equil` from every wall; 1 to 3 `equil` between the balls, in any direction.
    fn draw_spring(&self, equil: f64, rng: &mut impl Rng) -> SceneState {
        let centre = self.uniform_point(self.radius + equil, rng);
        let angle = rng.random_range(0.0..TAU);
        let arm = equil * rng.random_range(0.5..1.5);
        let offset = [arm * angle.cos(), arm * angle.sin()];
        let positions =
            vec![[centre[0] + offset[0], centre[1] + offset[1]], [centre[0] - offset[0], centre[1] - offset[1]]];
        let velocities = (0..2).map(|_| self.random_velocity(rng)).collect();
        SceneState::in_plane(positions, velocities)
    }

    /// Three bodies on a circle of 0.75 to 1.25 quarter sides around the image centre, 120 degrees apart (the second
    /// and third up to 0.25 rad off), circling in one sense, with a common drift of up to 0.5 on each axis.
    fn draw_three_bodies(&self, rng: &mut impl Rng) -> SceneState {
        let first = rng.random_range(0.0..TAU);
        let angles = [
            first,
            first + TAU / 3.0 + rng.random_range(-0.25..0.25),
            first + 2.0 * TAU / 3.0 + rng.random_range(-0.25..0.25),
        ];
        let distance = rng.random_range(0.75..1.25) * self.side / 4.0;
        let turn = if rng.random::<bool>() { FRAC_PI_2 } else { -FRAC_PI_2 };
        let drift = [rng.random_range(-0.5..0.5), rng.random_range(-0.5..0.5)];
        let centre = self.side / 2.0;
        let positions = angles.iter().map(|a| [centre + distance * a.cos(), centre + distance * a.sin()]).collect();
        let velocities = angles
            .iter()
            .map(|a| {
                let tangent = a + turn;
                [tangent.cos() * self.speed[0] + drift[0], tangent.sin() * self.speed[1] + drift[1]]
            })
            .collect();
        SceneState::in_plane(positions, velocities)
    }

    /// Balls in any direction: anywhere off the walls, or, where they bounce, in the upper half as in the original
    /// (which let free fall begin there, too, at rest; thrown balls stay in the frame for longer).
    fn draw_falling(&self, bounces: bool, rng: &mut impl Rng) -> SceneState {
        let (mut positions, mut velocities) = (Vec::new(), Vec::new());
        for _ in 0..self.objects {
            let [x, y] = self.uniform_point(self.wall_margin, rng);
            positions.push([x, if bounces { (self.wall_margin + y) / 2.0 } else { y }]);
            velocities.push(self.random_velocity(rng));
        }
        SceneState::in_plane(positions, velocities)
    }

    /// A point at least `margin` from every wall.
    fn uniform_point(&self, margin: f64, rng: &mut impl Rng) -> [f64; 2] {
        let room = self.side - 2.0 * margin;
        [margin + room * rng.random::<f64>(), margin + room * rng.random::<f64>()]
    }

    /// A random direction, its components scaled by the speeds of the two axes.
    fn random_velocity(&self, rng: &mut impl Rng) -> [f64; 2] {
        let angle = rng.random_range(0.0..TAU);
        [angle.cos() * self.speed[0], angle.sin() * self.speed[1]]
    }
}

/// Uniform between `-largest` and `largest`.
fn either_side(largest: f64, rng: &mut impl Rng) -> f64 {
    largest * (2.0 * rng.random::<f64>() - 1.0)
}
