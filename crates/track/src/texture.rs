//! Evidence that the camera stands: texture that stays where it is in most frames, cell by cell of the picture.
//!
//! A cell's displacement in a frame is the least-squares step of Lucas and Kanade 1981 from the median image. It averages over
//! all pixels of the cell, so it shows fine texture under the noise of a compressed video, which single corners do not.

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use crate::plane::Plane;
use crate::statistics::median;
use crate::still::median_image;

/// Cells along the longer side.
const CELLS: usize = 16;
/// Least smaller eigenvalue of a textured cell's mean gradient matrix, (levels per pixel)^2, in smoothed images.
const TEXTURED: f64 = 0.3;
/// Frames whose own texture is compared with that of the median image: a moving camera blurs the latter.
const OWN_FRAMES: usize = 8;
/// Displacement, reduced pixels, up to which a cell stays, and the share of the frames in which it must.
const STAYS: f64 = 0.25;
const MOST_FRAMES: f64 = 0.6;
/// Share of the textured cells that stay where the camera stands, and the fewest. In a prototype with a Gaussian blur 0.26 to 1
/// of the cells stayed on 12 videos with a standing camera, none on 7 with a moving one.
const LEAST_STAYING: f64 = 0.25;
const FEWEST: usize = 6;

/// Whether the texture of reduced images stays in place.
pub(crate) fn texture_stays(images: &[Plane]) -> bool {
    let images: Vec<Plane> = images.par_iter().map(|image| image.smoothed().smoothed()).collect();
    let Some(usual) = median_image(&images.iter().collect::<Vec<_>>()) else { return false };
    let side = (usual.width.max(usual.height) / CELLS).max(8);
    let cells: Vec<[usize; 2]> = (1..usual.height.saturating_sub(side))
        .step_by(side)
        .flat_map(|y| (1..usual.width.saturating_sub(side)).step_by(side).map(move |x| [x, y]))
        .collect();
    let staying: Vec<bool> = cells.par_iter().filter_map(|&at| stays(&images, &usual, at, side)).collect();
    let count = staying.iter().filter(|stays| **stays).count();
    count >= FEWEST && count as f64 >= LEAST_STAYING * staying.len() as f64
}

/// Whether a square cell stays; `None` where it has no texture.
fn stays(images: &[Plane], usual: &Plane, at: [usize; 2], side: usize) -> Option<bool> {
    let slopes = slopes(usual, at, side);
    let gradients = matrix(&slopes);
    let every = images.len().div_ceil(OWN_FRAMES);
    let mut own: Vec<f64> =
        images.iter().step_by(every).map(|image| smaller(&matrix(&self::slopes(image, at, side)))).collect();
    if smaller(&gradients).max(median(&mut own)?) < TEXTURED * (side * side) as f64 {
        return None;
    }
    let inverse = (gradients + Matrix2::identity() * 1e-3).try_inverse()?;
    let stays = |image: &&Plane| {
        let mut differences: Vec<f64> =
            pixels(at, side).map(|(x, y)| f64::from(image.at(x, y) - usual.at(x, y))).collect();
        let light = median(&mut differences.clone()).unwrap_or(0.0);
        differences.iter_mut().for_each(|difference| *difference -= light);
        let right: Vector2<f64> = slopes.iter().zip(&differences).map(|(slope, difference)| slope * *difference).sum();
        (inverse * right).norm() < STAYS
    };
    Some(images.iter().filter(stays).count() as f64 >= MOST_FRAMES * images.len() as f64)
}

fn pixels([left, top]: [usize; 2], side: usize) -> impl Iterator<Item = (usize, usize)> {
    (top..top + side).flat_map(move |y| (left..left + side).map(move |x| (x, y)))
}

fn slopes(image: &Plane, at: [usize; 2], side: usize) -> Vec<Vector2<f64>> {
    let half = |a: f32, b: f32| f64::from(0.5 * (a - b));
    pixels(at, side)
        .map(|(x, y)| {
            Vector2::new(half(image.at(x + 1, y), image.at(x - 1, y)), half(image.at(x, y + 1), image.at(x, y - 1)))
        })
        .collect()
}

fn matrix(slopes: &[Vector2<f64>]) -> Matrix2<f64> {
    slopes.iter().map(|slope| slope * slope.transpose()).sum()
}

fn smaller(matrix: &Matrix2<f64>) -> f64 {
    matrix.symmetric_eigenvalues().min()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{MovingEllipse, SyntheticScene};
    use crate::test_videos::reduced_images;

    fn swinging() -> SyntheticScene {
        SyntheticScene::of(MovingEllipse::at((0..30).map(|f| [160.0 + 80.0 * (f as f64 * 0.3).sin(), 120.0]).collect()))
    }

    #[test]
    fn texture_stays_behind_an_object_and_under_noise() {
        assert!(texture_stays(&reduced_images(&SyntheticScene { noise: 6.0, ..swinging() })));
    }

    #[test]
    fn texture_does_not_stay_before_a_camera_that_trembles_by_a_pixel() {
        let camera = (0..30).map(|f| [1.5 * (f as f64 * 0.9).sin(), 1.5 * (f as f64 * 0.7).cos(), 0.0]).collect();
        assert!(!texture_stays(&reduced_images(&SyntheticScene { camera, ..swinging() })));
    }

    #[test]
    fn a_plain_wall_shows_nothing() {
        let mut plain = vec![Plane::zeros(320, 240); 9];
        plain.iter_mut().for_each(|image| image.values.fill(120.0));
        assert!(!texture_stays(&plain));
    }
}
