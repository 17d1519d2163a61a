//! Vision-based control: what is seen in pictures is brought to a goal by planning with the learned physics.
//!
//! Paper: section 4.3 (a pendulum is swung up); the authors' code for it was never released. In the order in which the
//! data flow: an [`environment`] ([`pendulum`], or any [`scene`] on which something acts) draws what it does, a
//! [`controller`] turns the frames into a state ([`vision`], [`eyes`]) and asks a [`planner`] ([`cross_entropy`], [`mppi`]) for an
//! action, the planner tries plans on a [`model`] of the world and scores them by a [`reward`], and an [`episode`] sums the
//! rewards; [`figures`] show it. An [`experiment`] plays the same episodes with several planners, a [`study`] is a list of
//! experiments. Nothing but the controllers that are meant as bounds reads a true state.

pub mod controller;
pub mod cross_entropy;
pub mod environment;
pub mod episode;
pub mod experiment;
pub mod eyes;
pub mod faults;
pub mod figures;
pub mod latent;
pub mod learned;
pub mod model;
pub mod mppi;
pub mod pendulum;
pub mod planner;
pub mod plans;
pub mod relearning;
pub mod results;
pub mod reward;
pub mod scene;
pub mod state;
pub mod study;
pub mod vision;
