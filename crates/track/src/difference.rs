//! Difference of a frame from the background, in units of the noise.

use crate::background::StaticScene;
use crate::exposure::Exposure;

/// Largest |frame - background| over the channels times the precision, blurred; `[height, width]`.
///
/// The frame is first brought to the background's exposure.
pub(crate) fn difference(frame: &[u8], background: &StaticScene, exposure: &Exposure, kernel: &[f32]) -> Vec<f32> {
    let tables = exposure.tables();
    let levels = background.levels.as_slice().expect("levels are contiguous");
    let precision = background.precision.as_slice().expect("precision is contiguous");
    let sharp: Vec<f32> = frame
        .chunks_exact(3)
        .zip(levels.chunks_exact(3))
        .zip(precision)
        .map(|((frame, level), precision)| {
            let red = (tables[0][frame[0] as usize] - level[0]).abs();
            let green = (tables[1][frame[1] as usize] - level[1]).abs();
            let blue = (tables[2][frame[2] as usize] - level[2]).abs();
            red.max(green).max(blue) * precision
        })
        .collect();
    let size = background.size();
    blur(&sharp, size.width, size.height, kernel)
}

/// One half of a normalised Gaussian, from its centre outwards to 2.5 standard deviations.
pub(crate) fn gaussian(deviation: f32) -> Vec<f32> {
    let reach = (2.5 * deviation).ceil() as usize;
    let half: Vec<f32> = (0..=reach).map(|i| (-0.5 * (i as f32 / deviation.max(1e-3)).powi(2)).exp()).collect();
    let total = half[0] + 2.0 * half[1..].iter().sum::<f32>();
    half.into_iter().map(|value| value / total).collect()
}

/// Separable convolution with a symmetric kernel given by one half; the border is repeated.
pub(crate) fn blur(image: &[f32], width: usize, height: usize, half: &[f32]) -> Vec<f32> {
    let reach = half.len() - 1;
    let mut across = vec![0.0_f32; image.len()];
    let mut padded = vec![0.0_f32; width + 2 * reach];
    for (row, out) in image.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
        padded[..reach].fill(row[0]);
        padded[reach..reach + width].copy_from_slice(row);
        padded[reach + width..].fill(row[width - 1]);
        for (x, value) in out.iter_mut().enumerate() {
            *value = half[0] * padded[x + reach];
        }
        for (k, weight) in half.iter().enumerate().skip(1) {
            let (left, right) = (&padded[reach - k..], &padded[reach + k..]);
            for ((value, l), r) in out.iter_mut().zip(left).zip(right) {
                *value += weight * (l + r);
            }
        }
    }
    let mut result = vec![0.0_f32; image.len()];
    for (y, out) in result.chunks_exact_mut(width).enumerate() {
        let row = |at: usize| &across[at * width..(at + 1) * width];
        for (value, a) in out.iter_mut().zip(row(y)) {
            *value = half[0] * a;
        }
        for (k, weight) in half.iter().enumerate().skip(1) {
            let (above, below) = (row(y.saturating_sub(k)), row((y + k).min(height - 1)));
            for ((value, a), b) in out.iter_mut().zip(above).zip(below) {
                *value += weight * (a + b);
            }
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blurred_point_has_the_kernel_s_variance_and_keeps_its_sum() {
        let (width, height) = (41, 31);
        let mut image = vec![0.0; width * height];
        image[15 * width + 20] = 1.0;
        let blurred = blur(&image, width, height, &gaussian(1.5));
        let moment = |order: i32| -> f32 {
            blurred.iter().enumerate().map(|(i, v)| v * ((i % width) as f32 - 20.0).powi(order)).sum()
        };
        assert!((moment(0) - 1.0).abs() < 1e-5);
        assert!(moment(1).abs() < 1e-5);
        // The cut at 2.5 deviations lowers the variance from 2.25 by a few percent.
        assert!((moment(2) - 2.25).abs() < 0.15, "{}", moment(2));
    }

    #[test]
    fn a_constant_image_stays_constant_at_the_border() {
        let blurred = blur(&[3.0; 20 * 9], 20, 9, &gaussian(1.5));
        assert!(blurred.iter().all(|v| (v - 3.0).abs() < 1e-5));
    }
}
