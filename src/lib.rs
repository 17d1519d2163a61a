//! Physics-as-Inverse-Graphics: objects, positions and physical parameters from unlabelled video.
//!
//! A port of Jaques, Burke, Hospedales, *Physics-as-Inverse-Graphics: Unsupervised Physical Parameter Estimation from
//! Video* (ICLR 2020) and of its TensorFlow 1 code onto libtorch. Modules are named after the original's files. To read
//! it beside the paper, follow the data: [`network::system`], then [`network::physics_models`] (encoder, velocity,
//! decoder, losses), [`network::cells`] (the equations), [`network::stn`], then [`training`].
//!
//! A model is built for a [`network::System`], trained by a [`training::trainer::Trainer`], and used in parts or as a whole:
//!
//! ```
//! # fn main() -> anyhow::Result<()> {
//! use paig::network::{cells::Actions, physics_models::{ModelOptions, PhysicsNet}};
//! use tch::{Device, Kind, Tensor};
//!
//! let task = paig::tasks::find("spring_color")?;
//! let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 0)?;
//! // Two clips of twelve frames, [batch, time, channels, side, side] in 0..1.
//! let clips = Tensor::rand([2, 12, 3, 32, 32], (Kind::Float, Device::Cpu));
//! let pass = model.forward(&clips, &Actions::none())?;
//! // The model encodes four frames and predicts the eight after them.
//! assert_eq!(pass.predictions.size(), [2, 8, 3, 32, 32]);
//! assert_eq!(model.parameter_values(), [("k", 1.0), ("l", 31.0 / 32.0)]);
//! # Ok(())
//! # }
//! ```
//!
//! `examples/` trains in process, adds an equation, and takes a saved model apart.
//!
//! The library never prints, never exits and reads no arguments. Modules in the order of their imports: support, network,
//! tasks, datasets, generators, runs, evaluation, training, viz, run.
//!
//! # Crates
//!
//! Each crate depends on those below it:
//!
//! ```text
//!  paig-cli         paig-studio      paig-python
//!  the program      browser page     Python module
//!    |   |               |                |
//!    |   +---------------+-------+--------+
//!    |                           |
//!    |                      paig-video
//!    |                      filmed videos to tasks, and to parameters with intervals
//!    |                        |        |            |           |
//!  paig-experiments           |   paig-report   paig-track   paig-decode
//!  sweeps, stress suite,      |   reports of    positions    frames and
//!  baselines, control         |   many runs     of objects   time stamps
//!    |                        |        |
//!    +-----------+------------+--------+
//!                |
//!              paig       this crate
//!                |
//!           paig-kernels  U-Net, masks, drawing, loss, roll-out
//!                |
//!            libtorch     by the crate `tch`
//! ```

#![deny(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

pub mod datasets;
pub mod evaluation;
pub mod generators;
pub mod network;
pub mod run;
pub mod runs;
pub mod support;
pub mod tasks;
pub mod training;
pub mod viz;

pub use paig_kernels as kernels;
pub use support::error::{Error, ErrorKind, Excerpt, Result};
