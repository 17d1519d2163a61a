//! Changes of the picture from frame to frame.

use crate::plane::Plane;
use crate::statistics::quantile;

/// Share of the pixels that change most: those of a small object.
const TOP: f64 = 0.002;
/// Level by which a pixel must change to count.
const CHANGED: f32 = 14.0;
/// Side of the blocks whose means are compared for cuts, pixels: noise and a dithered palette change every pixel of a scene.
const BLOCK: usize = 4;
/// Share of such blocks at a cut, at least, and correlation of the frames before and after it, at most.
const CUT: f64 = 0.3;
const UNLIKE: f64 = 0.3;
/// Least change of a pixel whose middle between two frames is compared, levels.
const MOVED: f32 = 8.0;

/// Change of a frame from the one before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Change {
    pub(crate) frame: usize,
    /// Mean of the largest changes, levels; small objects count. `None` of the first frame.
    pub(crate) top: Option<f64>,
    /// Share of the blocks that change by much.
    pub(crate) share: f64,
    /// Correlation of the two pictures, block by block.
    pub(crate) correlation: f64,
    /// Distance of the frame before from the mean of its neighbours, over half the distance of these: 0 where it is
    /// blended from them. `None` where nothing moves.
    pub(crate) blend: Option<f64>,
}

impl Change {
    /// Whether another scene begins with the frame.
    pub(crate) fn is_cut(&self) -> bool {
        self.share > CUT && self.correlation < UNLIKE
    }
}

/// Change of a reduced image from the last of the two before.
pub(crate) fn change(frame: usize, before: Option<(&Plane, &Plane)>, image: &Plane) -> Change {
    let Some((earlier, last)) = before else {
        return Change { frame, top: None, share: 0.0, correlation: 1.0, blend: None };
    };
    let mut differences: Vec<f32> = image.values.iter().zip(&last.values).map(|(a, b)| a - b).collect();
    // Flicker changes all pixels alike.
    let mut some: Vec<f64> = differences.iter().step_by(13).map(|&d| f64::from(d)).collect();
    let offset = quantile(&mut some, 0.5).unwrap_or(0.0) as f32;
    differences.iter_mut().for_each(|d| *d = (*d - offset).abs());
    let [before, now] = [last, image].map(block_means);
    let changed = before.values.iter().zip(&now.values).filter(|(a, b)| (*b - *a - offset).abs() > CHANGED).count();
    let share = changed as f64 / now.values.len() as f64;
    let count = ((differences.len() as f64 * TOP) as usize).clamp(12.min(differences.len()), differences.len());
    let rank = differences.len() - count;
    differences.select_nth_unstable_by(rank, f32::total_cmp);
    let top = f64::from(differences[rank..].iter().sum::<f32>()) / count as f64;
    Change { frame, top: Some(top), share, correlation: correlation(&before, &now), blend: blend(earlier, last, image) }
}

/// Means of the blocks of an image; those at its right and lower border may be smaller.
fn block_means(image: &Plane) -> Plane {
    let (width, height) = (image.width.div_ceil(BLOCK), image.height.div_ceil(BLOCK));
    let mean = |place: usize| {
        let columns = place % width * BLOCK..(place % width * BLOCK + BLOCK).min(image.width);
        let rows = place / width * BLOCK..(place / width * BLOCK + BLOCK).min(image.height);
        let count = columns.len() * rows.len();
        rows.flat_map(|y| columns.clone().map(move |x| image.at(x, y))).sum::<f32>() / count as f32
    };
    Plane { width, height, values: (0..width * height).map(mean).collect() }
}

fn correlation(one: &Plane, other: &Plane) -> f64 {
    let count = one.values.len() as f64;
    let mean = |plane: &Plane| plane.values.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
    let (m, n) = (mean(one), mean(other));
    let (mut product, mut squares) = (0.0, [1e-9; 2]);
    for (&a, &b) in one.values.iter().zip(&other.values) {
        let (a, b) = (f64::from(a) - m, f64::from(b) - n);
        product += a * b;
        squares[0] += a * a;
        squares[1] += b * b;
    }
    product / (squares[0] * squares[1]).sqrt()
}

fn blend(earlier: &Plane, middle: &Plane, later: &Plane) -> Option<f64> {
    let (mut off, mut half, mut count) = (0.0, 0.0, 0);
    for ((&a, &b), &c) in earlier.values.iter().zip(&middle.values).zip(&later.values) {
        if (a - c).abs() > MOVED {
            off += f64::from((b - 0.5 * (a + c)).abs());
            half += f64::from(0.5 * (a - c).abs());
            count += 1;
        }
    }
    (count >= 8).then(|| off / half)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(x: f64) -> Plane {
        let mut plane = Plane::zeros(80, 60);
        for (place, value) in plane.values.iter_mut().enumerate() {
            let away = ((place % 80) as f64 - x).hypot((place / 80) as f64 - 30.0);
            *value = 50.0 + 100.0 * (6.0 - away).clamp(0.0, 1.0) as f32;
        }
        plane
    }

    #[test]
    fn a_mean_of_its_neighbours_is_a_blend_and_a_moved_disc_is_none() {
        let (a, c) = (disc(20.0), disc(32.0));
        let mut mean = a.clone();
        mean.values.iter_mut().zip(&c.values).for_each(|(a, c)| *a = 0.5 * (*a + c));
        assert!(change(2, Some((&a, &mean)), &c).blend.unwrap() < 1e-6);
        assert!(change(2, Some((&a, &disc(26.0))), &c).blend.unwrap() > 0.8);
    }

    #[test]
    fn a_repeated_picture_changes_nothing_and_a_small_disc_much() {
        let (a, b) = (disc(20.0), disc(23.0));
        assert_eq!(change(1, Some((&a, &a)), &a).top, Some(0.0));
        let moved = change(1, Some((&a, &a)), &b);
        assert!(moved.top.unwrap() > 50.0 && !moved.is_cut());
    }

    /// A dithered palette changes most pixels of a plain wall; another scene changes them by areas.
    #[test]
    fn dithering_is_no_cut_and_another_scene_is_one() {
        let dithered = |x: f64, shift: usize| {
            let mut plane = disc(x);
            let dither = |place: usize| 20.0 * ((place % 80 + place / 80 + shift) % 2) as f32;
            plane.values.iter_mut().enumerate().for_each(|(place, value)| *value += dither(place));
            plane
        };
        let (a, b) = (dithered(20.0, 0), dithered(23.0, 1));
        assert!(!change(1, Some((&a, &a)), &b).is_cut());
        let mut stripes = Plane::zeros(80, 60);
        stripes
            .values
            .iter_mut()
            .enumerate()
            .for_each(|(place, value)| *value = 10.0 * (place % 80 / 8 * 7 % 10) as f32);
        assert!(change(1, Some((&a, &a)), &stripes).is_cut());
    }
}
