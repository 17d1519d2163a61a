//! Backgrounds that need no files.

use std::f64::consts::TAU;

use rand::Rng;

use super::balls::fill_disc;
use super::overlay::{Backdrop, Overlay};

/// Discs of a texture: enough to cover the frame about four times.
const LEAVES: usize = 100;
/// Smallest and largest radius of such a disc, of the frame's side.
const LEAF_RADII: [f64; 2] = [1.0 / 16.0, 1.0 / 3.0];
/// Waves in each channel of the clouds.
const WAVES: usize = 6;
/// Shortest and longest wave, of the frame's side.
const WAVELENGTHS: [f64; 2] = [0.25, 1.5];
/// Frames among which a clip's first time is drawn.
const TIMES: f64 = 10_000.0;

/// A texture of overlapping discs ("dead leaves"): flat areas and edges of all directions and sizes, as in photographs.
/// Radii r have a density of 1 / r^3. A level is half a grey that all channels share and half a channel's own, both
/// uniform from 0 to `brightness`.
///
/// Source: Lee, Mumford, Huang, *Occlusion models for natural images* (IJCV 2001).
pub(super) fn leaves(overlay: &Overlay, brightness: f64, rng: &mut impl Rng) -> Backdrop {
    let side = overlay.canvas_side();
    let mut planes = overlay.plain(0.0).canvas;
    let [smallest, largest] = LEAF_RADII.map(|share| share * side as f64);
    let in_reach = 1.0 - (smallest / largest).powi(2);
    // The first one covers the frame.
    for leaf in 0..=LEAVES {
        let radius = smallest / (1.0 - in_reach * rng.random::<f64>()).sqrt();
        let radius = if leaf == 0 { 2.0 * side as f64 } else { radius };
        let [x, y] = [0; 2].map(|_| rng.random_range(0..side) as isize);
        let grey = rng.random::<f64>();
        for plane in planes.chunks_exact_mut(side * side) {
            fill_disc(plane, side, y, x, radius, brightness * (grey + rng.random::<f64>()) / 2.0);
        }
    }
    overlay.of_canvas(planes)
}

/// Smooth coloured clouds: in each channel a sum of plane waves of equal height, each of which moves along its own
/// direction.
#[derive(Debug, Clone)]
pub(super) struct Clouds {
    side: usize,
    brightness: f64,
    /// Channel by channel.
    waves: Vec<[Wave; WAVES]>,
}

#[derive(Debug, Clone, Copy)]
struct Wave {
    /// Radians a pixel along x and y.
    vector: [f64; 2],
    /// Radians.
    phase: f64,
    /// Radians a frame.
    frequency: f64,
}

impl Clouds {
    /// Levels of 0 to `brightness`; each wave moves by `drift` pixels a frame.
    pub(super) fn new(side: usize, channels: usize, brightness: f64, drift: f64, rng: &mut impl Rng) -> Self {
        let [shortest, longest] = WAVELENGTHS.map(|share| share * side as f64);
        let mut wave = || {
            let length = shortest * (longest / shortest).powf(rng.random::<f64>());
            let (number, direction) = (TAU / length, rng.random_range(0.0..TAU));
            let vector = [number * direction.cos(), number * direction.sin()];
            Wave { vector, phase: rng.random_range(0.0..TAU), frequency: number * drift }
        };
        let waves = (0..channels).map(|_| [0; WAVES].map(|_| wave())).collect();
        Self { side, brightness, waves }
    }

    /// When a clip begins, frames.
    pub(super) fn random_time(&self, rng: &mut impl Rng) -> f64 {
        rng.random_range(0.0..TIMES)
    }

    /// Levels of a frame at this time, counted in frames, channel by channel.
    pub(super) fn levels(&self, time: f64) -> Vec<f64> {
        let at = |waves: &[Wave; WAVES], x: f64, y: f64| {
            let height = |wave: &Wave| {
                (wave.vector[0] * x + wave.vector[1] * y + wave.phase - wave.frequency * time).cos() / WAVES as f64
            };
            self.brightness * (1.0 + waves.iter().map(height).sum::<f64>()) / 2.0
        };
        let pixels = self.side * self.side;
        let plane =
            |waves| (0..pixels).map(move |pixel| at(waves, (pixel % self.side) as f64, (pixel / self.side) as f64));
        self.waves.iter().flat_map(plane).collect()
    }
}
