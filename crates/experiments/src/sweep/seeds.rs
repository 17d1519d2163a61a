//! Seeds as people write them.

use std::collections::HashSet;

use anyhow::{Context, Result, ensure};

/// Most runs of a sweep, and so most seeds.
pub const MOST_RUNS: usize = 100_000;

/// Reads `0-9`, `1,4,7-8`; each once.
///
/// # Errors
/// Anything else, a range that runs backwards, more than [`MOST_RUNS`].
pub fn parse_seeds(text: &str) -> Result<Vec<u64>> {
    let number = |text: &str| {
        let number = text.trim().parse::<u64>().ok();
        number
            .with_context(|| format!("--seeds: {text:?} is not a number from 0 on; seeds are given as 0-9 or 1,4,7-8"))
    };
    let (mut seeds, mut known) = (Vec::new(), HashSet::new());
    let mut add = |seed: u64, seeds: &mut Vec<u64>| seeds.extend(known.insert(seed).then_some(seed));
    for part in text.split(',') {
        match part.split_once('-') {
            None => add(number(part)?, &mut seeds),
            Some((first, last)) => {
                let (first, last) = (number(first)?, number(last)?);
                ensure!(first <= last, "--seeds: {part:?} runs backwards");
                let more = usize::try_from(last - first).unwrap_or(usize::MAX);
                ensure!(
                    more < MOST_RUNS - seeds.len().min(MOST_RUNS),
                    "--seeds {text:?}: more than {MOST_RUNS} seeds; give a part of them"
                );
                (first..=last).for_each(|seed| add(seed, &mut seeds));
            }
        }
    }
    Ok(seeds)
}
