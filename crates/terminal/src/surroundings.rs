//! The process's surroundings in which no command can work. On Linux the program `paig` tries the working directory and the limit of
//! addresses before, since libtorch's and oneMKL's constructors end the process.

use std::fs;

use anyhow::{Result, bail, ensure};

/// Permissions of the owner, without which a program cannot read what it wrote.
const OWNER: u32 = 0o700;

/// # Errors
/// A working directory that was removed, a umask that denies the owner.
pub fn check() -> Result<()> {
    if let Err(error) = std::env::current_dir() {
        bail!("the working directory cannot be used: {error}; change to another one");
    }
    if let Some(mask) = umask() {
        ensure!(mask & OWNER == 0, "umask {mask:03o} denies you your own files; set umask 022");
    }
    Ok(())
}

fn umask() -> Option<u32> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let mask = status.lines().find_map(|line| line.strip_prefix("Umask:"))?;
    u32::from_str_radix(mask.trim(), 8).ok()
}
