//! What `paig --version` prints.

use paig::kernels::Instructions;
use paig::support::device::{LIBTORCH_VERSION, cores, processor};
use tch::Cuda;

use crate::PROGRAM;

/// Version and commit, then libtorch, processor and GPUs.
pub fn text() -> String {
    let gpus = if Cuda::is_available() { format!("{} GPU(s)", Cuda::device_count()) } else { "no GPU".into() };
    let processor = processor().unwrap_or_else(|| "unknown processor".into());
    format!(
        "{} ({})\nlibtorch {LIBTORCH_VERSION}, {gpus}\n{processor}, {} cores, vectors of {} floats",
        PROGRAM.version,
        PROGRAM.commit,
        cores(),
        Instructions::best().lanes()
    )
}
