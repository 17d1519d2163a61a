//! Frames seen through masks, written at once in the order in which a dense layer reads them.

use super::threads::{in_parallel, part_of};

/// The sizes of masked frames.
#[derive(Debug, Clone, Copy)]
pub struct MaskSizes {
    pub frames: usize,
    /// Masks that are applied; the frames' masks may have more.
    pub objects: usize,
    pub masks: usize,
    pub channels: usize,
    /// Of a frame.
    pub pixels: usize,
}

/// `masks` `[frames, masks, pixels]` times `frames` `[frames, channels, pixels]`, as `[objects, frames, pixels, channels]`.
pub fn apply(sizes: MaskSizes, masks: &[f32], frames: &[f32], to: &mut [f32]) {
    let MaskSizes { channels, pixels, .. } = sizes;
    let size = pixels * channels;
    assert!(frames.len() == sizes.frames * size && to.len() == sizes.objects * frames.len());
    assert!(sizes.objects <= sizes.masks && masks.len() == sizes.frames * sizes.masks * pixels);
    let part = part_of(sizes.objects * sizes.frames);
    let parts: Vec<_> = to.chunks_mut(part * size).enumerate().collect();
    in_parallel(parts, |(number, to)| {
        for (i, to) in to.chunks_exact_mut(size).enumerate() {
            let (object, frame) = ((number * part + i) / sizes.frames, (number * part + i) % sizes.frames);
            let mask = &masks[(frame * sizes.masks + object) * pixels..][..pixels];
            for (channel, seen) in frames[frame * size..][..size].chunks_exact(pixels).enumerate() {
                let places = to[channel..].iter_mut().step_by(channels);
                for ((to, mask), seen) in places.zip(mask).zip(seen) {
                    *to = mask * seen;
                }
            }
        }
    });
}

/// From the gradient of the masked frames that of the masks, `[frames, masks, pixels]`, 0 for those that were not applied.
pub fn apply_backward(sizes: MaskSizes, gradient: &[f32], frames: &[f32]) -> Vec<f32> {
    let MaskSizes { channels, pixels, .. } = sizes;
    let size = pixels * channels;
    assert!(frames.len() == sizes.frames * size && gradient.len() == sizes.objects * frames.len());
    assert!(sizes.objects <= sizes.masks);
    let mut masks = vec![0.0; sizes.frames * sizes.masks * pixels];
    let part = part_of(sizes.frames);
    let parts: Vec<_> = masks.chunks_mut(part * sizes.masks * pixels).enumerate().collect();
    in_parallel(parts, |(number, masks)| {
        for (i, masks) in masks.chunks_exact_mut(sizes.masks * pixels).enumerate() {
            let frame = number * part + i;
            for (object, mask) in masks.chunks_exact_mut(pixels).take(sizes.objects).enumerate() {
                let back = &gradient[(object * sizes.frames + frame) * size..][..size];
                for (channel, seen) in frames[frame * size..][..size].chunks_exact(pixels).enumerate() {
                    for ((mask, back), seen) in mask.iter_mut().zip(back[channel..].iter().step_by(channels)).zip(seen)
                    {
                        *mask += back * seen;
                    }
                }
            }
        }
    });
    masks
}
