//! How often the 95 % intervals of `measure` hold the truth, on made trajectories of known parameters:
//! `cargo xtask interval-coverage 200`.

use clap::Args;
use paig_video::measure::coverage::KINDS;

/// Counts how often the 95 % intervals of a measurement hold the truth.
#[derive(Debug, Args)]
pub struct IntervalCoverageArguments {
    /// Sets of trajectories of each kind
    #[arg(default_value_t = 200)]
    sets: usize,
}

/// # Errors
/// A fit that fails.
pub fn run(arguments: &IntervalCoverageArguments) -> anyhow::Result<()> {
    let sets = arguments.sets;
    println!("{:<40}{:<12}{:>12}", "trajectories", "parameter", "held");
    for kind in KINDS {
        for held in kind.coverage(sets, 0)? {
            let percent = 100.0 * held.held as f64 / held.sets as f64;
            println!("{:<40}{:<12}{percent:>10.1} %", kind.name, held.parameter);
        }
    }
    Ok(())
}
