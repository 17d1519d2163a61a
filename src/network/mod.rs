//! The network: encoder, velocity estimator, physics, decoder. Original: `nn/network`.
//!
//! An equation rolled out:
//!
//! ```
//! use paig::network::cells::{Actions, State};
//! use tch::Tensor;
//!
//! let system = paig::tasks::find("spring_color")?.system;
//! // Unconstrained parameters log k = 0 and log l = 0: the spring is at rest at a distance of 2 l = 2 pixels.
//! let cell = system.build_cell(&[Tensor::from(0.0_f32), Tensor::from(0.0_f32)]);
//! let pos = Tensor::from_slice(&[15.0_f32, 16.0, 17.0, 16.0]).unsqueeze(0);
//! let initial = State { vel: pos.zeros_like(), pos };
//! let states = cell.roll_out(&initial, &Actions::none(), system.dt, 10);
//! assert_eq!(states.len(), 10);
//! assert!(states[9].pos.allclose(&initial.pos, 0.0, 1e-2, false));
//! # Ok::<(), anyhow::Error>(())
//! ```

pub mod blocks;
pub mod cells;
pub mod dynamics;
pub mod initial_values;
pub mod physics_models;
pub mod stn;
pub mod system;
pub mod variable_names;

pub use system::System;
