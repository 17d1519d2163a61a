//! What a made-up video shows: how its objects move, and how they look. Pure data, part of a task file.

use std::fmt;

use anyhow::{Result, bail, ensure};
use serde::{Deserialize, Serialize};

use super::camera::Camera;
pub use super::looks::Background;
use super::looks::{BackgroundLook, Distractor, ObjectLooks, check_radius};
use crate::network::System;
use crate::network::cells::{CellKind, Coordinates};
use crate::support::toml_values::exact;

/// Half the width of a digit, pixels: 28 px MNIST images cut to 22.
pub const DIGIT_RADIUS: f64 = 11.0;
/// The frame shows a pendulum's lengths up to this to each side of the hub, in its unit of length.
pub const BAR_VIEW: f64 = 2.2;
/// Half a pendulum's width, by which its rounded ends also reach beyond its length.
pub const BAR_HALF_WIDTH: f64 = 0.1;
/// Distance of a digit's centre from a wall at which it touches, pixels: its sprite may hang over the border.
const DIGIT_WALL_MARGIN: f64 = 2.0;
/// Colours of balls in frames of three channels: the original's three, then mixtures of two of them.
const COLOURS: [[f64; 3]; 6] =
    [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]];
/// Time between two frames that the authors' file names leave out.
const UNNAMED_DT: f64 = 0.3;

fn is_zero(number: &f64) -> bool {
    *number == 0.0
}

/// How the objects of a scene move.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "law", rename_all = "snake_case", deny_unknown_fields)]
pub enum Motion {
    /// Straight lines and elastic walls; the balls pass through each other.
    Bouncing {},
    /// Two bodies of unit mass, `F = k (|d| - 2 equil)` along their separation d.
    Spring {
        k: f64,
        /// Half the rest length, pixels: the original's `equil`, the paper's l.
        equil: f64,
        /// Keep both balls in one half of the image during input and prediction.
        #[serde(default)]
        half_pane: bool,
        /// Each body is also held back by a force of `damping` times its velocity.
        #[serde(default)]
        damping: f64,
    },
    /// Three bodies of mass m, `F = g m^2 / d^2` for each pair.
    ThreeBodies { g: f64, m: f64 },
    /// Balls in a uniform field of gravity.
    Falling {
        /// Pixels per squared time unit, downwards.
        g: f64,
        /// Elastic walls on all sides; without them clips in which a ball touches a wall are thrown away.
        #[serde(default)]
        bounces: bool,
    },
    /// A rod that turns about its end, `3 g / (2 length) sin(angle) + 3 a u / (m length^2)` being its angular
    /// acceleration, as in OpenAI Gym's `Pendulum`. The angle is 0 upright and grows clockwise on the screen, radians.
    Pendulum {
        g: f64,
        m: f64,
        length: f64,
        /// Actuation coefficient: a torque u acts as `a u`.
        a: f64,
        /// The torque u is drawn anew for each frame, uniformly between -torque and torque.
        torque: f64,
        /// Largest initial angle to either side of upright.
        angle: f64,
        /// Largest initial angular speed, radians per time unit.
        spin: f64,
    },
    /// The system's own equation with the true parameters of the task.
    Equation {},
}

/// Where the objects of an [equation](Motion::Equation) begin. The scene's speed comes on top, in any direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Begin {
    /// One for each object.
    pub positions: Vec<[f64; 2]>,
    /// Largest distance from them on either axis, pixels.
    #[serde(default)]
    pub spread: f64,
    /// One for each object, pixels per time unit; all at rest where none are given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub velocities: Vec<[f64; 2]>,
}

impl Begin {
    fn check(&self, objects: usize, side: usize) -> Result<()> {
        let Begin { positions, spread, velocities } = self;
        ensure!(positions.len() == objects, "begin.positions: there are {} for {objects} objects", positions.len());
        ensure!(
            velocities.is_empty() || velocities.len() == objects,
            "begin.velocities: there are {} for {objects} objects",
            velocities.len()
        );
        let inside = 0.0..side as f64;
        ensure!(
            positions.iter().flatten().all(|x| inside.contains(x))
                && velocities.iter().flatten().all(|v| v.is_finite()),
            "begin: positions must lie in the frame of {side} pixels, and velocities be finite"
        );
        ensure!(inside.contains(spread), "begin.spread = {spread}: must be 0 to {side} pixels");
        Ok(())
    }
}

/// The number of a scene that is the model's parameter of this symbol.
pub(crate) fn number_of(symbol: &str) -> &str {
    match symbol {
        "l" => "equil",
        "c" => "damping",
        same => same,
    }
}

/// The numbers that a motion may have.
const NUMBERS: [&str; 10] = ["k", "equil", "damping", "g", "m", "length", "a", "torque", "angle", "spin"];

impl Motion {
    /// The least that its number of this name may be.
    pub fn least(&self, name: &str) -> f64 {
        match (self, name) {
            (_, "equil" | "length") => 0.1,
            (Self::Pendulum { .. }, "m") => 0.01,
            _ => 0.0,
        }
    }

    fn check(mut self) -> Result<()> {
        for name in NUMBERS {
            let least = self.least(name);
            let Some(&mut value) = self.number(name) else { continue };
            ensure!(
                value.is_finite() && value >= least,
                "motion.{name} = {value}: must be a number, and at least {least}"
            );
        }
        Ok(())
    }

    /// The number of this name, where this motion has one.
    pub fn number(&mut self, name: &str) -> Option<&mut f64> {
        match (self, name) {
            (Self::Spring { k, .. }, "k") => Some(k),
            (Self::Spring { equil, .. }, "equil") => Some(equil),
            (Self::Spring { damping, .. }, "damping") => Some(damping),
            (Self::ThreeBodies { g, .. } | Self::Falling { g, .. } | Self::Pendulum { g, .. }, "g") => Some(g),
            (Self::ThreeBodies { m, .. } | Self::Pendulum { m, .. }, "m") => Some(m),
            (Self::Pendulum { length, .. }, "length") => Some(length),
            (Self::Pendulum { a, .. }, "a") => Some(a),
            (Self::Pendulum { torque, .. }, "torque") => Some(torque),
            (Self::Pendulum { angle, .. }, "angle") => Some(angle),
            (Self::Pendulum { spin, .. }, "spin") => Some(spin),
            _ => None,
        }
    }

    /// The objects it is about; none if any number will do.
    fn objects(self) -> Option<usize> {
        match self {
            Self::Bouncing {} | Self::Falling { .. } | Self::Equation {} => None,
            Self::Spring { .. } => Some(2),
            Self::ThreeBodies { .. } => Some(3),
            Self::Pendulum { .. } => Some(1),
        }
    }

    /// How its objects' places are given.
    pub fn coordinates(self) -> Coordinates {
        if matches!(self, Self::Pendulum { .. }) { Coordinates::Angle } else { Coordinates::Position }
    }

    /// Whether the objects move by this equation, so that its parameters are numbers of the motion.
    fn follows(self, equation: &CellKind) -> bool {
        match (self, &*equation.name) {
            (Self::Bouncing {}, "bouncing") | (Self::Spring { .. }, "damped_spring") => true,
            (Self::Spring { damping, .. }, "spring") => damping == 0.0,
            (Self::ThreeBodies { .. }, "gravity") => true,
            (Self::Falling { bounces, .. }, "falling") => !bounces,
            (Self::Falling { bounces, .. }, "falling_bouncing") => bounces,
            // The equation takes mass and length as 1.
            (Self::Pendulum { m, length, .. }, "pendulum") => m == 1.0 && length == 1.0,
            _ => false,
        }
    }
}

/// What is drawn at the objects' positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Look {
    /// Filled discs on black, of the colours [`colour`]; white where there is one channel only.
    Balls,
    /// MNIST digits, digit j in channel j, over a darkened CIFAR-10 image.
    Digits,
    /// A red bar that turns about a black hub, on white.
    Bar,
}

/// Colour of ball `object` in frames of this many channels, 0 to 1: ball j shines in channel 2 - j, as in the original,
/// later ones in two channels; white where there is one channel. None for more balls than there are colours.
pub fn colour(object: usize, channels: usize) -> Option<Vec<f64>> {
    match channels {
        1 => Some(vec![1.0]),
        _ => COLOURS.get(object).map(|colour| colour.to_vec()),
    }
}

/// A system as the generator sees it.
#[derive(Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    pub motion: Motion,
    /// Amplitudes of the initial velocity, pixels per time unit; 0 for a bar, whose motion has a spin instead.
    #[serde(default, deserialize_with = "exact")]
    pub speed: [f64; 2],
    /// Radius of an object, pixels (used for drawing balls and for walls); 0 for a bar.
    #[serde(default)]
    pub radius: f64,
    pub look: Look,
    /// The action u of an [equation](Motion::Equation) is drawn anew for each frame, uniformly from up to this to either
    /// side; for an equation without u 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub push: f64,
    /// Where the objects begin, if their motion is the system's equation; anywhere off the walls where nothing is said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub begin: Option<Begin>,
    #[serde(default, skip_serializing_if = "ObjectLooks::is_default")]
    pub objects: ObjectLooks,
    /// What lies behind the objects; where nothing is said, a CIFAR-10 image behind digits, nothing behind the others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub background: Option<BackgroundLook>,
    /// From the farthest to the nearest.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub distractors: Vec<Distractor>,
    #[serde(default, skip_serializing_if = "Camera::is_default")]
    pub camera: Camera,
}

/// A plain scene's is written into the files of its clips, so nothing is said of what a plain scene does not have.
impl fmt::Debug for Scene {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        let Scene { motion, speed, radius, look, push, begin, objects, background, distractors, camera } = self;
        let mut text = formatter.debug_struct("Scene");
        text.field("motion", motion).field("speed", speed).field("radius", radius).field("look", look);
        if *push != 0.0 {
            text.field("push", push);
        }
        if let Some(begin) = begin {
            text.field("begin", begin);
        }
        if !objects.is_default() {
            text.field("objects", objects);
        }
        if let Some(background) = background {
            text.field("background", background);
        }
        if !distractors.is_empty() {
            text.field("distractors", distractors);
        }
        if !camera.is_default() {
            text.field("camera", camera);
        }
        text.finish()
    }
}

impl Scene {
    /// What lies behind the objects if nothing else is asked for.
    pub fn background(&self) -> Background {
        match (&self.background, self.look) {
            (Some(background), _) => background.kind,
            (None, Look::Digits) => Background::Cifar,
            (None, Look::Balls | Look::Bar) => Background::Plain,
        }
    }

    /// A background of this kind, with what the scene says of it.
    pub fn background_look(&self, kind: Background) -> BackgroundLook {
        let own = self.background.as_ref().filter(|background| background.kind == kind);
        own.cloned().unwrap_or_else(|| BackgroundLook::of(kind))
    }

    /// Distance of an object's centre from a wall at which it touches, pixels.
    pub fn wall_margin(&self) -> f64 {
        match self.look {
            Look::Balls | Look::Bar => self.radius,
            Look::Digits => DIGIT_WALL_MARGIN,
        }
    }

    /// The authors' name, without folder and ending, for a file with clips of `frames` frames, `dt` apart.
    pub fn file_stem(&self, dt: f64, frames: usize) -> String {
        let [vx, vy] = self.speed;
        let mut name = match (self.motion, self.look) {
            (Motion::Bouncing {}, _) => "color_bounce",
            (Motion::Spring { .. }, Look::Digits) => "color_mnist_spring",
            (Motion::Spring { .. }, _) => "color_spring",
            (Motion::ThreeBodies { .. }, _) => "color_3bp",
            (Motion::Falling { bounces: false, .. }, _) => "falling_ball",
            (Motion::Falling { bounces: true, .. }, _) => "falling_bouncing_ball",
            (Motion::Pendulum { .. }, _) => "color_pendulum",
            (Motion::Equation {}, _) => "equation",
        }
        .to_owned();
        name += &match self.look {
            Look::Bar => format!("_sl{frames}"),
            _ => format!("_vx{vx}_vy{vy}_sl{frames}_r{}", self.wall_margin()),
        };
        match self.motion {
            Motion::Bouncing {} | Motion::Equation {} => {}
            Motion::Spring { k, equil, .. } => name += &format!("_k{k}_e{equil}"),
            Motion::ThreeBodies { g, m } => name += &format!("_g{g}_m{m}"),
            Motion::Falling { g, .. } => name += &format!("_g{g}"),
            Motion::Pendulum { g, m, length, a, torque, .. } => {
                name += &format!("_g{g}_m{m}_l{length}_a{a}_u{torque}");
            }
        }
        if dt != UNNAMED_DT {
            name += &format!("_dt{}", dt.to_string().replace('.', ""));
        }
        if let Motion::Spring { half_pane: true, .. } = self.motion {
            name += "_halfpane";
        }
        name
    }

    /// How much acts from outside at most, to either side: a pendulum's torque, or the push.
    pub fn largest_action(&self) -> f64 {
        match self.motion {
            Motion::Pendulum { torque, .. } => torque,
            _ => self.push,
        }
    }

    /// The value of an equation's parameter in these clips, if they follow that equation.
    pub fn truth(&self, equation: &CellKind, symbol: &str) -> Option<f64> {
        let mut motion = self.motion;
        if motion.follows(equation) { motion.number(number_of(symbol)).map(|value| *value) } else { None }
    }

    /// # Errors
    /// A motion that is not about the system's objects or coordinates, or a look that cannot be drawn in its frames.
    pub fn check(&self, system: &System) -> Result<()> {
        let &System { objects, channels, ref cell, .. } = system;
        if let Some(of_motion) = self.motion.objects() {
            ensure!(objects == of_motion, "this motion has {of_motion} objects, the system {objects}");
        }
        ensure!(
            self.motion.coordinates() == cell.coordinates,
            "the equation {:?} is about {}, this motion is not",
            cell.name,
            match cell.coordinates {
                Coordinates::Position => "positions",
                Coordinates::Angle => "an angle",
            }
        );
        self.motion.check()?;
        let acts = self.largest_action() != 0.0 || matches!(self.motion, Motion::Pendulum { .. });
        ensure!(
            cell.can_be_driven() == acts,
            "the equation {:?} and this motion differ in whether something acts from outside; of an equation with u, \
             scene.push says how much at most",
            cell.name
        );
        ensure!(
            self.push == 0.0 || (self.push.is_finite() && self.push > 0.0 && self.motion == Motion::Equation {}),
            "push = {}: is how much acts at most on what follows the equation, a positive number",
            self.push
        );
        ensure!(
            self.radius.is_finite() && self.radius >= 0.0 && self.speed.iter().all(|v| v.is_finite() && *v >= 0.0),
            "radius {} and speed {:?} must not be negative",
            self.radius,
            self.speed
        );
        if let Some(begin) = &self.begin {
            ensure!(
                self.motion == Motion::Equation {},
                "begin is for the motion {{ law = \"equation\" }}; take it out"
            );
            begin.check(objects, system.side)?;
        }
        self.check_looks(system)?;
        match self.look {
            Look::Digits if objects != 2 || channels != 3 => bail!("digits are two, in frames of 3 channels"),
            Look::Balls if cell.coordinates == Coordinates::Angle => bail!("an angle is drawn as a bar"),
            Look::Bar if cell.coordinates != Coordinates::Angle => bail!("a bar is drawn at the angle of a pendulum"),
            Look::Balls if self.objects.colours.is_empty() && colour(objects - 1, channels).is_none() => {
                bail!("{objects} balls: there are colours for {} only; say others in objects.colours", COLOURS.len())
            }
            Look::Bar if channels != 3 => bail!("a bar is drawn in frames of 3 channels"),
            Look::Balls | Look::Digits | Look::Bar => Ok(()),
        }
    }

    /// Of what the tables below `[scene]` say.
    fn check_looks(&self, system: &System) -> Result<()> {
        let &System { objects, channels, side, .. } = system;
        let Scene { look, background, distractors, camera, .. } = self;
        ensure!(*look == Look::Balls || self.objects.is_default(), "objects: only balls can look otherwise");
        ensure!(
            *look != Look::Bar || (background.is_none() && distractors.is_empty()),
            "background and distractors: nothing lies behind a bar"
        );
        self.objects.check(objects, channels, side)?;
        if *look == Look::Balls && self.objects.radii.is_empty() {
            check_radius("radius", self.radius, side)?;
        }
        background.iter().try_for_each(BackgroundLook::check)?;
        distractors.iter().try_for_each(|distractor| distractor.check(channels, side))?;
        camera.check(side)
    }
}
