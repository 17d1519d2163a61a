//! The spatial transformer: samples an image under an affine map of the output grid.
//!
//! Original: `nn/network/stn.py`; paper: section 3.3, equation 6. The output grid is `linspace(-1, 1)` on each axis,
//! the source point is `theta [gx, gy, 1]`, its pixel `(source + 1) (size - 1.01) / 2`, and the value is bilinear
//! between `floor` and `floor + 1`, both clipped to the image. With the weights taken from the clipped indices the
//! result is exactly 0, and so are its gradients, where the pixel is negative or `>= size - 1`.

use tch::{Kind, Tensor};

use paig_kernels::{AxisSample, hat_matrix};

/// Pixels of an axis of `size` pixels for one unit of source coordinate.
pub(crate) fn pixel_scale(size: i64) -> f64 {
    (size as f64 - 1.01) / 2.0
}

/// Matrices `[objects, size, size]` that shift an axis of `size` pixels by `shifts` (`[objects]`, pixels), bilinearly, the
/// edge pixels repeated.
pub(crate) fn shift_matrices(shifts: &Tensor, size: i64) -> Tensor {
    let index = Tensor::arange(size, (shifts.kind(), shifts.device()));
    hat_matrix(&(index - shifts.unsqueeze(1)).clamp(0.0, (size - 1) as f64), size)
}

/// The pixel of a source coordinate in \[-1, 1\] on an axis of `size` pixels.
fn source_pixel(source: &Tensor, size: i64) -> Tensor {
    (source + 1.0) * pixel_scale(size)
}

/// The output grid of one axis, `[size]` in \[-1, 1\].
fn grid(size: i64, like: &Tensor) -> Tensor {
    Tensor::linspace(-1.0, 1.0, size, (like.kind(), like.device()))
}

/// Where a map without rotation, `source = scale * g + shift` on each axis, samples images of `size` x `size` pixels: the
/// source pixel of each output row and column, each `[objects, batch, side]`.
/// * `scale`: one number, shared by all;
/// * `shift`: `[objects, batch, 2]`, x then y.
pub(crate) fn separable_pixels(scale: &Tensor, shift: &Tensor, side: i64, size: i64) -> [Tensor; 2] {
    let grid = grid(side, shift) * scale;
    [1, 0].map(|axis| source_pixel(&(shift.select(2, axis).unsqueeze(-1) + &grid), size))
}

/// Samples under any affine map, rotations included.
///
/// * `images`: `[batch, channels, h, w]`;
/// * `theta`: `[batch, 6]`, row-major 2x3;
/// * gives `[batch, channels, side, side]`.
pub fn transform(images: &Tensor, theta: &Tensor, side: i64) -> Tensor {
    let (batch, channels, height, width) = images.size4().expect("images [batch, channels, h, w]");
    let line = grid(side, images);
    let gx = line.unsqueeze(0).expand([side, side], false).reshape([-1]);
    let gy = line.unsqueeze(1).expand([side, side], false).reshape([-1]);
    let points = Tensor::stack(&[&gx, &gy, &gx.ones_like()], 0);
    let source = theta.reshape([batch, 2, 3]).matmul(&points);
    let x = AxisSample::new(&source_pixel(&source.select(1, 0), width), width);
    let y = AxisSample::new(&source_pixel(&source.select(1, 1), height), height);
    let flat = images.reshape([batch, channels, height * width]);
    let corner = |row: &Tensor, column: &Tensor, weight: Tensor| {
        // A theta that is not a number has no index; it shows in the weight.
        let index = (row * width as f64 + column).nan_to_num(0.0, None, None).to_kind(Kind::Int64).unsqueeze(1);
        flat.gather(2, &index.expand([batch, channels, side * side], false), false) * weight.unsqueeze(1)
    };
    let sampled = corner(&y.below, &x.below, &x.weight_below * &y.weight_below)
        + corner(&y.above, &x.below, &x.weight_below * &y.weight_above)
        + corner(&y.below, &x.above, &x.weight_above * &y.weight_below)
        + corner(&y.above, &x.above, &x.weight_above * &y.weight_above);
    sampled.reshape([batch, channels, side, side])
}
