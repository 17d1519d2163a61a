//! Structural similarity of frames.
//!
//! Source: Wang, Bovik, Sheikh, Simoncelli: Image quality assessment (IEEE Transactions on Image Processing 13, 2004),
//! with its 11 x 11 Gaussian window of sigma 1.5 and its constants; the same numbers as scikit-image's
//! `structural_similarity(.., gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1)`.

use anyhow::{Result, ensure};
use tch::{Device, Kind, Tensor};

const WINDOW: i64 = 11;
const SIGMA: f64 = 1.5;
/// (0.01 L)^2 and (0.03 L)^2 for values in \[0, 1\], L = 1.
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
/// What is computed of so few stays in the cache.
const FRAMES_AT_ONCE: i64 = 32;

/// The weights of the pixels of a row in each window that lies within it, `[pixels, windows]`.
fn windows(pixels: i64, device: Device) -> Tensor {
    let numbers = |count: i64| Tensor::arange(count, (Kind::Double, device));
    let middles = numbers(pixels - WINDOW + 1) + (WINDOW / 2) as f64;
    let distances = (numbers(pixels).unsqueeze(1) - middles.unsqueeze(0)).abs();
    let weights = (distances.square() / (-2.0 * SIGMA * SIGMA)).exp() * distances.le((WINDOW / 2) as f64);
    &weights / weights.sum_dim_intlist([0i64].as_slice(), true, Kind::Double)
}

/// Similarity of each pair of frames, both `[n, C, h, w]` in \[0, 1\]: double `[n]`, 1 for equal frames.
///
/// The mean over the channels and over all windows that lie within the frame.
///
/// # Errors
/// Different shapes, frames smaller than the window.
pub fn ssim(frames: &Tensor, truth: &Tensor) -> Result<Tensor> {
    let (count, channels, height, width) = frames.size4()?;
    ensure!(truth.size() == frames.size(), "frames {:?} and {:?} cannot be compared", frames.size(), truth.size());
    ensure!(height >= WINDOW && width >= WINDOW, "SSIM needs frames of at least {WINDOW} x {WINDOW} pixels");
    let [along, down] = [width, height].map(|length| windows(length, frames.device()));
    let few = |x: &Tensor| x.split(FRAMES_AT_ONCE, 0);
    let pairs = few(frames).into_iter().zip(few(truth));
    let similar: Vec<_> = pairs.map(|(frames, truth)| similarity(&frames, &truth, [&along, &down])).collect();
    Ok(Tensor::cat(&similar, 0).reshape([count, channels]).mean_dim([1i64].as_slice(), false, Kind::Double))
}

/// Of each plane, the mean over its windows: `[planes]`.
fn similarity(frames: &Tensor, truth: &Tensor, [along, down]: [&Tensor; 2]) -> Tensor {
    // Variances are small differences of large numbers: single precision is not enough where a frame is flat.
    let [x, y] = [frames, truth].map(|planes| planes.to_kind(Kind::Double).flatten(0, 1));
    // In double precision products of matrices are several times as fast as convolutions. What comes out is transposed, in
    // all maps alike.
    let mean = |x: &Tensor| x.matmul(along).transpose(1, 2).matmul(down);
    let (mean_x, mean_y) = (mean(&x), mean(&y));
    // Both variances and the covariance, of two maps: of (x + y)^2 and of (x - y)^2.
    let (of_sum, of_difference) = (mean(&(&x + &y).square()), mean(&(x - y).square()));
    let (product, squares) = (&mean_x * &mean_y * 2.0, mean_x.square() + mean_y.square());
    let covariance = (&of_sum - &of_difference) * 0.5 - &product;
    let variances = (of_sum + of_difference) * 0.5 - &squares;
    let similarity = ((product + C1) * (covariance + C2)) / ((squares + C1) * (variances + C2));
    similarity.mean_dim([1i64, 2].as_slice(), false, Kind::Double)
}
