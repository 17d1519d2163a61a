//! How each object looks, from its blobs: the median over frames of what lies around their centroids.

use tch::{Kind, Tensor};

use super::blobs::FrameBlobs;
use super::motion::Foreground;
use super::names::Names;

/// Frames that are needed for each object.
const LEAST_FRAMES: usize = 10;
/// A sprite's window reaches so many of the largest blob's radii to each side of its centre.
const REACH: f64 = 3.0;
/// An object that differs from the background by less than this everywhere is not seen.
const LEAST_SEEN: f64 = 0.02;
/// A pixel that differs from the background by this share of the object's largest difference is all object.
const SOLID: f64 = 0.85;

/// What the objects look like.
#[derive(Debug)]
pub struct LearnedSprites {
    /// How much of each pixel is the object, in \[0, 1\]: `[objects, window, window]`.
    pub visible: Tensor,
    /// Its colours minus the background's: `[objects, channels, window, window]`.
    pub colours: Tensor,
    /// Half the window's side, pixels of the frame.
    pub reach: f64,
}

/// The objects' looks on a grid of `window` pixels. None where too few frames show one of them.
pub(crate) fn learn(moving: &Foreground, frames: &[FrameBlobs], names: &Names, window: i64) -> Option<LearnedSprites> {
    let _guard = tch::no_grad_guard();
    let side = moving.share.size()[1] as f64;
    let reach = (REACH * names.largest_radius()).min(0.5 * (side - 1.0));
    let mut places: Vec<Vec<(i64, [f64; 2])>> = Vec::new();
    for (index, frame) in frames.iter().enumerate() {
        for (object, blob) in names.of(&frame.blobs).into_iter().enumerate() {
            places.resize_with(places.len().max(object + 1), Vec::new);
            if let Some(blob) = blob {
                places[object].push((index as i64, frame.blobs[blob].centre));
            }
        }
    }
    if places.is_empty() || places.iter().any(|places| places.len() < LEAST_FRAMES) {
        return None;
    }
    let colours: Vec<Tensor> = places.iter().map(|places| around(&moving.sharp, places, reach, window)).collect();
    let colours = Tensor::stack(&colours, 0);
    let size = colours.square().sum_dim_intlist([1i64].as_slice(), false, None).sqrt();
    let largest = size.amax([1i64, 2].as_slice(), true);
    // Where something else is taken for an object now and then, the median shows nothing.
    if largest.min().double_value(&[]) < LEAST_SEEN {
        return None;
    }
    let visible = (size / (largest * SOLID)).clamp_max(1.0);
    let colours = colours / visible.clamp_min(0.1).unsqueeze(1);
    Some(LearnedSprites { visible, colours, reach })
}

/// The median of the squares of `reach` pixels around these places in these frames, `[channels, window, window]`.
fn around(difference: &Tensor, places: &[(i64, [f64; 2])], reach: f64, window: i64) -> Tensor {
    let side = difference.size()[3] as f64;
    let options = (Kind::Float, difference.device());
    let line = Tensor::linspace(-reach, reach, window, options);
    let index: Vec<i64> = places.iter().map(|(frame, _)| *frame).collect();
    let centre = |axis: usize| {
        let centres: Vec<f32> = places.iter().map(|(_, centre)| centre[axis] as f32).collect();
        Tensor::from_slice(&centres).to_device(difference.device()).unsqueeze(1)
    };
    // Pixel i stands at i + 1/2; the sampler's frame goes from -1 in its first pixel to 1 in its last.
    let along = |axis: usize| (centre(axis) - 0.5 + &line) * (2.0 / (side - 1.0)) - 1.0;
    let (x, y) = (along(0).unsqueeze(1), along(1).unsqueeze(2));
    let grid = Tensor::stack(&[x.expand([-1, window, -1], false), y.expand([-1, -1, window], false)], 3);
    let frames = difference.index_select(0, &Tensor::from_slice(&index).to_device(difference.device()));
    // Bilinear, zeros outside.
    let patches = frames.grid_sampler_2d(&grid, 0, 0, true);
    patches.median_dim(0, false).0
}
