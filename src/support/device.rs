//! Where a run computes.

use anyhow::{Context, Result, bail, ensure};
use tch::{Cuda, Device};

/// `cpu`, `cuda` or `cuda:n`.
///
/// # Errors
/// Another word, or a GPU that libtorch does not see: never a silent fall-back to the CPU.
pub fn parse(text: &str) -> Result<Device> {
    let device = match text.split_once(':') {
        None if text == "cpu" => return Ok(Device::Cpu),
        None if text == "cuda" => Device::Cuda(0),
        Some(("cuda", number)) => Device::Cuda(
            number.parse().ok().with_context(|| format!("device {text:?}: expected cuda:n with n from 0 on"))?,
        ),
        _ => bail!("unknown device {text:?}; expected cpu, cuda or cuda:n"),
    };
    ensure!(
        Cuda::is_available(),
        "device {text:?} asked for, but this libtorch sees no GPU; use --device cpu, or install the GPU libraries with \
         `make libtorch CUDA=1` and check the driver"
    );
    let Device::Cuda(index) = device else { unreachable!("cpu has returned") };
    ensure!(
        (index as i64) < Cuda::device_count(),
        "device {text:?} asked for, but there are {} GPUs",
        Cuda::device_count()
    );
    Ok(device)
}

/// Sets the number of threads libtorch computes with; 0 takes one for each core. Returns the number.
pub fn set_threads(threads: usize) -> usize {
    let threads = match threads {
        0 => cores(),
        given => given,
    };
    tch::set_num_threads(threads as i32);
    threads
}

/// The processor, as the kernel names it.
pub fn processor() -> Option<String> {
    let processors = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = |line: &str| Some(line.strip_prefix("model name")?.trim_start().strip_prefix(": ")?.to_string());
    processors.lines().find_map(name)
}

/// The cores that this program may use.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The commit that this program was built from, with a `+` where the sources differ from it.
pub const COMMIT: &str = env!("PAIG_COMMIT");
/// Version of the libtorch this was built with.
pub const LIBTORCH_VERSION: &str = env!("PAIG_LIBTORCH_VERSION");
