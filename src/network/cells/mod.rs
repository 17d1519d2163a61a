//! Physics cells: the differential equations, each in a file of its own, behind one trait.
//!
//! Original: `nn/network/cells.py`; paper: section 3.2. A frame is integrated in [`SUBSTEPS`] Euler steps. A state holds
//! a position and a velocity for each object: `[batch, 2 * objects]` as `(x0, y0, x1, y1, ..)`, in pixels and pixels per
//! time unit, or one angle each, `[batch, objects]`, in radians (see [`Coordinates`]).
//!
//! A new equation is a few lines of [`text`] in a task file; or, in Rust, a [`Cell`] and its [`CellKind`], here or in a
//! program of one's own: `docs/own-equation.md` goes through both. Those that come with the program are texts under a name,
//! but for [`GRAVITY`].

mod actions;
mod bouncing;
mod built_in;
mod cell;
mod contact;
mod damped_spring;
mod equations;
mod falling;
mod gravity;
mod impact;
mod integrands;
mod integrator;
mod kind;
mod on_gpu;
mod parameter;
mod pendulum;
pub mod plain;
mod spring;
mod state;
pub mod text;
mod unilateral;

pub use actions::Actions;
pub use bouncing::BOUNCING;
pub use built_in::BuiltIn;
pub use cell::{Cell, scalars};
pub use damped_spring::DAMPED_SPRING;
pub use equations::Equations;
pub use falling::{FALLING, FALLING_BOUNCING};
pub use gravity::GRAVITY;
pub use integrator::{Integrator, SUBSTEPS};
pub use kind::{Build, CellKind};
pub use on_gpu::OnGpu;
pub use parameter::{Bounds, PhysicalParameter};
pub use pendulum::{PENDULUM, PlainPendulum};
pub use spring::SPRING;
pub use state::{Coordinates, MOST_OBJECTS, State, Walls};
