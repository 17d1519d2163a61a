//! How much memory a training will take, told before it begins.

use super::config::Config;
use super::objects::motion;
use crate::network::blocks::UNet;

/// Numbers for each pixel, channel and object, and for the background, of what is drawn and compared.
const DRAWN: f64 = 20.0;
/// Bytes for each number of the frames of which the median is taken: two copies, and their order.
const SORTED: f64 = 24.0;
/// Bytes of a number.
const FLOAT: f64 = 4.0;

/// Bytes that a training on so many clips takes on a CPU beyond what its program and its data hold, about: what the largest
/// step leaves in all layers for its gradient, or the median frame of what it is sorted from.
pub(crate) fn footprint(config: &Config, clips: usize) -> u64 {
    let system = &config.task.system;
    let pixels = (system.side * system.side) as f64;
    let layers = UNet::shape(system.side, system.channels, system.objects).numbers_per_pixel();
    let drawn = DRAWN * (system.channels * (system.objects + 1)) as f64;
    let discovered = config.discover.as_ref().map_or(0, |discover| discover.frames);
    let frames = discovered.max(config.join.batch.min(clips) * config.task.train_frames);
    let step = frames as f64 * pixels * (layers + drawn) * FLOAT;
    let median = motion::FRAMES as f64 * pixels * system.channels as f64 * SORTED;
    step.max(median) as u64
}
