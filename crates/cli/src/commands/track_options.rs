//! What people say of objects to be tracked.

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig_track::{Hint, Region};

/// Options of commands that track.
#[derive(Debug, Args)]
pub struct TrackOptions {
    /// A point on the object: frame, then x,y in pixels; may be repeated
    #[arg(long, value_name = "FRAME:X,Y")]
    at: Vec<String>,
    /// A rectangle in which nothing is looked for: its left, top, width and height in pixels; may be repeated
    #[arg(long, value_name = "X,Y,WIDTH,HEIGHT")]
    ignore: Vec<String>,
}

impl TrackOptions {
    /// # Errors
    /// Text that is not of the form that its option's help gives.
    pub fn read(&self) -> Result<(Vec<Hint>, Vec<Region>)> {
        let hints = self.at.iter().map(|text| hint(text)).collect::<Result<_>>()?;
        Ok((hints, self.ignore.iter().map(|text| region(text)).collect::<Result<_>>()?))
    }
}

fn hint(text: &str) -> Result<Hint> {
    let parse = || {
        let (frame, place) = text.split_once(':')?;
        let (x, y) = place.split_once(',')?;
        let position = [x.trim().parse::<f64>().ok()?, y.trim().parse::<f64>().ok()?];
        // The tracker counts from the middle of the first pixel.
        let position = position.map(|place| place - 0.5);
        position.iter().all(|place| place.is_finite()).then_some(Hint { frame: frame.trim().parse().ok()?, position })
    };
    parse().with_context(|| format!("--at {text:?}: expected FRAME:X,Y, for example 12:340,220"))
}

fn region(text: &str) -> Result<Region> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let wrong = || format!("--ignore {text:?}: expected X,Y,WIDTH,HEIGHT in whole pixels");
    let [x, y, width, height] = numbers.with_context(wrong)?[..] else { anyhow::bail!(wrong()) };
    ensure!(width > 0 && height > 0, "--ignore {text:?}: width and height must be at least 1");
    let end = |from: usize, length: usize| from.saturating_add(length - 1);
    Ok(Region { first: [x, y], last: [end(x, width), end(y, height)] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hints_and_regions_are_read() {
        assert_eq!(hint("12: 340, 220.5").unwrap(), Hint { frame: 12, position: [339.5, 220.0] });
        assert_eq!(region("5,6,10,1").unwrap(), Region { first: [5, 6], last: [14, 6] });
        assert!(hint("1,2").is_err() && region("1,2,0,4").is_err());
    }
}
