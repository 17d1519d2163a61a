//! Exit codes that programs share.

/// Added to a signal's number it is the exit code of a program that was asked to stop and did: the one that shells give.
pub const SIGNALLED: i32 = 128;
