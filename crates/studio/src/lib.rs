//! A browser page on loopback for measuring one's own video: [`Studio`] serves it, [`prepare`] and the commands of `paig` do
//! the work in processes of their own.
//!
//! Everything that the page does is a command, which it shows; it contains no physics.

#![deny(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

mod access;
mod answers;
mod api;
mod assets;
mod cards;
mod equations;
mod examples;
mod film;
mod found;
mod jobs;
mod preview;
mod project;
mod proposals;
mod server;
mod settings;
mod state;
mod training;
mod uploads;

pub use preview::prepare;
pub use server::{ServerOptions, Studio};
pub use training::train;
