//! A camera that is not held still.

use rand::Rng;

use crate::generators::film::Film;

/// Shifts each frame by a whole number of pixels along each axis, drawn uniformly from `-largest` to `largest`. The
/// border's pixels go on outside.
pub(crate) fn shake(film: &mut Film, largest: usize, rng: &mut impl Rng) {
    let side = film.side;
    let largest = largest as i64;
    for frame in &mut film.frames {
        let [right, down] = [0; 2].map(|_| rng.random_range(-largest..=largest));
        let from = |pixel: usize, shift: i64| (pixel as i64 - shift).clamp(0, side as i64 - 1) as usize;
        for plane in frame.chunks_exact_mut(side * side) {
            let still = plane.to_vec();
            for (pixel, level) in plane.iter_mut().enumerate() {
                *level = still[from(pixel / side, down) * side + from(pixel % side, right)];
            }
        }
    }
}
