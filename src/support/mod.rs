//! What every other folder may use: the best assignment, files that appear whole or not at all, command lines, the device, errors by
//! kind, JSON in lines, memory, rules for outputs, names of a run's files, picture files, random numbers, significant digits,
//! medians, fast arithmetic, processor time, the values of TOML files.
//!
//! Medians with their range, as the reports have them:
//!
//! ```
//! use paig::support::significant::significant;
//! use paig::support::statistics::Spread;
//!
//! let spread = Spread::of([3.9922, 3.9936, 3.9921]).expect("there are values");
//! assert_eq!(spread.text(|value| significant(value, 4)), "3.992 [3.992, 3.994]");
//! ```

pub(crate) mod assignment;
pub mod atomic;
pub mod command_line;
pub mod device;
pub(crate) mod error;
pub mod exit_codes;
pub mod fast_math;
pub mod guard;
pub mod json_lines;
pub mod least_squares;
pub mod memory;
pub mod output;
pub mod picture_file;
pub mod random;
pub mod run_names;
pub mod significant;
pub mod statistics;
pub mod storage;
pub mod thread_time;
pub mod toml_values;
