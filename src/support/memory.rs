//! How much memory there is: what cannot fit is refused before it is asked for.

use std::fs;

use anyhow::{Result, anyhow};

use super::error::{Error, ErrorKind};

/// As messages say it: `1.5 GiB`.
pub fn gib(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / (1u64 << 30) as f64)
}

/// Bytes that this process can still take: what the machine has free, its control group allows and its own limit of
/// addresses (`ulimit -v`) leaves. None where the system does not say.
pub fn available() -> Option<u64> {
    [free_on_machine(), left_in_group(), left_of_addresses()].into_iter().flatten().min()
}

/// # Errors
/// More bytes than are available.
pub(crate) fn ensure_free(bytes: u64) -> Result<()> {
    let Some(free) = available() else { return Ok(()) };
    if bytes <= free {
        return Ok(());
    }
    let (bytes, free) = (gib(bytes), gib(free));
    let short =
        anyhow!("it takes {bytes} of memory, {free} are free; free some, raise the limit (ulimit -v), or take less");
    Err(Error::new(ErrorKind::Resources, short).into())
}

/// The memory that this process holds now, bytes: all of it, and the most so far.
pub fn resident() -> Option<(u64, u64)> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    Some((kilobytes(&status, "VmRSS:")?, kilobytes(&status, "VmHWM:")?))
}

fn free_on_machine() -> Option<u64> {
    kilobytes(&fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable:")
}

fn left_in_group() -> Option<u64> {
    let text = |name: &str| fs::read_to_string(format!("/sys/fs/cgroup/{name}")).ok();
    let number = |name: &str| text(name)?.trim().parse::<u64>().ok();
    let taken = number("memory.current")?.saturating_sub(files_held(&text("memory.stat")?));
    Some(number("memory.max")?.saturating_sub(taken))
}

/// Bytes of files that a group holds only until something else needs the room; they count as taken there.
fn files_held(stat: &str) -> u64 {
    let pages = stat.lines().filter_map(|line| line.split_once(' '));
    let of_files = pages.filter(|(name, _)| ["inactive_file", "active_file"].contains(name));
    of_files.filter_map(|(_, bytes)| bytes.trim().parse::<u64>().ok()).sum()
}

fn left_of_addresses() -> Option<u64> {
    let limits = fs::read_to_string("/proc/self/limits").ok()?;
    let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = line.split_whitespace().next()?.parse().ok()?;
    let taken = kilobytes(&fs::read_to_string("/proc/self/status").ok()?, "VmSize:")?;
    Some(limit.saturating_sub(taken))
}

/// The number behind a name, in bytes; the kernel counts in kB of 1024.
fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_were_read_take_no_memory_of_a_group() {
        let stat = "anon 500\nfile 90\nshmem 20\ninactive_anon 7\nactive_anon 8\ninactive_file 30\nactive_file 40\n";
        assert_eq!(files_held(stat), 70);
    }

    #[test]
    fn what_does_not_fit_is_refused_with_both_numbers() {
        assert!(available().is_some_and(|bytes| bytes > 1 << 20));
        ensure_free(1).unwrap();
        let said = ensure_free(1 << 60).unwrap_err().to_string();
        assert!(said.starts_with("it takes 1073741824.0 GiB of memory, "), "{said}");
    }
}
