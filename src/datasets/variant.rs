//! What to generate: a task's scene with its numbers, some of them changed, and the file name that says so.

use std::path::PathBuf;

use anyhow::{Result, bail, ensure};

use super::render::{CHANNELS, DIGIT_RADIUS};
use super::scene::{Look, Motion, Scene};
use super::simulate::World;
use crate::tasks::Task;

/// Euler steps a frame; the model takes 5.
pub const SUBSTEPS: usize = 10;
/// Distance of a digit's centre from a wall at which it touches, pixels: its sprite may hang over the border.
const DIGIT_WALL_MARGIN: f64 = 2.0;
/// Time between two frames that the authors' file names leave out.
const UNNAMED_DT: f64 = 0.3;

/// Numbers of a scene to change; `None` keeps the task's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Changes {
    pub k: Option<f64>,
    pub equil: Option<f64>,
    pub g: Option<f64>,
    pub m: Option<f64>,
    pub vx: Option<f64>,
    pub vy: Option<f64>,
    pub radius: Option<f64>,
    pub dt: Option<f64>,
    pub substeps: Option<usize>,
    pub size: Option<usize>,
}

/// Everything that decides what a clip looks like, but its length and its number.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    pub task: &'static Task,
    pub scene: Scene,
    /// Side of the frames, pixels.
    pub side: usize,
    /// Time between two frames.
    pub dt: f64,
    pub substeps: usize,
    pub seed: u64,
}

impl Variant {
    /// A task's scene as the paper has it.
    pub fn new(task: &'static Task, seed: u64) -> Self {
        Self { task, scene: task.scene, side: task.side, dt: task.dt, substeps: SUBSTEPS, seed }
    }

    /// The scene with other numbers.
    ///
    /// # Errors
    /// A number that the task's motion does not have, or one out of range.
    pub fn with(mut self, changes: &Changes) -> Result<Self> {
        let task = self.task.key;
        let put = |flag: &str, slot: Option<&mut f64>, value: Option<f64>, minimum: f64| -> Result<()> {
            let Some(value) = value else { return Ok(()) };
            let Some(slot) = slot else { bail!("--{flag} means nothing for task {task}; leave it out") };
            ensure!(value.is_finite() && value >= minimum, "--{flag} must be at least {minimum}, not {value}");
            *slot = value;
            Ok(())
        };
        let (mut k, mut equil, mut g, mut m) = (None, None, None, None);
        match &mut self.scene.motion {
            Motion::Bouncing => {}
            Motion::Spring { k: stiffness, equil: half_length, .. } => {
                (k, equil) = (Some(stiffness), Some(half_length));
            }
            Motion::ThreeBodies { g: strength, m: mass } => (g, m) = (Some(strength), Some(mass)),
        }
        put("k", k, changes.k, 0.0)?;
        put("equil", equil, changes.equil, 0.1)?;
        put("g", g, changes.g, 0.0)?;
        put("m", m, changes.m, 0.0)?;
        let [vx, vy] = &mut self.scene.speed;
        put("vx", Some(vx), changes.vx, 0.0)?;
        put("vy", Some(vy), changes.vy, 0.0)?;
        // A digit's radius is that of its sprite.
        let radius = (self.scene.look == Look::Balls).then_some(&mut self.scene.radius);
        put("radius", radius, changes.radius, 0.5)?;
        put("dt", Some(&mut self.dt), changes.dt, 1e-6)?;
        self.substeps = changes.substeps.unwrap_or(self.substeps);
        self.side = changes.size.unwrap_or(self.side);
        self.check()?;
        Ok(self)
    }

    fn check(&self) -> Result<()> {
        ensure!((1..=100_000).contains(&self.substeps), "--substeps must be 1 to 100000, not {}", self.substeps);
        ensure!((8..=512).contains(&self.side), "--size must be 8 to 512 pixels, not {}", self.side);
        let world = self.world();
        let room = self.side as f64;
        let length = if let Motion::Spring { equil, .. } = self.scene.motion { equil } else { 0.0 };
        ensure!(
            2.0 * (world.radius + length) < room,
            "objects of radius {} with --equil {length} do not fit into --size {}",
            world.radius,
            self.side
        );
        let step = self.scene.speed[0].max(self.scene.speed[1]) * self.dt / self.substeps as f64;
        ensure!(
            step < room / 4.0,
            "at this speed an object jumps {step} pixels a substep in a frame of {}; raise --substeps or lower --dt",
            self.side
        );
        Ok(())
    }

    /// The box and the law of motion.
    pub fn world(&self) -> World {
        let wall_margin = match self.scene.look {
            Look::Balls => self.scene.radius,
            Look::Digits => DIGIT_WALL_MARGIN,
        };
        World {
            motion: self.scene.motion,
            speed: self.scene.speed,
            radius: if self.scene.look == Look::Digits { DIGIT_RADIUS } else { self.scene.radius },
            wall_margin,
            side: self.side as f64,
            dt: self.dt,
            substeps: self.substeps,
            pane_frames: self.task.input_steps + self.task.pred_steps,
        }
    }

    /// Bytes of one frame.
    pub fn frame_bytes(&self) -> usize {
        self.side * self.side * CHANNELS
    }

    /// Objects in the scene.
    pub fn objects(&self) -> usize {
        self.task.objects
    }

    /// File for clips of `frames` frames, relative to the datasets folder: the authors' naming with this variant's
    /// values, so the task's own file names where nothing was changed. What their names do not mention is added where
    /// it differs from the task's. Numbers of clips and seeds are not in the name.
    pub fn file(&self, frames: usize) -> PathBuf {
        let [vx, vy] = self.scene.speed;
        let kind = match (self.scene.motion, self.scene.look) {
            (Motion::Bouncing, _) => "bounce",
            (Motion::Spring { .. }, Look::Balls) => "spring",
            (Motion::Spring { .. }, Look::Digits) => "mnist_spring",
            (Motion::ThreeBodies { .. }, _) => "3bp",
        };
        let mut name = format!("color_{kind}_vx{vx}_vy{vy}_sl{frames}_r{}", self.world().wall_margin);
        match self.scene.motion {
            Motion::Bouncing => {}
            Motion::Spring { k, equil, .. } => name += &format!("_k{k}_e{equil}"),
            Motion::ThreeBodies { g, m } => name += &format!("_g{g}_m{m}"),
        }
        if self.dt != UNNAMED_DT {
            name += &format!("_dt{}", self.dt.to_string().replace('.', ""));
        }
        if let Motion::Spring { half_pane: true, .. } = self.scene.motion {
            name += "_halfpane";
        }
        if self.side != self.task.side {
            name += &format!("_size{}", self.side);
        }
        if self.substeps != SUBSTEPS {
            name += &format!("_substeps{}", self.substeps);
        }
        let folder = std::path::Path::new(self.task.train_file).parent().unwrap_or(std::path::Path::new(""));
        folder.join(name + ".npz")
    }
}
