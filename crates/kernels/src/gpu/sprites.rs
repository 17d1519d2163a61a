//! Sprites drawn over a background (`sprites.cu`), within libtorch's autograd.

use std::ffi::{c_int, c_void};

use tch::Tensor;

use super::launch::{empty_beside, floats, floats_mut, on_stream};
use crate::autograd;
use crate::sprites::SceneSizes;

/// Sides of frames that the gradients can be computed of (`MOST_COLUMNS` in `sprites.cu`).
const MOST_COLUMNS: usize = 512;

/// `PaigScene` in `sprites.cu`.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct GpuSceneSizes {
    frames: c_int,
    objects: c_int,
    channels: c_int,
    window: c_int,
    side: c_int,
    outside: f32,
    background: f32,
}

/// `PaigDrawn` in `sprites.cu`.
#[derive(Debug)]
#[repr(C)]
struct GpuDrawn {
    sprites: *const f32,
    background: *const f32,
    rows: *const f32,
    columns: *const f32,
}

/// `PaigSeen` in `sprites.cu`.
#[derive(Debug)]
#[repr(C)]
struct GpuFrames {
    frames: *const f32,
    normaliser: *const f32,
    gradient: *const f32,
}

/// `PaigDrawnGradients` in `sprites.cu`.
#[derive(Debug)]
#[repr(C)]
struct GpuDrawnGradients {
    sprites: *mut f32,
    background: *mut f32,
    rows: *mut f32,
    columns: *mut f32,
}

unsafe extern "C" {
    fn paig_gpu_draw(
        sizes: GpuSceneSizes,
        drawn: GpuDrawn,
        frames: *mut f32,
        normaliser: *mut f32,
        stream: *mut c_void,
    ) -> bool;
    fn paig_gpu_draw_workspace(sizes: GpuSceneSizes) -> usize;
    fn paig_gpu_draw_backward(
        sizes: GpuSceneSizes,
        drawn: GpuDrawn,
        seen: GpuFrames,
        by: GpuDrawnGradients,
        workspace: *mut f32,
        stream: *mut c_void,
    ) -> bool;
}

/// Whether the kernels can draw a scene.
pub fn can_draw(scene: &SceneSizes) -> bool {
    matches!(scene.channels, 1 | 3) && scene.side <= MOST_COLUMNS
}

/// As [`crate::draw`], of sprites, background, rows and columns.
///
/// # Panics
/// Tensors that do not fit the scene, frames of neither 1 nor 3 channels, or of more than 512 columns.
pub fn draw(scene: SceneSizes, inputs: [&Tensor; 4]) -> Tensor {
    let rows = inputs[2];
    let values = inputs.map(|input| input.detach().contiguous());
    let sizes = checked(scene, &values);
    let [count, channels, side] = [sizes.frames, sizes.channels, sizes.side].map(i64::from);
    let mut frames = empty_beside(rows, &[count, channels, side, side]);
    let mut normaliser = autograd::records(&inputs).then(|| empty_beside(rows, &[count, side, side]));
    let to = floats_mut(&mut frames);
    let kept = normaliser.as_mut().map_or(std::ptr::null_mut(), floats_mut);
    // SAFETY: tensors of the sizes that are said, which live on the stream as long as the launch needs them.
    on_stream(rows, |stream| unsafe { paig_gpu_draw(sizes, drawn(&values), to, kept, stream) });
    let Some(normaliser) = normaliser else { return frames };
    let shapes = inputs.map(|input| input.size());
    // The same memory without a history, which would hold itself.
    let seen = frames.detach();
    autograd::attach(frames, &inputs, move |gradient| {
        let mut by = shapes.each_ref().map(|shape| empty_beside(gradient, shape));
        backward(sizes, &values, [&seen, &normaliser, &gradient.contiguous()], by.each_mut());
        by.into()
    })
}

/// The gradients by the values from frames, their normaliser and their gradient.
fn backward(sizes: GpuSceneSizes, values: &[Tensor; 4], seen: [&Tensor; 3], by: [&mut Tensor; 4]) {
    // SAFETY: a function of numbers alone.
    let floats_needed = unsafe { paig_gpu_draw_workspace(sizes) };
    let mut workspace = empty_beside(seen[0], &[floats_needed as i64]);
    let workspace = floats_mut(&mut workspace);
    let [frames, normaliser, gradient] = seen.map(floats);
    let of_frames = GpuFrames { frames, normaliser, gradient };
    let [sprites, background, rows, columns] = by.map(floats_mut);
    let by = GpuDrawnGradients { sprites, background, rows, columns };
    // SAFETY: as in `draw`; the workspace is given back to the stream that it is used on.
    on_stream(seen[0], |stream| unsafe {
        paig_gpu_draw_backward(sizes, drawn(values), of_frames, by, workspace, stream)
    });
}

/// # Panics
/// As [`draw`].
fn checked(scene: SceneSizes, values: &[Tensor; 4]) -> GpuSceneSizes {
    let [sprites, background, rows, columns] = values;
    let frames = rows.size()[1];
    let [objects, channels, window, side] =
        [scene.objects, scene.channels, scene.window, scene.side].map(|size| size as i64);
    assert!(can_draw(&scene), "frames that the kernels can draw");
    assert_eq!(sprites.size(), [objects, 1 + channels, window, window], "sprites of the scene");
    assert_eq!(background.numel() as i64, channels * side * side, "a background of the scene");
    assert_eq!(rows.size(), [objects, frames, side], "rows of the scene");
    assert_eq!(columns.size(), rows.size(), "columns as the rows");
    assert!(values.iter().all(|value| value.device() == rows.device()), "all on one device");
    let [frames, objects, channels, window, side] = [frames, objects, channels, window, side].map(|size| size as c_int);
    GpuSceneSizes { frames, objects, channels, window, side, outside: scene.outside, background: scene.background }
}

fn drawn(values: &[Tensor; 4]) -> GpuDrawn {
    let [sprites, background, rows, columns] = values.each_ref().map(floats);
    GpuDrawn { sprites, background, rows, columns }
}

#[cfg(test)]
mod tests {
    use tch::{Device, Kind, Tensor};

    use super::super::testing::{assert_close, test_device};
    use super::{SceneSizes, draw};
    use crate::backend::Kernels;

    fn by_libtorch(scene: SceneSizes, inputs: [&Tensor; 4]) -> Tensor {
        let [sprites, background, rows, columns] = inputs.map(Tensor::shallow_clone);
        let layers = || [&sprites, &background].map(Tensor::shallow_clone);
        let [frames] = crate::operations::draw(Kernels::Libtorch, scene, layers, [[rows, columns]]);
        frames
    }

    /// Sprites, a background, rows and columns, some of them outside.
    fn anything(scene: SceneSizes, frames: i64, device: Device) -> [Tensor; 4] {
        let [objects, channels, window, side] =
            [scene.objects, scene.channels, scene.window, scene.side].map(|size| size as i64);
        let sprites = Tensor::randn([objects, 1 + channels, window, window], (Kind::Float, device)) * 2.0;
        let background = Tensor::rand([1, channels, side, side], (Kind::Float, device));
        let pixels = || Tensor::rand([objects, frames, side], (Kind::Float, device)) * (window + 3) as f64 - 2.0;
        [sprites, background, pixels(), pixels()].map(|input| input.set_requires_grad(true))
    }

    #[test]
    fn drawing_is_that_of_libtorch_and_so_are_its_gradients() {
        let Some(device) = test_device() else { return };
        tch::manual_seed(5);
        let sizes = [(3, 3, 16, 32, 9), (2, 1, 18, 36, 1), (1, 3, 7, 15, 30), (9, 1, 64, 128, 2)];
        for (objects, channels, window, side, frames) in sizes {
            let scene = SceneSizes { objects, channels, window, side, outside: 5.0, background: 1.0 };
            let inputs = anything(scene, frames, device);
            let own = draw(scene, inputs.each_ref());
            let other = by_libtorch(scene, inputs.each_ref());
            assert_close(&own, &other);
            let weight = own.randn_like();
            let gradients = [&own, &other]
                .map(|frames| Tensor::run_backward(&[(frames * &weight).sum(Kind::Float)], &inputs, false, false));
            for (own, other) in gradients[0].iter().zip(&gradients[1]) {
                assert_close(own, other);
            }
        }
    }

    #[test]
    fn what_is_outside_has_no_gradient_and_what_is_no_place_shows() {
        let Some(device) = test_device() else { return };
        let scene = SceneSizes { objects: 1, channels: 1, window: 4, side: 8, outside: 5.0, background: 1.0 };
        let [sprites, background, rows, columns] = anything(scene, 2, device).map(|input| input.detach());
        let outside = rows.full_like(-0.5).set_requires_grad(true);
        draw(scene, [&sprites, &background, &outside, &columns]).sum(Kind::Float).backward();
        assert_eq!(outside.grad().abs().max().double_value(&[]), 0.0);
        let nowhere = rows.full_like(f64::NAN);
        let drawn = draw(scene, [&sprites, &background, &nowhere, &columns]);
        assert!(bool::try_from(drawn.isnan().all()).unwrap());
    }
}
