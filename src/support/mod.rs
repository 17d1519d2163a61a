//! What every other folder may use: files that appear whole or not at all, the device, random numbers.

pub mod atomic;
pub mod device;
pub mod random;
