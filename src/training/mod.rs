//! Training: the loop, the optimizers, the config, and the phases, each in a file with its config.
//!
//! Read [`base`] (the loop), then the phases in their order: [`discover`], [`identify`] (or [`pretrain`], where a black box
//! is in the place of the physics), [`join`]. A [`trainer::Trainer`]
//! goes through them.
//!
//! The recipe `fast` with one changed key:
//!
//! ```
//! use paig::training::config::Config;
//! use paig::training::layers::Overrides;
//!
//! let set = vec!["join.max_steps=40".to_string()];
//! let config = Config::load(None, &Overrides { task: Some("spring_color".into()), set, ..Overrides::default() })?;
//! let phases: Vec<_> = config.phases().iter().map(|phase| phase.name()).collect();
//! assert_eq!(phases, ["discover", "identify", "join"]);
//!
//! let unknown = Overrides { set: vec!["join.steps=40".to_string()], ..Overrides::default() };
//! assert!(Config::load(None, &unknown).is_err());
//! # Ok::<(), anyhow::Error>(())
//! ```

pub mod base;
pub mod config;
pub mod discover;
pub(crate) mod footprint;
mod guide_clock;
pub mod identify;
pub mod join;
pub mod layers;
pub mod objective;
pub mod objects;
pub mod observer;
pub mod optimizers;
pub mod phase;
pub mod pretrain;
mod ranges;
pub mod recorder;
pub mod saved;
pub mod schedule;
pub(crate) mod tensorboard;
pub mod trained;
pub mod trainer;
pub mod verdict;
