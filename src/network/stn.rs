//! The spatial transformer: samples an image under an affine map of the output grid.
//!
//! Original: `nn/network/stn.py`; paper: section 3.3, equation 6. The output grid is `linspace(-1, 1)` on each axis,
//! the source point is `theta [gx, gy, 1]`, its pixel `(source + 1) (size - 1.01) / 2`, and the value is bilinear
//! between `floor` and `floor + 1`, both clipped to the image. With the weights taken from the clipped indices the
//! result is exactly 0, and so are its gradients, where the pixel is negative or `>= size - 1`.

use tch::{Kind, Tensor};

/// Where one output axis falls in the source: index below, weight of the index above, both zero-weighted outside.
struct AxisSample {
    /// `floor(pixel)`, clipped to the image.
    below: Tensor,
    /// `floor(pixel) + 1`, clipped.
    above: Tensor,
    weight_below: Tensor,
    weight_above: Tensor,
}

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

/// The matrix `[.., outputs, size]` of linear interpolation: row r holds the weights of the pixels of an axis at `places`
/// (`[.., outputs]`, within the axis).
pub(crate) fn hat_matrix(places: &Tensor, size: i64) -> Tensor {
    let distance: Tensor = (places.unsqueeze(-1) - Tensor::arange(size, (places.kind(), places.device()))).abs();
    (-distance + 1.0).relu()
}

/// The pixel of a source coordinate in \[-1, 1\] on an axis of `size` pixels.
fn source_pixel(source: &Tensor, size: i64) -> Tensor {
    (source + 1.0) * pixel_scale(size)
}

/// `source` in \[-1, 1\] (any shape) to indices and weights on an axis of `size` pixels.
fn sample_axis(source: &Tensor, size: i64) -> AxisSample {
    let pixel = source_pixel(source, size);
    let floor = pixel.detach().floor();
    let below = floor.clamp(0.0, (size - 1) as f64);
    let above = (&floor + 1.0).clamp(0.0, (size - 1) as f64);
    AxisSample { weight_below: &above - &pixel, weight_above: pixel - &below, below, above }
}

/// The hat-function matrix `[.., outputs, size]` of one axis: row r holds the bilinear weights of output r.
///
/// `source`: `[.., outputs]`.
fn axis_matrix(source: &Tensor, size: i64) -> Tensor {
    let sample = sample_axis(source, size);
    let index = Tensor::arange(size, (source.kind(), source.device()));
    let at = |place: &Tensor| place.unsqueeze(-1).eq_tensor(&index).to_kind(source.kind());
    // Outside the image both indices are clipped to the same pixel and the two weights cancel exactly.
    at(&sample.below) * sample.weight_below.unsqueeze(-1) + at(&sample.above) * sample.weight_above.unsqueeze(-1)
}

/// The output grid of one axis, `[size]` in \[-1, 1\].
fn grid(size: i64, like: &Tensor) -> Tensor {
    Tensor::linspace(-1.0, 1.0, size, (like.kind(), like.device()))
}

/// Samples without rotation: `source = scale * g + shift` on each axis.
///
/// The map is separable, so two small matrix products (`Hy image Hx^T`) replace the gathers of the general form.
/// * `images`: `[objects, channels, h, w]`;
/// * `scale`: one number, shared by all;
/// * `shift`: `[objects, batch, 2]`, x then y;
/// * gives `[objects, batch, channels, side, side]`.
pub(crate) fn transform_separable(images: &Tensor, scale: &Tensor, shift: &Tensor, side: i64) -> Tensor {
    let (objects, channels, height, width) = images.size4().expect("images [objects, channels, h, w]");
    let batch = shift.size()[1];
    let grid = grid(side, images) * scale;
    let rows = axis_matrix(&(shift.select(2, 1).unsqueeze(-1) + &grid), height);
    let columns = axis_matrix(&(shift.select(2, 0).unsqueeze(-1) + &grid), width);
    // [objects, batch * side, h] x [objects, h, channels * w]
    let by_row = rows.reshape([objects, batch * side, height]).bmm(&images.permute([0, 2, 1, 3]).reshape([
        objects,
        height,
        channels * width,
    ]));
    by_row
        .reshape([objects * batch, side * channels, width])
        .bmm(&columns.reshape([objects * batch, side, width]).transpose(1, 2))
        .reshape([objects, batch, side, channels, side])
        .transpose(2, 3)
}

/// Where [`transform_separable`] samples: the source pixel of each output row and column, each `[objects, batch, side]`, in
/// images of `size` x `size` pixels.
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
    let x = sample_axis(&source.select(1, 0), width);
    let y = sample_axis(&source.select(1, 1), height);
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
