//! The squared error (`squared_error.cu`), within libtorch's autograd.

use std::ffi::{c_int, c_void};

use tch::Tensor;

use super::launch::{empty_beside, floats, floats_mut, on_stream};
use crate::autograd;

/// `PaigCompared` in `squared_error.cu`.
#[derive(Debug)]
#[repr(C)]
struct Compared {
    a: *const f32,
    b: *const f32,
    rows: c_int,
    width: c_int,
    stride_a: i64,
    stride_b: i64,
}

unsafe extern "C" {
    fn paig_gpu_squared_error_workspace() -> usize;
    fn paig_gpu_squared_error(compared: Compared, workspace: *mut f32, total: *mut f32, stream: *mut c_void) -> bool;
    fn paig_gpu_squared_error_backward(
        compared: Compared,
        gradient: *const f32,
        by_a: *mut f32,
        stream: *mut c_void,
    ) -> bool;
}

/// As [`crate::squared_error()`]; nothing is copied where what follows the first axis stands side by side in
/// memory.
///
/// # Panics
/// Tensors of two sizes or devices.
pub fn squared_error(a: &Tensor, b: &Tensor) -> Tensor {
    assert!(a.size() == b.size() && a.device() == b.device(), "what can be compared");
    let values = [a, b].map(|tensor| rowwise(&tensor.detach()));
    // SAFETY: it tells a number.
    let floats_needed = unsafe { paig_gpu_squared_error_workspace() };
    let mut workspace = empty_beside(a, &[floats_needed as i64]);
    let mut total = empty_beside(a, &[]);
    let [within, to] = [&mut workspace, &mut total].map(floats_mut);
    // SAFETY: tensors of the sizes that are said, which live on the stream as long as the launch needs them.
    on_stream(a, |stream| unsafe { paig_gpu_squared_error(compared(&values), within, to, stream) });
    if !autograd::records(&[a]) {
        return total;
    }
    let size = a.size();
    autograd::attach(total, &[a], move |gradient| {
        let mut by_a = empty_beside(gradient, &size);
        let to = floats_mut(&mut by_a);
        // SAFETY: as above; the gradient is one number.
        on_stream(gradient, |stream| unsafe {
            paig_gpu_squared_error_backward(compared(&values), floats(gradient), to, stream)
        });
        vec![by_a]
    })
}

/// The tensor itself where what follows the first axis stands side by side in memory, else a copy.
fn rowwise(tensor: &Tensor) -> Tensor {
    let side_by_side = tensor.numel() > 0 && tensor.dim() > 0 && tensor.select(0, 0).is_contiguous();
    if side_by_side { tensor.shallow_clone() } else { tensor.contiguous() }
}

fn compared([a, b]: &[Tensor; 2]) -> Compared {
    let rows = a.size().first().copied().unwrap_or(1);
    let width = if rows > 0 { a.numel() as i64 / rows } else { 0 };
    let [stride_a, stride_b] = [a, b].map(|tensor| tensor.stride().first().copied().unwrap_or(0));
    let [a, b] = [a, b].map(first_number);
    Compared { a, b, rows: rows as c_int, width: width as c_int, stride_a, stride_b }
}

fn first_number(rows: &Tensor) -> *const f32 {
    if rows.numel() == 0 || rows.dim() == 0 { floats(rows) } else { floats(&rows.select(0, 0)) }
}

#[cfg(test)]
mod tests {
    use tch::{Kind, Tensor};

    use super::super::testing::test_device;
    use super::squared_error;

    #[test]
    fn the_error_is_that_of_libtorch_and_so_is_its_gradient() {
        let Some(device) = test_device() else { return };
        tch::manual_seed(7);
        for (size, steps) in [([5, 4, 3, 32, 32], 9), ([3, 2, 1, 5, 5], 4), ([1, 1, 1, 1, 1], 1), ([0, 2, 3, 8, 8], 3)]
        {
            let frames = Tensor::rand(size, (Kind::Float, device)).set_requires_grad(true);
            let [batch, time, channels, side, _] = size;
            let clips = Tensor::rand([batch, steps, channels, side, side], (Kind::Float, device));
            let truth = clips.narrow(1, steps - time, time);
            let own = squared_error(&frames, &truth);
            let other = (&frames - &truth).square().sum(Kind::Float);
            let errors = [&own, &other].map(|error| error.double_value(&[]));
            assert!((errors[0] - errors[1]).abs() <= 1e-5 * errors[1], "{errors:?}");
            let gradients =
                [own, other].map(|error| Tensor::run_backward(&[error * 0.7], &[&frames], false, false).remove(0));
            assert!(gradients[0].allclose(&gradients[1], 1e-6, 1e-7, false));
        }
    }

    #[test]
    fn what_is_no_number_shows() {
        let Some(device) = test_device() else { return };
        let frames = Tensor::zeros([2, 2, 3], (Kind::Float, device));
        let _ = frames.select(0, 1).select(0, 0).select(0, 2).fill_(f64::NAN);
        assert!(squared_error(&frames, &frames.zeros_like()).double_value(&[]).is_nan());
    }
}
