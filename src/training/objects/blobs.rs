//! What moves in each frame, parted into as many blobs as there are objects: k-means on the places of the pixels.

use tch::{Device, Kind, Tensor};

use super::motion::Foreground;
use paig_kernels::in_parallel;

/// Pixels that move less than this are left out.
const FAINT: f32 = 0.05;
/// Starts for each frame, the best of which is taken, and the updates of each.
const STARTS: usize = 3;
const UPDATES: usize = 8;

/// One blob.
#[derive(Debug, Clone)]
pub struct MovingBlob {
    /// Centroid `(x, y)` of what moves in it, pixels; the middle of the first pixel is at 1/2.
    pub centre: [f64; 2],
    /// How much moves in it, in pixels.
    pub mass: f64,
    /// Root mean square distance from its centroid, pixels.
    pub radius: f64,
    /// Moments up to the second, about the centroid, of the difference from the background in each channel: its colour,
    /// size and shape. Lengths are in sixteenths of the frame's side.
    pub look: Vec<f64>,
}

/// The blobs of one frame.
#[derive(Debug)]
pub struct FrameBlobs {
    pub blobs: Vec<MovingBlob>,
    /// Which blob each pixel is nearest to, row by row.
    pub nearest: Vec<u8>,
}

/// A pixel that moves.
struct MovingPixel {
    at: [f64; 2],
    weight: f64,
    index: usize,
}

fn squared_distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

/// Index of the nearest centre, and the squared distance to it.
fn nearest(at: [f64; 2], centres: &[[f64; 2]]) -> (usize, f64) {
    let distances = centres.iter().map(|centre| squared_distance(at, *centre)).enumerate();
    distances.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
}

fn pixel_centre(index: usize, side: usize) -> [f64; 2] {
    [(index % side) as f64 + 0.5, (index / side) as f64 + 0.5]
}

/// Parts what moves in each frame into `objects` blobs.
pub fn find(moving: &Foreground, objects: usize) -> Vec<FrameBlobs> {
    let size = moving.difference.size();
    let (channels, side) = (size[1] as usize, size[2] as usize);
    let (shares, differences) = (floats(&moving.share), floats(&moving.difference));
    let pixels = side * side;
    let frames = shares.chunks(pixels).zip(differences.chunks(channels * pixels)).collect();
    in_parallel(frames, |(share, difference)| frame_blobs(share, difference, side, objects))
}

/// All numbers of a tensor.
pub(super) fn floats(x: &Tensor) -> Vec<f32> {
    x.to_device(Device::Cpu).to_kind(Kind::Float).contiguous().view(-1).try_into().expect("numbers")
}

fn frame_blobs(share: &[f32], difference: &[f32], side: usize, objects: usize) -> FrameBlobs {
    let movers: Vec<MovingPixel> = share
        .iter()
        .enumerate()
        .filter(|(_, share)| **share > FAINT)
        .map(|(index, &share)| MovingPixel { at: pixel_centre(index, side), weight: f64::from(share), index })
        .collect();
    let starts = (0..STARTS).map(|start| cluster(&movers, start, objects));
    let (centres, _) = starts.min_by(|a, b| a.1.total_cmp(&b.1)).expect("at least one start");
    let mut blobs: Vec<Vec<&MovingPixel>> = vec![Vec::new(); objects];
    for mover in &movers {
        blobs[nearest(mover.at, &centres).0].push(mover);
    }
    let blobs =
        blobs.iter().zip(&centres).map(|(movers, centre)| described(movers, *centre, difference, side)).collect();
    let nearest = (0..share.len()).map(|index| nearest(pixel_centre(index, side), &centres).0 as u8).collect();
    FrameBlobs { blobs, nearest }
}

/// k-means from a pixel and always the pixel farthest from those before: the centres, and the sum of squares within.
fn cluster(movers: &[MovingPixel], start: usize, objects: usize) -> (Vec<[f64; 2]>, f64) {
    let Some(first) = movers.get(start * movers.len() / STARTS) else { return (vec![[0.0; 2]; objects], 0.0) };
    let mut centres = vec![first.at];
    while centres.len() < objects {
        let far = |mover: &&MovingPixel| nearest(mover.at, &centres).1 * mover.weight;
        let farthest = movers.iter().max_by(|a, b| far(a).total_cmp(&far(b))).expect("a first mover");
        centres.push(farthest.at);
    }
    let mut within = f64::INFINITY;
    for _ in 0..UPDATES {
        let mut sums = vec![[0.0; 3]; objects];
        let mut squares = 0.0;
        for mover in movers {
            let (blob, squared) = nearest(mover.at, &centres);
            let sum = &mut sums[blob];
            sum[0] += mover.weight * mover.at[0];
            sum[1] += mover.weight * mover.at[1];
            sum[2] += mover.weight;
            squares += mover.weight * squared;
        }
        // A centre without pixels stays.
        for (centre, sum) in centres.iter_mut().zip(sums).filter(|(_, sum)| sum[2] > 0.0) {
            *centre = [sum[0] / sum[2], sum[1] / sum[2]];
        }
        if squares >= within {
            break;
        }
        within = squares;
    }
    (centres, within)
}

fn described(movers: &[&MovingPixel], centre: [f64; 2], difference: &[f32], side: usize) -> MovingBlob {
    let (pixels, unit) = (side * side, side as f64 / 16.0);
    let channels = difference.len() / pixels;
    let mass: f64 = movers.iter().map(|mover| mover.weight).sum();
    let squares: f64 = movers.iter().map(|mover| mover.weight * squared_distance(mover.at, centre)).sum();
    let mut look = vec![0.0; 6 * channels];
    for mover in movers {
        let [x, y] = [0, 1].map(|axis| (mover.at[axis] - centre[axis]) / unit);
        let powers = [1.0, x, y, x * x, x * y, y * y];
        for (channel, moments) in look.chunks_mut(6).enumerate() {
            let seen = mover.weight * f64::from(difference[channel * pixels + mover.index]);
            moments.iter_mut().zip(powers).for_each(|(moment, power)| *moment += seen * power);
        }
    }
    MovingBlob { centre, mass, radius: (squares / mass.max(f64::MIN_POSITIVE)).sqrt(), look }
}
