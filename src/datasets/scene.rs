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
    },
    /// Three bodies of mass m, `F = g m^2 / d^2` for each pair.
    ThreeBodies { g: f64, m: f64 },
}

/// What is drawn at the objects' positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// Filled discs on black, object j in channel 2 - j.
    Balls,
    /// MNIST digits, digit j in channel j, over a darkened CIFAR-10 image.
    Digits,
}

/// A system as the generator sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scene {
    pub motion: Motion,
    /// Amplitudes of the initial velocity, pixels per time unit.
    pub speed: [f64; 2],
    /// Radius of an object, pixels (used for drawing balls and for walls).
    pub radius: f64,
    pub look: Look,
}
