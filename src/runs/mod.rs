//! The folder of a run: one typed writer and reader for each of its files.
//!
//! `metrics.jsonl`, written and read:
//!
//! ```
//! use paig::runs::metrics::{Record, RecordKind, parse, points};
//!
//! let mut file = Vec::new();
//! Record::begin().write(&mut file)?;
//! Record { pred_loss: Some(0.09), ..Record::new(RecordKind::Valid, "join", 40) }.write(&mut file)?;
//! assert_eq!(points(&parse(&file)?, Some(RecordKind::Valid), "pred_loss"), [(40.0, 0.09)]);
//! # Ok::<(), anyhow::Error>(())
//! ```

pub mod checkpoint;
pub(crate) mod config_file;
pub mod convert;
pub mod course;
pub mod find;
pub mod folder;
pub mod metrics;
pub mod run;
pub mod run_config;
pub mod scores;
pub mod summary;
pub(crate) mod tensorboard;
pub mod verdict;
pub mod weights;
