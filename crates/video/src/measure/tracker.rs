//! A simple colour tracker, against which the model is held: the pixels that differ from what stands behind them and have
//! the object's colour, and their centroid.

use image::RgbImage;

use crate::import::motion::median_frame;
use paig::support::statistics::upper_median;

/// Difference from the background, summed over the colours, from which on a pixel moves.
const MOVES: i32 = 60;
/// Distance from the object's colour, summed over the colours, up to which a pixel is the object's.
const ALIKE: i32 = 110;
/// Levels of a colour that fall into one when the commonest is sought.
const COARSE: u8 = 32;
/// Pixels further from the middle than so many radii of a disc of their number are something else's.
const FAR: f64 = 2.5;
const ROUNDS: usize = 3;

/// What the object looks like, and what stands behind it.
#[derive(Debug, Clone)]
pub struct ColourTracker {
    background: RgbImage,
    colour: [u8; 3],
}

impl ColourTracker {
    /// Learns from some frames of one size; none where nothing moves.
    pub fn learn(frames: &[RgbImage]) -> Option<Self> {
        let background = median_frame(frames)?;
        let mut bins = std::collections::BTreeMap::<[u8; 3], (f64, [f64; 3], f64)>::new();
        for frame in frames {
            for (pixel, behind) in frame.pixels().zip(background.pixels()) {
                if distance(pixel.0, behind.0) < MOVES {
                    continue;
                }
                // What is coloured is rather the object than its shadow.
                let (least, most) = (pixel.0.iter().min()?, pixel.0.iter().max()?);
                let weight = 10.0 + f64::from(most - least);
                let bin = bins.entry(pixel.0.map(|level| level / COARSE)).or_insert((0.0, [0.0; 3], 0.0));
                bin.0 += weight;
                (0..3).for_each(|part| bin.1[part] += f64::from(pixel.0[part]));
                bin.2 += 1.0;
            }
        }
        let (_, sum, count) = bins.into_values().max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(ColourTracker { background, colour: sum.map(|sum| (sum / count) as u8) })
    }

    /// The centroid of the object's pixels, pixels; none where there are none.
    pub fn find(&self, frame: &RgbImage) -> Option<[f64; 2]> {
        let pixels = frame.enumerate_pixels().zip(self.background.pixels());
        let own = pixels.filter(|((_, _, pixel), behind)| {
            distance(pixel.0, behind.0) >= MOVES && distance(pixel.0, self.colour) < ALIKE
        });
        let mut own: Vec<[f64; 2]> = own.map(|((x, y, _), _)| [f64::from(x) + 0.5, f64::from(y) + 0.5]).collect();
        let mut middle = [0, 1].map(|axis| upper_median(own.iter().map(|place| place[axis])).unwrap_or(f64::NAN));
        for _ in 0..ROUNDS {
            let reach = FAR * (own.len() as f64 / std::f64::consts::PI).sqrt();
            own.retain(|[x, y]| (x - middle[0]).hypot(y - middle[1]) <= reach);
            let count = own.len() as f64;
            middle = [0, 1].map(|axis| own.iter().map(|place| place[axis]).sum::<f64>() / count);
        }
        (!own.is_empty()).then_some(middle)
    }
}

fn distance(a: [u8; 3], b: [u8; 3]) -> i32 {
    (0..3).map(|part| (i32::from(a[part]) - i32::from(b[part])).abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn a_ball_is_followed_and_its_shadow_is_not() {
        let frame = |x: f64| {
            RgbImage::from_fn(80, 60, |px, py| {
                let from = |x: f64, y: f64| (f64::from(px) + 0.5 - x).hypot(f64::from(py) + 0.5 - y);
                match () {
                    () if from(x, 20.0) < 5.0 => Rgb([220, 60, 40]),
                    () if from(x + 6.0, 40.0) < 7.0 => Rgb([100, 95, 90]),
                    () => Rgb([180, 175, 165]),
                }
            })
        };
        let places: Vec<f64> = (0..30).map(|step| 12.0 + 1.7 * f64::from(step)).collect();
        let frames: Vec<_> = places.iter().map(|x| frame(*x)).collect();
        let tracker = ColourTracker::learn(&frames).unwrap();
        for (x, frame) in places.iter().zip(&frames) {
            let [found, y] = tracker.find(frame).unwrap();
            assert!((found - x).abs() < 0.2 && (y - 20.0).abs() < 0.2, "{found} {y} instead of {x}");
        }
        assert!(tracker.find(&frame(-50.0)).is_none());
        assert!(ColourTracker::learn(&vec![frame(40.0); 3]).is_none());
    }
}
