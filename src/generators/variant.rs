//! What to generate: a task's scene with its numbers, some of them changed, and the file name that says so.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};

use super::simulate::{InitialValueProblem, PENDULUM_MAX_SPEED, World};
use crate::network::System;
use crate::network::cells::{Integrator, PhysicalParameter, Walls};
use crate::support::random::fnv1a;
use crate::tasks::Task;
use crate::tasks::looks::{BackgroundLook, Distractor};
use crate::tasks::scene::{BAR_HALF_WIDTH, BAR_VIEW, Background, DIGIT_RADIUS, Look, Motion, Scene, number_of};

/// Euler steps a frame; the model takes 5.
pub const SUBSTEPS: usize = 10;
/// Largest angle that a pendulum may turn in a substep, radians.
const LARGEST_TURN: f64 = 0.5;
/// The numbers of a scene that its law of motion depends on.
const LAW: [&str; 7] = ["k", "equil", "damping", "g", "m", "length", "a"];
/// Numbers of a scene to change; `None` keeps the task's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Changes {
    pub k: Option<f64>,
    pub equil: Option<f64>,
    pub damping: Option<f64>,
    pub g: Option<f64>,
    pub m: Option<f64>,
    pub length: Option<f64>,
    pub a: Option<f64>,
    pub torque: Option<f64>,
    pub angle: Option<f64>,
    pub spin: Option<f64>,
    pub vx: Option<f64>,
    pub vy: Option<f64>,
    pub radius: Option<f64>,
    pub dt: Option<f64>,
    pub substeps: Option<usize>,
    pub size: Option<usize>,
    pub background: Option<Background>,
}

/// Everything that decides what a clip looks like, but its length and its number.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    pub task: Task,
    pub scene: Scene,
    /// Side of the frames, pixels.
    pub side: usize,
    /// Time between two frames.
    pub dt: f64,
    pub substeps: usize,
    pub background: Background,
    pub seed: u64,
}

impl Variant {
    /// A task's scene as it is.
    ///
    /// # Errors
    /// A task without a scene.
    pub fn new(task: &Task, seed: u64) -> Result<Self> {
        let scene = task.scene.clone().with_context(|| {
            format!(
                "task {}: there is no [scene] in its file, so no clips can be made; it is for filmed ones",
                task.name
            )
        })?;
        let (side, dt, background) = (task.system.side, task.system.dt, scene.background());
        let variant = Self { task: task.clone(), scene, side, dt, substeps: SUBSTEPS, background, seed };
        variant.check()?;
        Ok(variant)
    }

    /// The scene with other numbers.
    ///
    /// # Errors
    /// A number that the task's scene does not have, or one out of range.
    pub fn with(mut self, changes: &Changes) -> Result<Self> {
        let task = self.task.name.clone();
        let motion = self.scene.motion;
        let put = |flag: &str, slot: Option<&mut f64>, value: Option<f64>, minimum: f64| -> Result<()> {
            let Some(value) = value else { return Ok(()) };
            let Some(slot) = slot else { bail!("--{flag} means nothing for task {task}; leave it out") };
            ensure!(value.is_finite() && value >= minimum, "--{flag} must be at least {minimum}, not {value}");
            *slot = value;
            Ok(())
        };
        for (name, value) in [
            ("k", changes.k),
            ("equil", changes.equil),
            ("damping", changes.damping),
            ("g", changes.g),
            ("m", changes.m),
            ("length", changes.length),
            ("a", changes.a),
            ("torque", changes.torque),
            ("angle", changes.angle),
            ("spin", changes.spin),
        ] {
            put(name, self.scene.motion.number(name), value, motion.least(name))?;
        }
        let Scene { speed: [vx, vy], radius, look, .. } = &mut self.scene;
        let moves = *look != Look::Bar;
        put("vx", moves.then_some(vx), changes.vx, 0.0)?;
        put("vy", moves.then_some(vy), changes.vy, 0.0)?;
        // A digit's radius is that of its sprite.
        put("radius", (*look == Look::Balls).then_some(radius), changes.radius, 0.5)?;
        put("dt", Some(&mut self.dt), changes.dt, 1e-6)?;
        self.substeps = changes.substeps.unwrap_or(self.substeps);
        self.side = changes.size.unwrap_or(self.side);
        if let Some(background) = changes.background {
            ensure!(moves, "--background means nothing for task {task}; leave it out");
            self.background = background;
        }
        self.check()?;
        Ok(self)
    }

    fn check(&self) -> Result<()> {
        ensure!((1..=100_000).contains(&self.substeps), "--substeps must be 1 to 100000, not {}", self.substeps);
        let system = System {
            side: self.side,
            walls: Walls::new(self.side, self.scene.wall_margin()),
            ..self.task.system.clone()
        };
        system.check().with_context(|| format!("--size {}", self.side))?;
        self.scene.check(&system).context("scene")?;
        let h = self.dt / self.substeps as f64;
        if let Motion::Pendulum { length, spin, .. } = self.scene.motion {
            let longest = BAR_VIEW - BAR_HALF_WIDTH;
            ensure!(length <= longest, "--length must be at most {longest} to fit into the frame, not {length}");
            ensure!(spin <= PENDULUM_MAX_SPEED, "--spin must be at most {PENDULUM_MAX_SPEED}, not {spin}");
            let turn = PENDULUM_MAX_SPEED * h;
            ensure!(
                turn <= LARGEST_TURN,
                "a pendulum may turn by {turn} radians a substep; raise --substeps or lower --dt"
            );
            return Ok(());
        }
        let world = self.world();
        let room = self.side as f64;
        let length = if let Motion::Spring { equil, .. } = self.scene.motion { equil } else { 0.0 };
        ensure!(
            2.0 * (world.radius + length) < room,
            "objects of radius {} with --equil {length} do not fit into --size {}",
            world.radius,
            self.side
        );
        let fall = if let Motion::Falling { g, .. } = self.scene.motion { (2.0 * g * room).sqrt() } else { 0.0 };
        let step = (self.scene.speed[0].max(self.scene.speed[1]) + fall) * h;
        ensure!(
            step < room / 4.0,
            "at this speed an object jumps {step} pixels a substep in a frame of {}; raise --substeps or lower --dt",
            self.side
        );
        Ok(())
    }

    /// The box and the law of motion.
    pub fn world(&self) -> World {
        World {
            motion: self.scene.motion,
            law: self.law(),
            speed: self.scene.speed,
            radius: if self.scene.look == Look::Digits { DIGIT_RADIUS } else { self.scene.radius },
            wall_margin: self.scene.wall_margin(),
            objects: self.task.system.objects,
            side: self.side as f64,
            dt: self.dt,
            substeps: self.substeps,
            pane_frames: self.task.system.input_steps + self.task.system.pred_steps,
        }
    }

    /// The true or given value of a parameter of the task's equation.
    fn value(&self, parameter: &PhysicalParameter) -> f64 {
        self.task.truth_of(&parameter.name).or(parameter.fixed).unwrap_or(f64::NAN)
    }

    /// The task's equation with its true parameters, if the objects move by it. A text is integrated by Runge and Kutta's
    /// method, whatever the model takes.
    fn law(&self) -> Option<InitialValueProblem> {
        let Variant { task, scene, .. } = self;
        let unconstrained = |parameter: &PhysicalParameter| parameter.bounds.unconstrained(self.value(parameter));
        let cell = &task.system.cell;
        let precise = cell.integrated_by(Integrator::Rk4).ok().flatten();
        (scene.motion == Motion::Equation {}).then(|| InitialValueProblem {
            equation: precise.map_or_else(|| cell.clone(), Arc::new),
            unconstrained: cell.parameters.iter().map(unconstrained).collect(),
            push: scene.push,
            begin: scene.begin.clone(),
        })
    }

    /// Of the equation and the values of its parameters, if the objects move by it: the same where only the bounds and starts
    /// of a fit are others.
    pub(crate) fn equation_checksum(&self) -> Option<u64> {
        let cell = &self.task.system.cell;
        let values: Vec<f64> = cell.parameters.iter().map(|parameter| self.value(parameter)).collect();
        let checksum = || fnv1a(format!("{} {values:?}", cell.accelerations()).as_bytes());
        (self.scene.motion == Motion::Equation {}).then(checksum)
    }

    /// What lies behind the objects, with all that the scene says of it.
    pub fn background_look(&self) -> BackgroundLook {
        self.scene.background_look(self.background)
    }

    /// Whether anything but the motion is drawn by chance, so that no model can draw all that is seen.
    pub fn is_noisy(&self) -> bool {
        let Scene { distractors, camera, .. } = &self.scene;
        camera.is_noisy() || self.background_look().is_random() || distractors.iter().any(Distractor::is_random)
    }

    /// What a model of the task should find in these clips, in the order of the task's true parameters, one for each; empty
    /// where its equation is not that of the clips: a number that the model takes as given is another one.
    pub fn truth(&self) -> Vec<f64> {
        let Some(usual) = &self.task.scene else { return Vec::new() };
        if self.scene.motion == (Motion::Equation {}) {
            return self.task.truth.iter().map(|parameter| parameter.value).collect();
        }
        let (mut here, mut usual) = (self.scene.motion, usual.motion);
        // Of each true parameter the number of the scene that it is. One of a text may bear such a name and be another.
        let numbers = self.task.truth.iter().map(|parameter| {
            let number = number_of(&parameter.name);
            usual.number(number).is_some_and(|value| *value == parameter.value).then_some(number)
        });
        let numbers: Vec<_> = numbers.collect();
        // A mass is learned only where the strength of gravity is given, and is given where that is learned.
        let learned = |number: &str| number != "m" && numbers.contains(&Some(number));
        let mut given = LAW.into_iter().filter(|number| !learned(number));
        if given.any(|number| here.number(number) != usual.number(number)) {
            return Vec::new();
        }
        let mut value = |number: &str| here.number(number).map(|value| *value);
        let truth = self.task.truth.iter().zip(&numbers);
        truth.map(|(parameter, number)| number.and_then(&mut value).unwrap_or(parameter.value)).collect()
    }

    /// Bytes of one frame.
    pub fn frame_bytes(&self) -> usize {
        self.side * self.side * self.task.system.channels
    }

    /// Numbers that place all objects of a frame.
    pub fn coordinates(&self) -> usize {
        self.task.system.coordinates()
    }

    /// The training file and the test file, with the frames of their clips, relative to the datasets folder: the task's own
    /// where nothing was changed, else by the authors' naming with this variant's values.
    pub fn files(&self) -> [(usize, PathBuf); 2] {
        let task = &self.task;
        let plain = Self::new(task, self.seed).is_ok_and(|plain| plain == *self);
        [(task.train_frames, &task.train_file), (task.test_frames, &task.test_file)]
            .map(|(frames, own)| (frames, if plain { PathBuf::from(own) } else { self.file(frames) }))
    }

    /// What the authors' names do not mention is added where it differs from the task's. Numbers of clips and seeds are
    /// not in the name.
    fn file(&self, frames: usize) -> PathBuf {
        let mut name = self.scene.file_stem(self.dt, frames);
        // What the authors' names have no place for, where it is not the task's.
        let usual_scene = self.task.scene.as_ref().unwrap_or(&self.scene);
        let (mut scene, mut usual) = (self.scene.motion, usual_scene.motion);
        for number in ["damping", "angle", "spin"] {
            if let (Some(value), Some(usual)) = (scene.number(number), usual.number(number))
                && value != usual
            {
                name += &format!("_{number}{value}");
            }
        }
        if self.background != usual_scene.background() {
            name += match self.background {
                Background::Plain => "_plain",
                Background::Cifar => "_cifar",
                Background::RandomCifar => "_randomcifar",
                Background::Texture => "_texture",
                Background::RandomTexture => "_randomtexture",
                Background::Drifting => "_drifting",
                Background::Picture => "_picture",
            };
        }
        if self.side != self.task.system.side {
            name += &format!("_size{}", self.side);
        }
        if self.substeps != SUBSTEPS {
            name += &format!("_substeps{}", self.substeps);
        }
        PathBuf::from(self.task.data_folder()).join(name + ".npz")
    }
}
