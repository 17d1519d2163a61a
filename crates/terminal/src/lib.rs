//! What the programs share: options of a run, lines and progress bars, signals, exit codes.

pub mod arguments;
mod banner;
pub mod ending;
pub mod generate_display;
pub mod interrupt;
pub mod progress;
pub mod run;
pub mod screen;
mod surroundings;
pub mod table;
pub mod usage;
