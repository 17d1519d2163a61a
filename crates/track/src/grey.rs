//! Reduced grey images of frames and their pyramids.

use rayon::prelude::*;

use crate::plane::Plane;
use crate::video::Size;

/// Longest side of a reduced image, pixels.
const LONGEST: usize = 480;
/// Shortest side of a pyramid's top, pixels.
const TOP: usize = 24;
/// Levels of a pyramid.
const LEVELS: usize = 5;

/// Whole factor by which frames of a size are reduced.
pub(crate) fn reduction(size: Size) -> usize {
    size.width.max(size.height).div_ceil(LONGEST)
}

/// Mean of the channels over cells of `factor * factor` pixels; what is left over at the right and the bottom is dropped.
pub(crate) fn reduced(frame: &[u8], size: Size, factor: usize) -> Plane {
    let (width, height) = (size.width / factor, size.height / factor);
    let mut plane = Plane::zeros(width, height);
    let share = 1.0 / (4 * factor * factor) as f32;
    plane.values.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let mut sums = vec![0_u32; width];
        for row in y * factor..(y + 1) * factor {
            let line = &frame[row * size.width * 3..][..width * factor * 3];
            for (sum, cell) in sums.iter_mut().zip(line.chunks_exact(factor * 3)) {
                // Green counts twice: it carries most of the luma's resolution.
                *sum +=
                    cell.chunks_exact(3).map(|p| u32::from(p[0]) + 2 * u32::from(p[1]) + u32::from(p[2])).sum::<u32>();
            }
        }
        for (value, sum) in out.iter_mut().zip(sums) {
            *value = sum as f32 * share;
        }
    });
    plane
}

/// An image, smoothed, and its halves, quarters and so on.
pub(crate) fn pyramid(image: &Plane) -> Vec<Plane> {
    let mut levels = vec![image.smoothed()];
    while levels.len() < LEVELS {
        let last = &levels[levels.len() - 1];
        if last.width.min(last.height) < 2 * TOP {
            break;
        }
        levels.push(halved(last));
    }
    levels
}

/// Means over cells of 2 x 2 samples.
fn halved(image: &Plane) -> Plane {
    let (width, height) = (image.width / 2, image.height / 2);
    let mut half = Plane::zeros(width, height);
    for (y, out) in half.values.chunks_exact_mut(width).enumerate() {
        let row = |y: usize| &image.values[y * image.width..][..2 * width];
        let pairs = row(2 * y).chunks_exact(2).zip(row(2 * y + 1).chunks_exact(2));
        for (value, (above, below)) in out.iter_mut().zip(pairs) {
            *value = 0.25 * (above[0] + above[1] + below[0] + below[1]);
        }
    }
    half
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_averaged_and_remainders_dropped() {
        let size = Size { width: 5, height: 4 };
        let frame: Vec<u8> = (0..20).flat_map(|i| [i, i, i]).collect();
        let plane = reduced(&frame, size, 2);
        assert_eq!((plane.width, plane.height), (2, 2));
        assert_eq!(plane.values, [3.0, 5.0, 13.0, 15.0]);
        assert_eq!(reduction(Size { width: 1280, height: 720 }), 3);
    }
}
