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
    // Variances are small differences of large numbers: single precision is not enough where a frame is flat.
    let planes = |x: &Tensor| x.to_kind(Kind::Double).reshape([count * channels, height, width]);
    let (x, y) = (planes(frames), planes(truth));
    // In double precision products of matrices are several times as fast as convolutions. What comes out is transposed, in
    // all maps alike.
    let [along, down] = [width, height].map(|length| windows(length, x.device()));
    let mean = |x: &Tensor| x.matmul(&along).transpose(1, 2).matmul(&down);
    let (mean_x, mean_y) = (mean(&x), mean(&y));
    let variance_x = mean(&x.square()) - mean_x.square();
    let variance_y = mean(&y.square()) - mean_y.square();
    let covariance = mean(&(&x * &y)) - &mean_x * &mean_y;
    let above = (&mean_x * &mean_y * 2.0 + C1) * (covariance * 2.0 + C2);
    let below = (mean_x.square() + mean_y.square() + C1) * (variance_x + variance_y + C2);
    let per_frame = [1i64, 2, 3];
    Ok((above / below).reshape([count, channels, width - WINDOW + 1, height - WINDOW + 1]).mean_dim(
        per_frame.as_slice(),
        false,
        Kind::Double,
    ))
}
