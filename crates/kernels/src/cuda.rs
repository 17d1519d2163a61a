//! Work on a GPU that is recorded once and repeated (a CUDA graph), which tch has no call for (`cuda.cpp`).
//!
//! A step of a training is a thousand small computations. A GPU does each in a few microseconds, and as long takes the
//! processor to ask for it; a recording asks for all of them at once. What is computed is the same.

use std::any::Any;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::fmt::{self, Debug};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::NonNull;
use std::sync::{Mutex, PoisonError, RwLock};

use anyhow::{Context, Result, anyhow, bail};
use tch::{Device, Kind, Tensor};

use super::panics;
use super::threads::locked;

/// Calls that are made one computation at a time before one is recorded: libraries choose their algorithms and take their
/// memory in them.
const WARM_UP: usize = 3;

unsafe extern "C" {
    fn paig_cuda_failure() -> *const c_char;
    fn paig_cuda_built() -> bool;
    fn paig_cuda_stream(device: c_int) -> bool;
    fn paig_allow_tf32(allowed: bool);
    fn paig_graph_begin() -> *mut c_void;
    fn paig_graph_end(graph: *mut c_void) -> bool;
    fn paig_graph_replay(graph: *mut c_void) -> bool;
    fn paig_graph_free(graph: *mut c_void);
}

/// Why the last call failed.
fn failure() -> String {
    // SAFETY: a string that ends, and lives until the next call of this thread.
    let text = unsafe { CStr::from_ptr(paig_cuda_failure()) };
    text.to_string_lossy().lines().next().unwrap_or_default().to_string()
}

/// Whether products of float32 numbers may be rounded to ten bits on a GPU, which is several times as fast there.
pub fn allow_tf32(allowed: bool) {
    // SAFETY: sets two switches of libtorch.
    unsafe { paig_allow_tf32(allowed) };
}

/// Gives this thread a stream of its own on a GPU: what threads ask for does not wait for each other, and can be recorded.
/// Nothing on another device.
///
/// # Errors
/// A GPU that fails.
pub fn own_stream(device: Device) -> Result<()> {
    let Device::Cuda(index) = device else { return Ok(()) };
    caught(|| {
        // What was asked for so far is to be there.
        tch::Cuda::synchronize(index as i64);
        // libtorch loads its linear algebra for GPUs when it is first wanted, and fails where two threads want it at once.
        static LOADED: Mutex<bool> = Mutex::new(false);
        let mut loaded = locked(&LOADED);
        if !*loaded {
            let _guard = tch::no_grad_guard();
            let one = Tensor::ones([2, 1, 1], (Kind::Double, device));
            let _ = Tensor::linalg_solve_ex(&one, &one, true, false);
            *loaded = true;
        }
        Ok(())
    })
    .context("the GPU fails")?;
    // SAFETY: sets the stream of this thread.
    if !unsafe { paig_cuda_stream(index as c_int) } {
        bail!("the GPU gives no stream: {}", failure());
    }
    Ok(())
}

/// The error in the place of a panic.
fn caught<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    let failed = |panic: Box<dyn Any + Send>| Err(anyhow!("{}", panics::first_line(panic.as_ref())));
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(failed)
}

/// libtorch computes the gradients of all threads in one thread of its own. What that does for another thread in the midst of a
/// recording would become part of it, and fail.
static GRADIENTS: RwLock<()> = RwLock::new(());

/// Recorded work.
struct CudaGraph(NonNull<c_void>);

// SAFETY: CUDA takes calls from any thread, one at a time, as `&mut` has it.
unsafe impl Send for CudaGraph {}

impl CudaGraph {
    /// Records what `work` asks of the GPU, without doing it. What it gives is written by each repetition.
    fn of<T>(work: impl FnOnce() -> Result<T>) -> Result<(Self, T)> {
        let _alone = GRADIENTS.write().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: begins on this thread's stream; ended below whatever happens.
        let Some(graph) = NonNull::new(unsafe { paig_graph_begin() }) else { bail!("{}", failure()) };
        let recording = CudaGraph(graph);
        // tch panics where libtorch fails; a recording that was begun must end.
        let made = caught(work);
        // SAFETY: it was begun above.
        let ended = unsafe { paig_graph_end(graph.as_ptr()) };
        let made = made?;
        if !ended {
            bail!("{}", failure());
        }
        Ok((recording, made))
    }

    fn repeat(&mut self) -> Result<()> {
        // SAFETY: the recording has ended; the tensors in it live as long as it does.
        if !unsafe { paig_graph_replay(self.0.as_ptr()) } {
            bail!("the GPU failed: {}", failure());
        }
        Ok(())
    }
}

impl Drop for CudaGraph {
    fn drop(&mut self) {
        // SAFETY: made by `paig_graph_begin`, and freed once.
        unsafe { paig_graph_free(self.0.as_ptr()) };
    }
}

/// A function of tensors that is called often. On a GPU it is recorded as soon as its inputs have kept their sizes for a few
/// calls; elsewhere it is simply called.
///
/// Such a function must not look at a number on the GPU, and what it depends on besides its inputs must stay where it is.
pub struct Repeated<T> {
    device: Device,
    /// Of the inputs of the last calls, and how many calls that were.
    sizes: Vec<Vec<i64>>,
    calls: usize,
    recorded: Option<Recorded>,
    /// Why the function cannot be recorded.
    refused: Option<String>,
    /// Of the last call; of a recording, where it is written.
    result: Option<T>,
}

struct Recorded {
    recording: CudaGraph,
    inputs: Vec<Tensor>,
}

impl<T> Debug for Repeated<T> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("Repeated").field("device", &self.device).field("calls", &self.calls).finish_non_exhaustive()
    }
}

impl<T> Repeated<T> {
    /// Of a function on tensors of this device; a GPU records only for threads with a stream of their own ([`own_stream`]).
    pub fn on(device: Device) -> Self {
        Repeated { device, sizes: Vec::new(), calls: 0, recorded: None, refused: None, result: None }
    }

    /// What the function makes of these inputs.
    ///
    /// # Errors
    /// Those of the function, and a GPU that fails.
    pub fn call(&mut self, inputs: &[Tensor], mut function: impl FnMut(&[Tensor]) -> Result<T>) -> Result<&T> {
        let sizes: Vec<_> = inputs.iter().map(Tensor::size).collect();
        if sizes != self.sizes {
            (self.sizes, self.calls, self.recorded) = (sizes, 0, None);
        }
        self.calls += 1;
        if self.is_to_be_recorded() {
            let kept: Vec<_> = inputs.iter().map(|input| input.detach().copy()).collect();
            // SAFETY: tells how this program was built.
            let recording = match unsafe { paig_cuda_built() } {
                true => CudaGraph::of(|| function(&kept)),
                false => Err(anyhow!("this program was built without CUDA's headers")),
            };
            match recording {
                Ok((recording, result)) => {
                    (self.recorded, self.result) = (Some(Recorded { recording, inputs: kept }), Some(result));
                }
                Err(error) => self.refused = Some(format!("{error:#}")),
            }
        }
        if let Some(Recorded { recording, inputs: kept }) = &mut self.recorded {
            let _guard = tch::no_grad_guard();
            kept.iter_mut().zip(inputs).for_each(|(kept, input)| kept.copy_(input));
            recording.repeat()?;
        } else {
            let _beside = GRADIENTS.read().unwrap_or_else(PoisonError::into_inner);
            self.result = Some(function(inputs)?);
        }
        Ok(self.result.as_ref().expect("either way leaves a result"))
    }

    fn is_to_be_recorded(&self) -> bool {
        matches!(self.device, Device::Cuda(_))
            && self.recorded.is_none()
            && self.refused.is_none()
            && self.calls > WARM_UP
    }

    /// Why the function could not be recorded, if it could not.
    pub fn refused(&self) -> Option<&str> {
        self.refused.as_deref()
    }
}
