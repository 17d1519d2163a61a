//! What the programs share: arguments, lines on the screen, signals.

pub mod arguments;
pub mod comparison;
pub mod control;
pub mod ending;
pub mod environment;
pub mod generate_display;
pub mod interrupt;
pub mod measure_display;
pub mod progress;
pub mod run;
pub mod sweep_display;
pub mod table;
pub mod whole;
