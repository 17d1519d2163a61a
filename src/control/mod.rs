//! Vision-based control: a pendulum that is seen in pictures is swung to a goal by planning with the learned physics.
//!
//! Paper: section 4.3; the authors' code for it was never released. In the order in which the data flow: an
//! [`environment`] draws what it does, a [`controller`] turns the last frames into a state and asks a planner
//! ([`planner`], [`mppi`]) for a torque, the planner tries plans on a [`model`] of the pendulum, and an [`episode`] sums
//! the rewards. Nothing but the controllers that are meant as bounds reads a true state.

pub mod controller;
pub mod environment;
pub mod episode;
pub mod model;
pub mod mppi;
pub mod pendulum_model;
pub mod planner;
pub mod results;
pub mod reward;
pub mod search;
pub mod vision;
