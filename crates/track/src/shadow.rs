//! Pixels of a moving region that are a shadow: the background, darkened by nearly one ratio in all channels.

use crate::background::StaticScene;
use crate::exposure::Exposure;
use crate::mask::Mask;

/// Ratios of a shadowed to a lit background. Darker pixels are taken as an object.
const RATIOS: std::ops::Range<f32> = 0.35..0.97;
/// Largest spread of the ratio over the channels.
const SPREAD: f32 = 0.12;
/// Largest relative change of the ratio to the next pixel: a shadow keeps the texture and has soft edges.
const STEP: f32 = 0.12;
/// Darkest background, levels, at which a ratio means anything.
const DARKEST: f32 = 24.0;

/// Moving region without its shadow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Core {
    /// Share of the region's pixels that look like a shadow, 0..=1.
    pub(crate) shadow: f64,
    /// Centroid of the other pixels, weighted by the difference, `[x, y]`; absent where there are none.
    pub(crate) centre: Option<[f64; 2]>,
    /// Largest distance of the other pixels from that centroid along x and y, pixels.
    pub(crate) reach: [f64; 2],
    /// Mean colour of the other pixels, or of all where there are none, levels.
    pub(crate) colour: [f64; 3],
}

/// Separates the shadow from a region of a frame, `[height, width, 3]`.
pub(crate) fn core(frame: &[u8], background: &StaticScene, exposure: &Exposure, mask: &Mask) -> Core {
    let tables = exposure.tables();
    let width = background.size().width;
    let levels = background.levels.as_slice().expect("levels are contiguous");
    let pixel = |place: usize| [0, 1, 2].map(|c| tables[c][frame[place * 3 + c] as usize]);
    let ratios = |place: usize| {
        let pixel = pixel(place);
        [0, 1, 2].map(|c| (pixel[c] + 1.0) / (levels[place * 3 + c] + 1.0))
    };
    let mean = |r: [f32; 3]| (r[0] + r[1] + r[2]) / 3.0;
    let (mut all, mut shadowed, mut total, mut moment) = (0_usize, 0_usize, 0.0, [0.0; 2]);
    let mut bounds = [usize::MAX, usize::MAX, 0, 0];
    let (mut colour, mut shade) = ([0.0; 3], [0.0; 3]);
    for &(y, first, end) in mask.runs() {
        for x in first as usize..end as usize {
            let place = y as usize * width + x;
            all += 1;
            let pixel = pixel(place);
            let ratio = ratios(place);
            let middle = mean(ratio);
            let spread = ratio.iter().fold(0.0_f32, |s, r| s.max((r - middle).abs())) / middle;
            let bright = levels[place * 3..place * 3 + 3].iter().all(|&level| level > DARKEST);
            let smooth = x + 1 >= width || (mean(ratios(place + 1)) - middle).abs() < STEP;
            if bright && RATIOS.contains(&middle) && spread < SPREAD && smooth {
                shadowed += 1;
                (0..3).for_each(|c| shade[c] += f64::from(pixel[c]));
                continue;
            }
            (0..3).for_each(|c| colour[c] += f64::from(pixel[c]));
            let size = (0..3).map(|c| (pixel[c] - levels[place * 3 + c]).abs()).fold(0.0_f32, f32::max);
            let size = f64::from(size);
            total += size;
            moment[0] += size * x as f64;
            moment[1] += size * f64::from(y);
            bounds = [bounds[0].min(x), bounds[1].min(y as usize), bounds[2].max(x), bounds[3].max(y as usize)];
        }
    }
    let centre = (total > 0.0).then(|| moment.map(|m| m / total));
    let reach = centre.map_or([0.0; 2], |centre| {
        [0, 1].map(|axis| (centre[axis] - bounds[axis] as f64).max(bounds[axis + 2] as f64 - centre[axis]))
    });
    let solid = all - shadowed;
    let colour =
        if solid > 0 { colour.map(|sum| sum / solid as f64) } else { shade.map(|sum| sum / all.max(1) as f64) };
    Core { shadow: shadowed as f64 / all.max(1) as f64, centre, reach, colour }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, Array3};

    #[test]
    fn a_ball_is_separated_from_the_shadow_beside_it() {
        let levels = Array3::from_shape_fn((20, 40, 3), |(y, x, c)| 120.0 + ((x * 7 + y * 5 + c * 3) % 23) as f32);
        let background = StaticScene { levels, precision: Array2::ones((20, 40)), noise: 1.0 };
        let frame: Vec<u8> = background
            .levels
            .indexed_iter()
            .map(|((y, x, c), &level)| match x {
                5..15 if (5..15).contains(&y) => [200, 90, 30][c],
                15..25 if (5..15).contains(&y) => (0.6 * level) as u8,
                _ => level as u8,
            })
            .collect();
        let mask = Mask::from_runs((5..15).map(|y| (y, 5, 25)).collect());
        let core = core(&frame, &background, &Exposure::default(), &mask);
        // The column at the shadow's right edge has a step in its ratio.
        assert!((core.shadow - 0.45).abs() < 0.06, "{core:?}");
        assert!((core.centre.unwrap()[0] - 9.5).abs() < 1.0, "{core:?}");
    }
}
