//! What the programs share: arguments, lines on the screen, signals.

pub mod arguments;
pub mod interrupt;
pub mod progress;
pub mod run;
pub mod table;
