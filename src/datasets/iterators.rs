//! Serving frames in batches: uint8 in memory or on the disk, float32 only for the batch at hand.
//!
//! Original: `nn/datasets/iterators.py`. What a step sees is a function of the seed and the step alone, so a resumed
//! run needs no saved iterator.

use anyhow::{Result, ensure};
use ndarray::{Array, Array2, Array5, Dimension};
use rand::Rng;
use rand::seq::SliceRandom;
use tch::kind::Element;
use tch::{Device, Kind, Tensor};

use super::light::Light;
use super::unpacked::UnpackedFrames;
use crate::network::cells::Actions;
use crate::support::random::named_generator;

/// Where the frames are.
#[derive(Debug)]
enum FrameStore {
    /// On the device, uint8 `[clips, time, S, S, channels]`.
    InMemory(Tensor),
    OnDisk(UnpackedFrames, Device),
}

/// One split of a dataset.
#[derive(Debug)]
pub struct Clips {
    pixels: FrameStore,
    /// float32 `[clips, time]`.
    actions: Option<Tensor>,
    /// What each frame is divided by, float32 `[clips * time]`, where the light flickers.
    light: Option<Tensor>,
    /// Whether frames are served at half their side.
    halved: bool,
}

/// Frames by which it is decided whether the light flickers, and frames whose light is measured at a time.
const SAMPLED_FRAMES: usize = 200;
const MEASURED_FRAMES: i64 = 500;

impl Clips {
    /// Moves frames `[clips, time, S, S, channels]` and what acts from outside, `[clips, time]`, to the device.
    pub fn new(pixels: &Array5<u8>, actions: Option<&Array2<f32>>, device: Device) -> Self {
        Self::steadied(FrameStore::InMemory(to_device(pixels, device)), actions, device)
    }

    /// The same of frames on the disk, of which each batch is moved to the device.
    pub fn on_disk(frames: UnpackedFrames, actions: Option<&Array2<f32>>, device: Device) -> Self {
        Self::steadied(FrameStore::OnDisk(frames, device), actions, device)
    }

    /// In even light.
    fn steadied(pixels: FrameStore, actions: Option<&Array2<f32>>, device: Device) -> Self {
        let actions = actions.map(|actions| to_device(actions, device));
        let clips = Clips { pixels, actions, light: None, halved: false };
        let light = clips.flickering_light();
        Clips { light, ..clips }
    }

    /// The same clips, served at half their side: each pixel is the mean of four.
    pub fn halved(&self) -> Self {
        let pixels = match &self.pixels {
            FrameStore::InMemory(pixels) => FrameStore::InMemory(pixels.shallow_clone()),
            FrameStore::OnDisk(stored, device) => FrameStore::OnDisk(stored.clone(), *device),
        };
        let [actions, light] = [&self.actions, &self.light].map(|kept| kept.as_ref().map(Tensor::shallow_clone));
        Clips { pixels, actions, light, halved: true }
    }

    /// Frames `[frames, channels, S, S]` in the size in which they are served.
    fn sized(&self, frames: Tensor) -> Tensor {
        if self.halved { frames.avg_pool2d(2, 2, 0, false, true, None) } else { frames }
    }

    /// The light of each frame by its place, `[clips * time]`, if it flickers. Each split decides by itself: a test file is
    /// scored, and a video measured, without the clips that were learned from.
    fn flickering_light(&self) -> Option<Tensor> {
        let (clips, time) = (self.len() as i64, self.time() as i64);
        if clips == 0 || time < 2 {
            return None;
        }
        let light = Light::shown_by(&self.median_frame(SAMPLED_FRAMES, 0))?;
        let followed = |place: &i64| (place + 1) % time != 0;
        let sampled: Vec<_> = self.random_places(SAMPLED_FRAMES, 0, 0).into_iter().filter(followed).collect();
        let next: Vec<_> = sampled.iter().map(|place| place + 1).collect();
        if sampled.is_empty() || !light.flickers(&self.frames(&sampled), &self.frames(&next)) {
            return None;
        }
        let parts = (0..clips * time).step_by(MEASURED_FRAMES as usize).map(|first| {
            let places: Vec<_> = (first..(first + MEASURED_FRAMES).min(clips * time)).collect();
            light.of(&self.frames(&places))
        });
        Some(Tensor::cat(&parts.collect::<Vec<_>>(), 0))
    }

    /// Whether the light flickers, and frames are divided by it.
    pub fn flickers(&self) -> bool {
        self.light.is_some()
    }

    /// Frames `[.., S, S, channels]`, of these places in the sequence of all frames, in even light.
    fn in_even_light(&self, frames: Tensor, places: impl FnOnce() -> Vec<i64>) -> Tensor {
        let Some(light) = &self.light else { return frames };
        let index = Tensor::from_slice(&places()).to_device(light.device());
        let size = frames.size();
        let flat = frames.reshape([-1, size[size.len() - 3], size[size.len() - 2], size[size.len() - 1]]);
        (flat / light.index_select(0, &index).reshape([-1, 1, 1, 1])).clamp(0.0, 1.0).reshape(size)
    }

    /// Where batches are served.
    pub fn device(&self) -> Device {
        match &self.pixels {
            FrameStore::InMemory(pixels) => pixels.device(),
            FrameStore::OnDisk(_, device) => *device,
        }
    }

    /// Number of clips.
    pub fn len(&self) -> usize {
        match &self.pixels {
            FrameStore::InMemory(pixels) => pixels.size()[0] as usize,
            FrameStore::OnDisk(frames, _) => frames.clips(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Frames in a clip.
    pub fn time(&self) -> usize {
        match &self.pixels {
            FrameStore::InMemory(pixels) => pixels.size()[1] as usize,
            FrameStore::OnDisk(frames, _) => frames.time(),
        }
    }

    /// The first `frames` frames of these clips, `[batch, frames, channels, S, S]` in \[0, 1\].
    pub fn batch(&self, clips: &[i64], frames: usize) -> Tensor {
        let pixels = match &self.pixels {
            FrameStore::InMemory(pixels) => {
                let index = Tensor::from_slice(clips).to_device(pixels.device());
                pixels.narrow(1, 0, frames as i64).index_select(0, &index)
            }
            FrameStore::OnDisk(stored, device) => {
                let firsts: Vec<_> = clips.iter().map(|clip| clip * stored.time() as i64).collect();
                read(stored, &firsts, frames, *device)
            }
        };
        let shown = self.in_even_light(to_float(&pixels), || self.places(clips, frames)).permute([0, 1, 4, 2, 3]);
        let [clips, time] = [shown.size()[0], shown.size()[1]];
        self.sized(shown.flatten(0, 1)).unflatten(0, [clips, time])
    }

    /// What acts from outside during these clips, if anything does.
    pub fn actions(&self, clips: &[i64]) -> Actions {
        Actions::new(self.actions.as_ref().map(|actions| {
            let index = Tensor::from_slice(clips).to_device(actions.device());
            actions.index_select(0, &index)
        }))
    }

    /// Single frames by their place in the sequence of all frames, `[batch, channels, S, S]` in \[0, 1\].
    pub fn frames(&self, places: &[i64]) -> Tensor {
        let pixels = match &self.pixels {
            FrameStore::InMemory(pixels) => {
                let index = Tensor::from_slice(places).to_device(pixels.device());
                pixels.flatten(0, 1).index_select(0, &index)
            }
            FrameStore::OnDisk(stored, device) => read(stored, places, 1, *device).squeeze_dim(1),
        };
        self.sized(self.in_even_light(to_float(&pixels), || places.to_vec()).permute([0, 3, 1, 2]))
    }

    /// The places of the first `frames` frames of these clips in the sequence of all frames, clip by clip.
    pub fn places(&self, clips: &[i64], frames: usize) -> Vec<i64> {
        let (time, frames) = (self.time() as i64, frames as i64);
        clips.iter().flat_map(|clip| (0..frames).map(move |frame| clip * time + frame)).collect()
    }

    /// The places of `count` frames drawn at random from all clips for a step.
    pub(crate) fn random_places(&self, count: usize, seed: u64, step: u64) -> Vec<i64> {
        let all = (self.len() * self.time()) as i64;
        let mut random = named_generator(seed, &format!("frames of step {step}"));
        (0..count).map(|_| random.random_range(0..all)).collect()
    }

    /// For each frame, by its place, the median over time of the clip it is of: `[places, channels, S, S]` in \[0, 1\].
    pub(crate) fn clip_medians(&self, places: &[i64]) -> Tensor {
        let clips: Vec<i64> = places.iter().map(|place| place / self.time() as i64).collect();
        self.batch(&clips, self.time()).median_dim(1, false).0
    }

    /// The median over time and clips of each pixel, `[channels, S, S]` in \[0, 1\], from `count` random frames, or from all
    /// if there are no more: what stands still.
    pub fn median_frame(&self, count: usize, seed: u64) -> Tensor {
        let all = (self.len() * self.time()) as i64;
        let mut random = named_generator(seed, "median frame");
        let places: Vec<_> = if all <= count as i64 {
            (0..all).collect()
        } else {
            (0..count).map(|_| random.random_range(0..all)).collect()
        };
        self.frames(&places).median_dim(0, false).0
    }
}

/// So many frames from each of these places on, uint8 `[places, frames, S, S, channels]`.
///
/// # Panics
/// A disk that fails, with the error: the program ends with it as its message.
fn read(stored: &UnpackedFrames, firsts: &[i64], frames: usize, device: Device) -> Tensor {
    let bytes = stored.read(firsts.iter().map(|first| *first as usize), frames);
    let bytes = bytes.unwrap_or_else(|error| std::panic::panic_any(error));
    let [height, width, channels] = stored.frame_shape().map(|count| count as i64);
    let shape = [firsts.len() as i64, frames as i64, height, width, channels];
    Tensor::from_slice(&bytes).reshape(shape).to_device(device)
}

fn to_device<T: Element, D: Dimension>(array: &Array<T, D>, device: Device) -> Tensor {
    let shape: Vec<i64> = array.shape().iter().map(|&n| n as i64).collect();
    let contiguous = array.as_standard_layout();
    Tensor::from_slice(contiguous.as_slice().expect("standard layout")).reshape(shape).to_device(device)
}

fn to_float(pixels: &Tensor) -> Tensor {
    // The channels stay last in memory, the layout in which libtorch's convolutions are fastest; the kernels copy them.
    pixels.to_kind(Kind::Float) / 255.0
}

/// Steps in one pass over so many clips; of fewer than a batch all make one.
pub(crate) fn steps_per_epoch(clips: usize, batch: usize) -> u64 {
    (clips / batch.max(1)).max(1) as u64
}

/// Shuffled passes over a split; the last partial batch of a pass is dropped, as in the original.
#[derive(Debug)]
pub struct ShuffledBatches {
    seed: u64,
    clips: usize,
    batch: usize,
    /// The epoch whose order is at hand.
    epoch: Option<u64>,
    order: Vec<i64>,
}

impl ShuffledBatches {
    /// Of fewer clips than a batch all make one.
    ///
    /// # Errors
    /// No clips, or a batch of none.
    pub fn new(clips: usize, batch: usize, seed: u64) -> Result<Self> {
        ensure!(
            clips > 0 && batch > 0,
            "{clips} training clips in batches of {batch}: there must be at least one each"
        );
        Ok(ShuffledBatches { seed, clips, batch: batch.min(clips), epoch: None, order: Vec::new() })
    }

    /// Steps in one pass.
    pub(crate) fn steps_per_epoch(&self) -> u64 {
        steps_per_epoch(self.clips, self.batch)
    }

    /// The clips of a step (counted from 0 over all passes).
    pub fn clips_of_step(&mut self, step: u64) -> &[i64] {
        let epoch = step / self.steps_per_epoch();
        if self.epoch != Some(epoch) {
            self.order = (0..self.clips as i64).collect();
            self.order.shuffle(&mut named_generator(self.seed, &format!("order of epoch {epoch}")));
            self.epoch = Some(epoch);
        }
        let first = (step % self.steps_per_epoch()) as usize * self.batch;
        &self.order[first..first + self.batch]
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn an_epoch_shows_each_clip_once_and_each_in_another_order() {
        let batches = || ShuffledBatches::new(10, 3, 7).unwrap();
        let mut shown = batches();
        assert_eq!((shown.steps_per_epoch(), steps_per_epoch(10, 3), steps_per_epoch(2, 3)), (3, 3, 1));
        let epochs: Vec<Vec<i64>> = (0..3)
            .map(|epoch| (3 * epoch..3 * epoch + 3).flat_map(|step| shown.clips_of_step(step).to_vec()).collect())
            .collect();
        for epoch in &epochs {
            let clips: BTreeSet<_> = epoch.iter().filter(|clip| (0..10).contains(*clip)).collect();
            assert_eq!((epoch.len(), clips.len()), (9, 9), "{epoch:?}");
        }
        assert!(epochs[0] != epochs[1] && epochs[1] != epochs[2], "{epochs:?}");
        // A run that is taken up sees what it would have seen.
        assert_eq!(batches().clips_of_step(7), &epochs[2][3..6]);
    }
}
