//! What a dataset shows: the motion, and how the moving things look. Pure data, used by the task table.

/// How the objects of a scene move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Straight lines and elastic walls; the balls pass through each other.
    Bouncing,
    /// Two bodies of unit mass, `F = k (|d| - 2 equil)` along their separation d.
    Spring {
        k: f64,
        /// Half the rest length, pixels: the original's `equil`, the paper's l.
        equil: f64,
        /// Keep both balls in one half of the image during input and prediction.
        half_pane: bool,
        /// Each body is also held back by a force of `damping` times its velocity.
        damping: f64,
    },
    /// Three bodies of mass m, `F = g m^2 / d^2` for each pair.
    ThreeBodies { g: f64, m: f64 },
    /// One ball in a uniform field of gravity.
    Falling {
        /// Pixels per squared time unit, downwards.
        g: f64,
        /// Elastic walls on all sides; without them clips in which the ball touches a wall are thrown away.
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
}

impl Motion {
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

    /// Numbers that place one object: x and y, or an angle.
    pub fn coordinates(self) -> usize {
        if matches!(self, Self::Pendulum { .. }) { 1 } else { 2 }
    }
}

/// What is drawn at the objects' positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// Filled discs on black, object j in channel 2 - j; white where there is one channel only.
    Balls,
    /// MNIST digits, digit j in channel j, over a darkened CIFAR-10 image.
    Digits,
    /// A red bar that turns about a black hub, on white.
    Bar,
}

/// A system as the generator sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scene {
    pub motion: Motion,
    /// Amplitudes of the initial velocity, pixels per time unit; 0 for a bar, whose motion has a spin instead.
    pub speed: [f64; 2],
    /// Radius of an object, pixels (used for drawing balls and for walls); 0 for a bar.
    pub radius: f64,
    pub look: Look,
}

/// What lies behind the objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Background {
    /// Black; white behind a bar.
    Plain,
    /// The same darkened CIFAR-10 image in all clips.
    Cifar,
    /// A darkened CIFAR-10 image drawn for each clip.
    RandomCifar,
}

impl Look {
    /// What lies behind the objects in the task table's scenes.
    pub fn background(self) -> Background {
        if self == Self::Digits { Background::Cifar } else { Background::Plain }
    }
}
