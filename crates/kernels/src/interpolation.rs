//! Matrices of linear interpolation, and the doubling of pictures by them.

use tch::Tensor;

/// Pixels of an axis between which a place falls, with their weights; both weights are 0 outside.
#[derive(Debug)]
pub struct AxisSample {
    /// `floor(pixel)`, clipped to the axis.
    pub below: Tensor,
    /// `floor(pixel) + 1`, clipped.
    pub above: Tensor,
    pub weight_below: Tensor,
    pub weight_above: Tensor,
}

impl AxisSample {
    /// Of pixels (any shape) on an axis of `size` pixels.
    pub fn new(pixels: &Tensor, size: i64) -> Self {
        let floor = pixels.detach().floor();
        let below = floor.clamp(0.0, (size - 1) as f64);
        let above = (&floor + 1.0).clamp(0.0, (size - 1) as f64);
        AxisSample { weight_below: &above - pixels, weight_above: pixels - &below, below, above }
    }
}

/// The matrix `[.., outputs, size]` of linear interpolation: row r holds the weights of the pixels of an axis at `pixels`
/// (`[.., outputs]`), all 0 outside of the axis.
pub fn axis_matrix(pixels: &Tensor, size: i64) -> Tensor {
    let sample = AxisSample::new(pixels, size);
    let index = Tensor::arange(size, (pixels.kind(), pixels.device()));
    let at = |place: &Tensor| place.unsqueeze(-1).eq_tensor(&index).to_kind(pixels.kind());
    // Outside of the axis both indices are clipped to the same pixel and the two weights cancel exactly.
    at(&sample.below) * sample.weight_below.unsqueeze(-1) + at(&sample.above) * sample.weight_above.unsqueeze(-1)
}

/// As `axis_matrix`, of places within the axis.
pub fn hat_matrix(places: &Tensor, size: i64) -> Tensor {
    let distance: Tensor = (places.unsqueeze(-1) - Tensor::arange(size, (places.kind(), places.device()))).abs();
    (-distance + 1.0).relu()
}

/// Doubles height and width as TensorFlow 1's `resize_bilinear` does (`align_corners=False`, no half-pixel centres):
/// `out[2i] = in[i]`, `out[2i+1] = (in[i] + in[min(i+1, n-1)]) / 2` on each axis. No mode of PyTorch's `interpolate`
/// equals it.
pub fn resize_bilinear_x2(x: &Tensor) -> Tensor {
    let (batch, channels, height, width) = x.size4().expect("images [batch, channels, h, w]");
    // A matrix product for each axis, with the channels last: the layout in which the convolutions are fastest.
    let rows = doubling_matrix(height, x).matmul(&x.permute([0, 2, 3, 1]).reshape([batch, height, width * channels]));
    let both = doubling_matrix(width, x).matmul(&rows.reshape([batch * 2 * height, width, channels]));
    both.reshape([batch, 2 * height, 2 * width, channels]).permute([0, 3, 1, 2])
}

/// `[2n, n]`: row r holds the bilinear weights at r / 2, the last element repeated.
fn doubling_matrix(n: i64, like: &Tensor) -> Tensor {
    let halves = Tensor::arange(2 * n, (like.kind(), like.device())) * 0.5;
    hat_matrix(&halves.clamp_max((n - 1) as f64), n)
}

/// Images `[objects, channels, h, w]` sampled at rows and columns (pixels, `[objects, batch, side]` each), 0 outside:
/// `[objects, batch, channels, side, side]`.
///
/// The map is separable, so two small matrix products (`Hy image Hx^T`) replace the gathers of the general form.
pub fn sample_separable(images: &Tensor, rows: &Tensor, columns: &Tensor) -> Tensor {
    let (objects, channels, height, width) = images.size4().expect("images [objects, channels, h, w]");
    let (_, batch, side) = rows.size3().expect("rows [objects, batch, side]");
    let (rows, columns) = (axis_matrix(rows, height), axis_matrix(columns, width));
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
