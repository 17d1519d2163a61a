//! Feeds changed files to all that reads files of strangers, in processes of their own under a limit of memory and of
//! time, and counts.
//!
//! `cargo xtask fuzz SECONDS` goes through all readers in so many seconds; `SECONDS NAME` only through one. What breaks a reader is kept in `fuzz-found`. Prints a line of JSON at its end.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Args;
use paig_video::import::sources::quiet_decoders;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::inputs::{TARGETS, Target, mutate};

/// Feeds changed files to all that reads files of strangers, and counts.
#[derive(Debug, Args)]
pub struct FuzzArguments {
    seconds: f64,
    /// Only this reader
    reader: Option<String>,
    /// The process of a round, with its seed
    #[arg(long, hide = true, requires = "reader")]
    child: Option<u64>,
}

/// Address space of a reader, kB: a header that claims more must be refused.
const MOST_MEMORY: u64 = 3 << 20;
/// Seconds beyond its time after which a process counts as hanging, on a machine that is busy with other things.
const HANG: u64 = 180;
/// Inputs of one process: equations that were understood stay in its memory.
const ROUND: u64 = 200_000;

/// # Errors
/// A reader that is not there, a process that cannot be started.
pub fn run(arguments: &FuzzArguments) -> Result<()> {
    match (&arguments.reader, arguments.child) {
        (Some(name), Some(seed)) => child(find(name)?, seed, arguments.seconds),
        (None, _) => parent(arguments.seconds, TARGETS.iter().collect()),
        (Some(name), None) => parent(arguments.seconds, vec![find(name)?]),
    }
}

fn find(name: &str) -> Result<&'static Target> {
    TARGETS.iter().find(|target| target.name == name).with_context(|| format!("no reader {name:?}"))
}

/// Reads inputs until the time is over; the number of the one at hand stands in a file.
fn child(target: &Target, seed: u64, seconds: f64) -> Result<()> {
    quiet_decoders();
    let folder = tempfile::tempdir_in(if Path::new("/dev/shm").is_dir() { "/dev/shm" } else { "/tmp" })?;
    let examples = (target.examples)(folder.path());
    let start = Instant::now();
    let mut done = 0;
    let mut slowest = Duration::ZERO;
    while done < ROUND && start.elapsed().as_secs_f64() < seconds {
        let bytes = mutate(&mut ChaCha8Rng::seed_from_u64(seed + done), &examples);
        if done.is_multiple_of(if target.quick { 64 } else { 1 }) {
            println!("at {}", seed + done);
            std::io::stdout().flush()?;
        }
        let since = Instant::now();
        // A panic ends the process: the parent counts it.
        (target.read)(&bytes, folder.path());
        slowest = slowest.max(since.elapsed());
        done += 1;
    }
    let memory = paig::support::memory::resident().map_or(0, |(_, most)| most >> 20);
    println!("done {done} slowest {:.3} memory {memory}", slowest.as_secs_f64());
    Ok(())
}

fn parent(seconds: f64, targets: Vec<&Target>) -> Result<()> {
    let each = seconds / targets.len() as f64;
    let (mut executions, mut crashes) = (0u64, 0u64);
    let mut seed = std::time::SystemTime::UNIX_EPOCH.elapsed()?.as_secs() << 24;
    for target in targets {
        let (start, mut here, mut slowest, mut memory) = (Instant::now(), 0u64, 0.0f64, 0u64);
        while start.elapsed().as_secs_f64() < each {
            let left = each - start.elapsed().as_secs_f64();
            let command = format!(
                "ulimit -v {MOST_MEMORY}; exec timeout {} \"$0\" fuzz {left} {} --child {seed}",
                left as u64 + HANG,
                target.name
            );
            let output = Command::new("sh")
                .args(["-c", &command])
                .arg(std::env::current_exe()?)
                .env("OMP_NUM_THREADS", "1")
                .stdin(Stdio::null())
                .output()?;
            let said = String::from_utf8_lossy(&output.stdout);
            let number = |word: &str| {
                let mut words = said.lines().last()?.split(' ').skip_while(|it| *it != word);
                words.nth(1)?.parse::<f64>().ok()
            };
            let last = said.lines().filter_map(|line| line.strip_prefix("at ")?.parse::<u64>().ok()).next_back();
            if output.status.success() {
                here += number("done").unwrap_or(0.0) as u64;
                slowest = slowest.max(number("slowest").unwrap_or(0.0));
                memory = memory.max(number("memory").unwrap_or(0.0) as u64);
            } else {
                crashes += 1;
                here += last.map_or(0, |last| last - seed);
                let error = String::from_utf8_lossy(&output.stderr);
                fs::create_dir_all("fuzz-found")?;
                let from = last.unwrap_or(seed);
                fs::write(format!("fuzz-found/{}-{from}.txt", target.name), &*error)?;
                eprintln!("{}: {} within 64 inputs of seed {from}: {}", target.name, output.status, error.trim());
            }
            seed += ROUND;
        }
        println!("{:<14} {here:>9} inputs, slowest {slowest:.3} s, at most {memory} MiB", target.name);
        executions += here;
    }
    println!("{{\"fuzz_executions\": {executions}, \"crashes\": {crashes}}}");
    Ok(())
}
