//! Many runs: [`sweep`]s over seeds and settings, the [`stress`] suite, other models ([`baselines`]), [`control`] with
//! the learned physics, and the [`comparison`] of all models.

#![deny(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

pub mod baselines;
pub mod comparison;
pub mod control;
pub mod stress;
pub mod sweep;
