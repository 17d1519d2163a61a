//! Image resizing that equals `skimage.transform.resize` (order 1, mode reflect) for square single-channel images.
//!
//! Pixel centres lie at half-integers. Shrinking by f first blurs with a Gaussian of sigma (f - 1) / 2, cut at 4 sigma,
//! mirrored at the border without repeating the border pixel. Both steps are linear and the same on each axis, so an
//! output pixel is a fixed weighted sum of a few neighbouring rows and columns; the weights are computed once.

use std::ops::Range;

/// Weights of consecutive input pixels, from `start`, that make one output pixel of an axis.
#[derive(Debug, Clone)]
struct Taps {
    start: usize,
    weights: Vec<f64>,
}

/// A resize from one square size to another. Images are row-major.
#[derive(Debug, Clone)]
pub struct Resize {
    input: usize,
    taps: Vec<Taps>,
}

impl Resize {
    /// From `side * factor` pixels down to `side`, anti-aliased.
    pub(crate) fn shrink(side: usize, factor: usize) -> Self {
        let input = side * factor;
        let sigma = (factor as f64 - 1.0) / 2.0;
        let reach = (4.0 * sigma + 0.5) as isize;
        let bell = |k: isize| if reach == 0 { 1.0 } else { (-0.5 * (k as f64 / sigma).powi(2)).exp() };
        let total: f64 = (-reach..=reach).map(bell).sum();
        let blurred = (-reach..=reach).map(|k| (k, bell(k) / total)).collect::<Vec<_>>();
        Self { input, taps: (0..side).map(|pixel| taps(input, side, pixel, &blurred)).collect() }
    }

    /// From `input` pixels up to `output`, linear.
    pub(crate) fn enlarge(input: usize, output: usize) -> Self {
        Self { input, taps: (0..output).map(|pixel| taps(input, output, pixel, &[(0, 1.0)])).collect() }
    }

    /// Side of the output, pixels.
    pub fn side(&self) -> usize {
        self.taps.len()
    }

    /// Resizes a whole image.
    pub fn apply(&self, image: &[f64]) -> Vec<f64> {
        let side = self.side();
        let mut output = vec![0.0; side * side];
        self.apply_window(image, 0..side, 0..side, &mut Vec::new(), &mut output);
        output
    }

    /// Computes only the given rows and columns of the output and leaves the rest of `output` as it is. `scratch` keeps
    /// its allocation between calls.
    pub(crate) fn apply_window(
        &self,
        image: &[f64],
        rows: Range<usize>,
        columns: Range<usize>,
        scratch: &mut Vec<f64>,
        output: &mut [f64],
    ) {
        let Some((first, last)) = columns.clone().next().zip(columns.clone().last()) else { return };
        let left = self.taps[first].start;
        let right = self.taps[last].start + self.taps[last].weights.len();
        for row in rows {
            scratch.clear();
            scratch.resize(right - left, 0.0);
            for (weight, source) in self.taps[row].weights.iter().zip(self.taps[row].start..) {
                let line = &image[source * self.input + left..source * self.input + right];
                for (sum, value) in scratch.iter_mut().zip(line) {
                    *sum += weight * value;
                }
            }
            for column in columns.clone() {
                let taps = &self.taps[column];
                let line = &scratch[taps.start - left..];
                output[row * self.side() + column] = taps.weights.iter().zip(line).map(|(w, v)| w * v).sum();
            }
        }
    }

    /// Output pixels of an axis that any of these input pixels enters.
    pub fn reached(&self, input: Range<usize>) -> Range<usize> {
        let touches = |taps: &Taps| taps.start < input.end && input.start < taps.start + taps.weights.len();
        let first = self.taps.iter().position(touches).unwrap_or(0);
        let end = self.taps.iter().rposition(touches).map_or(first, |last| last + 1);
        first..end
    }
}

/// The weights of one output pixel: linear interpolation of the input after a blur given as (offset, weight).
fn taps(input: usize, output: usize, pixel: usize, blur: &[(isize, f64)]) -> Taps {
    let centre = (pixel as f64 + 0.5) * input as f64 / output as f64 - 0.5;
    let below = centre.floor();
    let share = centre - below;
    let mut dense = vec![0.0; input];
    for (neighbour, weight) in [(below as isize, 1.0 - share), (below as isize + 1, share)] {
        for &(offset, blur_weight) in blur {
            dense[mirror(neighbour + offset, input)] += weight * blur_weight;
        }
    }
    let used = |weight: &f64| *weight != 0.0;
    let start = dense.iter().position(used).unwrap_or(0);
    let end = dense.iter().rposition(used).map_or(start, |last| last + 1);
    Taps { start, weights: dense[start..end].to_vec() }
}

/// The pixel that stands for `index` outside of an axis of `size` pixels: reflection about the border pixels' centres.
fn mirror(index: isize, size: usize) -> usize {
    if size == 1 {
        return 0;
    }
    let last = size as isize - 1;
    let folded = index.rem_euclid(2 * last);
    folded.min(2 * last - folded) as usize
}
