//! What `paig --version` prints.

use paig::kernels::{Instructions, libtorch_capability, vector_path};
use paig::support::device::{LIBTORCH_VERSION, cores, processor};
use tch::Cuda;

use crate::PROGRAM;

/// Version and commit, then libtorch, processor and GPUs.
pub fn text() -> String {
    let gpus = if Cuda::is_available() { format!("{} GPU(s)", Cuda::device_count()) } else { "no GPU".into() };
    let path = match vector_path() {
        Ok(instructions) => instructions.map_or("libtorch", Instructions::name),
        Err(why) => why,
    };
    let processor = processor().unwrap_or_else(|| "unknown processor".into());
    format!(
        "{} ({})\nlibtorch {LIBTORCH_VERSION}, CPU capability {}, {gpus}\n{processor}, {} cores, vector path {path}",
        PROGRAM.version,
        PROGRAM.commit,
        libtorch_capability(),
        cores(),
    )
}
