//! Many runs: [`sweep`]s over seeds and settings, the [`stress`] suite, the comparison with other models ([`baselines`]),
//! and [`control`] with the learned physics.

#![deny(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

pub mod baselines;
pub mod control;
pub mod stress;
pub mod sweep;
