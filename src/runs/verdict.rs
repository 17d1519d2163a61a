//! A run's own verdict: whether objects, names and motion were found, judged without any truth.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

use serde::{Deserialize, Deserializer, Serialize};

/// What a run says of itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Every check passed.
    pub found: bool,
    pub checks: Vec<Check>,
    /// Of each learned parameter: what held-out clips say of it, lengths in true pixels.
    pub intervals: BTreeMap<String, Interval>,
}

/// One condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Check {
    pub name: String,
    pub passed: bool,
    /// What was measured, against which limit, in words.
    pub measured: String,
    /// Where to look if it failed.
    pub look_at: String,
}

/// From the least to the largest estimate of a parameter on held-out clips, two standard deviations to either side.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Minus infinity where they set no lower one.
    #[serde(deserialize_with = "minus_infinite_if_null")]
    pub low: f64,
    /// Infinite where the clips set no upper bound.
    #[serde(deserialize_with = "infinite_if_null")]
    pub high: f64,
}

/// JSON has no infinity: `null` stands for it.
fn infinite_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

fn minus_infinite_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NEG_INFINITY))
}

impl Verdict {
    pub fn new(checks: Vec<Check>, intervals: BTreeMap<String, Interval>) -> Self {
        Verdict { found: checks.iter().all(|check| check.passed), checks, intervals }
    }

    /// The checks that failed.
    pub fn failed(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|check| !check.passed)
    }
}

/// What the sentence of a verdict names, where it was judged: a black box has no equation that could explain names or motion.
const NAMED: [&str; 3] = ["objects", "names", "motion"];

/// `a`, `a and b`, `a, b and c`.
fn listed(words: &[&str]) -> String {
    match words {
        [before @ .., last] if !before.is_empty() => format!("{} and {last}", before.join(", ")),
        _ => words.concat(),
    }
}

impl Display for Verdict {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let intervals = self.intervals.iter();
        let intervals: Vec<_> =
            intervals.map(|(name, Interval { low, high })| format!("{name} {low:.4} to {high:.4}")).collect();
        if self.found {
            let judged = |name: &&str| self.checks.iter().any(|check| check.name == *name);
            let named: Vec<_> = NAMED.into_iter().filter(judged).collect();
            write!(f, "found: {}", listed(&named))?;
            return if intervals.is_empty() { Ok(()) } else { write!(f, "; {}", intervals.join(", ")) };
        }
        write!(f, "not found")?;
        for Check { name, measured, look_at, .. } in self.failed() {
            write!(f, "\n  {name}: {measured}; look at {look_at}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(name: &str, passed: bool) -> Check {
        Check { name: name.into(), passed, measured: "so".into(), look_at: "a picture".into() }
    }

    #[test]
    fn a_verdict_says_what_failed_and_where_to_look() {
        let intervals = BTreeMap::from([("k".to_string(), Interval { low: 3.98, high: 4.01 })]);
        let all = ["objects", "drawing", "names", "motion", "k"].map(|name| check(name, true));
        let found = Verdict::new(all.into(), intervals.clone());
        assert_eq!(found.to_string(), "found: objects, names and motion; k 3.9800 to 4.0100");
        let lost = Verdict::new(vec![check("objects", false), check("names", true)], intervals);
        assert!(!lost.found);
        assert_eq!(lost.to_string(), "not found\n  objects: so; look at a picture");
    }

    /// As that of a black box, whose names and motion nothing judges.
    #[test]
    fn a_verdict_names_only_what_was_judged() {
        let found = |names: &[&str]| {
            let checks = names.iter().map(|name| check(name, true)).collect();
            Verdict::new(checks, BTreeMap::new()).to_string()
        };
        assert_eq!(found(&["objects", "drawing", "L_pred"]), "found: objects");
        assert_eq!(found(&["objects", "motion"]), "found: objects and motion");
    }
}
