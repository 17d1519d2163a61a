//! Frames made of what was seen: each object as it looks in one frame, pasted elsewhere in it.
//!
//! Of few frames the networks would learn the places by heart.

use rand::Rng;
use tch::Tensor;

use super::blobs::{FrameBlobs, floats};
use super::motion::Foreground;

/// In fewer training frames than this, half of each step's are pasted ones.
pub const FEW_FRAMES: usize = 2000;

/// The frames `[frames, channels, S, S]` with each of their blobs moved by whole pixels to where blobs were seen, along each
/// axis anywhere between the extremes; one blob over the other.
///
/// * `moving` and `blobs`: of these frames.
pub fn pasted(frames: &Tensor, moving: &Foreground, blobs: &[FrameBlobs], random: &mut impl Rng) -> Tensor {
    let size = frames.size();
    let (channels, side) = (size[1] as usize, size[2] as usize);
    let (levels, shares) = (floats(frames), floats(&moving.share));
    let mut made = floats(&(frames - &moving.sharp));
    let range = |axis: usize| {
        let seen = blobs.iter().flat_map(|frame| &frame.blobs).filter(|blob| blob.mass > 0.0);
        let places = seen.map(|blob| blob.centre[axis]);
        places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
    };
    let ranges = [range(0), range(1)];
    let pixels = side * side;
    for (frame, found) in blobs.iter().enumerate() {
        let (levels, share) = (&levels[frame * channels * pixels..], &shares[frame * pixels..]);
        let made = &mut made[frame * channels * pixels..];
        for (number, blob) in found.blobs.iter().enumerate() {
            let [right, down] = [0, 1].map(|axis| {
                let (low, high) = ranges[axis];
                if low < high { (random.random_range(low..high) - blob.centre[axis]).round() as i64 } else { 0 }
            });
            for index in (0..pixels).filter(|&index| usize::from(found.nearest[index]) == number && share[index] > 0.0)
            {
                let (x, y) = ((index % side) as i64 + right, (index / side) as i64 + down);
                if !(0..side as i64).contains(&x) || !(0..side as i64).contains(&y) {
                    continue;
                }
                let to = y as usize * side + x as usize;
                for channel in 0..channels {
                    let level = &mut made[channel * pixels + to];
                    *level += share[index] * (levels[channel * pixels + index] - *level);
                }
            }
        }
    }
    Tensor::from_slice(&made).reshape(&size).to_device(frames.device())
}
