//! A lens that is out of focus.

use crate::generators::film::Film;

/// Standard deviations after which the bell is cut off.
const REACH: f64 = 4.0;

/// Blurs each channel with a Gaussian of standard deviation `sigma` pixels. The border's pixels go on outside.
pub fn blur(film: &mut Film, sigma: f64) {
    let side = film.side;
    let reach = (REACH * sigma).ceil() as isize;
    let bell: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let total: f64 = bell.iter().sum();
    let inside = |pixel: isize| pixel.clamp(0, side as isize - 1) as usize;
    // Along rows, and written as columns: twice, and both axes are done.
    let along_rows = |plane: &[f64]| {
        let mut blurred = vec![0.0; side * side];
        for (row, line) in plane.chunks_exact(side).enumerate() {
            for column in 0..side {
                let neighbours = (-reach..=reach).map(|k| line[inside(column as isize + k)]);
                blurred[column * side + row] =
                    neighbours.zip(&bell).map(|(level, weight)| level * weight).sum::<f64>() / total;
            }
        }
        blurred
    };
    for plane in film.planes_mut() {
        plane.copy_from_slice(&along_rows(&along_rows(plane)));
    }
}
