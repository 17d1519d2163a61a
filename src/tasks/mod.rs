//! The task table: one row for each system, and the only place where a system's numbers stand.
//!
//! Lengths are in pixels (the pendulum's in rods), times in the paper's time unit (one frame is `dt` of it), positions are
//! `(x, y)` with x to the right and y down, or angles. Where the original has the system, key and file names are its own,
//! so its files and ours are interchangeable.
//! Original: the `datasets` and `--task` tables of `run_physics.py`, README; paper: section 4.1.

pub mod scene;

use std::f64::consts::FRAC_PI_2;

use anyhow::{Result, anyhow};
use tch::Tensor;

use crate::network::cells::{self, Cell, CellKind, Walls};
use crate::tasks::scene::{Look, Motion, Scene};

/// A physical parameter with the value the data were made with. The value scores a run; training never sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueParameter {
    /// Symbol of the paper: `k`, `l`, `g`, `m`, `a`.
    pub name: &'static str,
    pub value: f64,
}

/// One system: what its videos look like, how they are cut into input and prediction, and what is to be learned.
#[derive(Debug, Clone)]
pub struct Task {
    /// Name on the command line, in run folders and in `summary.json`.
    pub key: &'static str,
    /// One line for `--help`.
    pub summary: &'static str,
    /// Side S of the square frames, pixels.
    pub side: usize,
    /// Colour channels of a frame.
    pub channels: usize,
    /// Frames of a training clip and of a test clip.
    pub train_frames: usize,
    pub test_frames: usize,
    /// L: frames the encoder sees before the roll-out starts.
    pub input_steps: usize,
    /// T_pred: predicted frames that enter the training loss. What follows in a clip is T_ext, scored only.
    pub pred_steps: usize,
    /// The differential equation.
    pub cell: &'static CellKind,
    /// Time between two frames.
    pub dt: f64,
    /// N: moving objects.
    pub objects: usize,
    pub truth: &'static [TrueParameter],
    /// Learning rate and weight alpha of the reconstruction loss in the paper's protocol.
    pub base_lr: f64,
    pub alpha: f64,
    /// The authors' dataset files, relative to `data/datasets`.
    pub train_file: &'static str,
    pub test_file: &'static str,
    /// How the data are made.
    pub scene: Scene,
}

/// Rows are told apart by their keys.
impl PartialEq for Task {
    fn eq(&self, other: &Task) -> bool {
        self.key == other.key
    }
}

impl Task {
    /// Where a ball's centre turns.
    pub fn walls(&self) -> Walls {
        Walls::new(self.side, self.scene.radius)
    }

    /// The equation with these log-parameters, one for each of the cell's.
    pub fn build_cell(&self, logs: &[Tensor]) -> Box<dyn Cell> {
        (self.cell.build)(logs, self.walls())
    }

    /// Numbers in a position of all objects.
    pub fn coordinates(&self) -> usize {
        self.objects * self.cell.coordinates.per_object()
    }
}

const SPRING_K4_L6: &[TrueParameter] =
    &[TrueParameter { name: "k", value: 4.0 }, TrueParameter { name: "l", value: 6.0 }];

/// All tasks.
pub const TASKS: &[Task] = &[
    Task {
        key: "bouncing_balls",
        summary: "two coloured balls that bounce off the walls",
        side: 32,
        channels: 3,
        train_frames: 12,
        test_frames: 30,
        input_steps: 4,
        pred_steps: 6,
        cell: &cells::BOUNCING,
        dt: 0.3,
        objects: 2,
        truth: &[],
        base_lr: 3e-4,
        alpha: 2.0,
        train_file: "bouncing/color_bounce_vx8_vy8_sl12_r2.npz",
        test_file: "bouncing/color_bounce_vx8_vy8_sl30_r2.npz",
        scene: Scene { motion: Motion::Bouncing, speed: [8.0, 8.0], radius: 2.0, look: Look::Balls },
    },
    Task {
        key: "spring_color",
        summary: "two coloured balls joined by a spring",
        side: 32,
        channels: 3,
        train_frames: 12,
        test_frames: 30,
        input_steps: 4,
        pred_steps: 6,
        cell: &cells::SPRING,
        dt: 0.3,
        objects: 2,
        truth: SPRING_K4_L6,
        base_lr: 6e-4,
        alpha: 3.0,
        train_file: "spring_color/color_spring_vx8_vy8_sl12_r2_k4_e6.npz",
        test_file: "spring_color/color_spring_vx8_vy8_sl30_r2_k4_e6.npz",
        scene: Scene {
            motion: Motion::Spring { k: 4.0, equil: 6.0, half_pane: false, damping: 0.0 },
            speed: [8.0, 8.0],
            radius: 2.0,
            look: Look::Balls,
        },
    },
    Task {
        key: "spring_color_half",
        summary: "the spring, seen in one half of the frame during input and prediction",
        side: 32,
        channels: 3,
        train_frames: 12,
        test_frames: 30,
        input_steps: 4,
        pred_steps: 6,
        cell: &cells::SPRING,
        dt: 0.3,
        objects: 2,
        truth: SPRING_K4_L6,
        base_lr: 6e-4,
        alpha: 3.0,
        train_file: "spring_color_half/color_spring_vx4_vy4_sl12_r2_k4_e6_halfpane.npz",
        test_file: "spring_color_half/color_spring_vx4_vy4_sl30_r2_k4_e6_halfpane.npz",
        scene: Scene {
            motion: Motion::Spring { k: 4.0, equil: 6.0, half_pane: true, damping: 0.0 },
            speed: [4.0, 4.0],
            radius: 2.0,
            look: Look::Balls,
        },
    },
    Task {
        key: "damped_spring",
        summary: "the spring with friction: the worked example of a cell of one's own",
        side: 32,
        channels: 3,
        train_frames: 12,
        test_frames: 30,
        input_steps: 4,
        pred_steps: 6,
        cell: &cells::DAMPED_SPRING,
        dt: 0.3,
        objects: 2,
        truth: &[
            TrueParameter { name: "k", value: 4.0 },
            TrueParameter { name: "l", value: 6.0 },
            TrueParameter { name: "c", value: 0.3 },
        ],
        base_lr: 6e-4,
        alpha: 3.0,
        train_file: "damped_spring/color_spring_vx8_vy8_sl12_r2_k4_e6.npz",
        test_file: "damped_spring/color_spring_vx8_vy8_sl30_r2_k4_e6.npz",
        scene: Scene {
            motion: Motion::Spring { k: 4.0, equil: 6.0, half_pane: false, damping: 0.3 },
            speed: [8.0, 8.0],
            radius: 2.0,
            look: Look::Balls,
        },
    },
    Task {
        key: "mnist_spring_color",
        summary: "two MNIST digits joined by a spring over a CIFAR-10 background",
        side: 64,
        channels: 3,
        train_frames: 12,
        test_frames: 30,
        input_steps: 3,
        pred_steps: 7,
        cell: &cells::SPRING,
        dt: 0.3,
        objects: 2,
        truth: &[TrueParameter { name: "k", value: 2.0 }, TrueParameter { name: "l", value: 12.0 }],
        base_lr: 6e-4,
        alpha: 3.0,
        train_file: "mnist_spring_color/color_mnist_spring_vx8_vy8_sl12_r2_k2_e12.npz",
        test_file: "mnist_spring_color/color_mnist_spring_vx8_vy8_sl30_r2_k2_e12.npz",
        scene: Scene {
            motion: Motion::Spring { k: 2.0, equil: 12.0, half_pane: false, damping: 0.0 },
            speed: [8.0, 8.0],
            radius: 11.0,
            look: Look::Digits,
        },
    },
    Task {
        key: "3bp_color",
        summary: "three coloured balls that attract each other",
        side: 36,
        channels: 3,
        train_frames: 20,
        test_frames: 40,
        input_steps: 4,
        pred_steps: 12,
        cell: &cells::GRAVITY,
        dt: 0.5,
        objects: 3,
        truth: &[TrueParameter { name: "g", value: 60.0 }, TrueParameter { name: "m", value: 1.0 }],
        base_lr: 1e-3,
        alpha: 5.0,
        train_file: "3bp_color/color_3bp_vx2_vy2_sl20_r2_g60_m1_dt05.npz",
        test_file: "3bp_color/color_3bp_vx2_vy2_sl40_r2_g60_m1_dt05.npz",
        scene: Scene {
            motion: Motion::ThreeBodies { g: 60.0, m: 1.0 },
            speed: [2.0, 2.0],
            radius: 2.0,
            look: Look::Balls,
        },
    },
    Task {
        key: "pendulum",
        summary: "a pendulum that is driven by a known torque",
        side: 64,
        channels: 3,
        train_frames: 14,
        test_frames: 30,
        input_steps: 4,
        pred_steps: 6,
        cell: &cells::PENDULUM,
        dt: 0.05,
        objects: 1,
        truth: &[TrueParameter { name: "g", value: 10.0 }, TrueParameter { name: "a", value: 1.0 }],
        base_lr: 6e-4,
        alpha: 3.0,
        train_file: "pendulum/color_pendulum_sl14_g10_m1_l1_a1_u2_dt005.npz",
        test_file: "pendulum/color_pendulum_sl30_g10_m1_l1_a1_u2_dt005.npz",
        scene: Scene {
            motion: Motion::Pendulum { g: 10.0, m: 1.0, length: 1.0, a: 1.0, torque: 2.0, angle: FRAC_PI_2, spin: 2.0 },
            speed: [0.0; 2],
            radius: 0.0,
            look: Look::Bar,
        },
    },
    Task {
        key: "falling",
        summary: "a white ball that is thrown and falls",
        side: 32,
        channels: 1,
        train_frames: 12,
        test_frames: 30,
        input_steps: 4,
        pred_steps: 6,
        cell: &cells::FALLING,
        dt: 0.3,
        objects: 1,
        truth: &[TrueParameter { name: "g", value: 1.5 }],
        base_lr: 6e-4,
        alpha: 3.0,
        train_file: "falling_ball/falling_ball_vx2_vy7_sl12_r3_g1.5.npz",
        test_file: "falling_ball/falling_ball_vx2_vy7_sl30_r3_g1.5.npz",
        scene: Scene {
            motion: Motion::Falling { g: 1.5, bounces: false },
            speed: [2.0, 7.0],
            radius: 3.0,
            look: Look::Balls,
        },
    },
    Task {
        key: "falling_bouncing",
        summary: "a white ball that falls and bounces off the walls",
        side: 32,
        channels: 1,
        train_frames: 12,
        test_frames: 30,
        input_steps: 4,
        pred_steps: 6,
        cell: &cells::FALLING_BOUNCING,
        dt: 0.3,
        objects: 1,
        truth: &[TrueParameter { name: "g", value: 3.0 }],
        base_lr: 6e-4,
        alpha: 3.0,
        train_file: "falling_bouncing_ball/falling_bouncing_ball_vx4_vy4_sl12_r3_g3.npz",
        test_file: "falling_bouncing_ball/falling_bouncing_ball_vx4_vy4_sl30_r3_g3.npz",
        scene: Scene {
            motion: Motion::Falling { g: 3.0, bounces: true },
            speed: [4.0, 4.0],
            radius: 3.0,
            look: Look::Balls,
        },
    },
];

/// All keys, for people to read.
pub fn keys() -> String {
    TASKS.iter().map(|task| task.key).collect::<Vec<_>>().join(", ")
}

/// The row with this key.
///
/// # Errors
/// An unknown key, with the list of those there are.
pub fn find(key: &str) -> Result<&'static Task> {
    TASKS.iter().find(|task| task.key == key).ok_or_else(|| anyhow!("unknown task {key:?}; the tasks are {}", keys()))
}

/// Test losses of the paper (its ablation table, row "joint training").
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperLosses {
    pub reconstruction: f64,
    pub prediction: f64,
}

/// The paper does not name the system of that row; others who reran the code read it as `spring_color`.
pub const PAPER_SPRING_LOSSES: PaperLosses = PaperLosses { reconstruction: 0.63, prediction: 1.39 };

/// What the paper reports for a task, if anything.
pub fn paper_losses(key: &str) -> Option<PaperLosses> {
    (key == "spring_color").then_some(PAPER_SPRING_LOSSES)
}
