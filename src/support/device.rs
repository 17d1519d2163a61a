//! Where a run computes.

use anyhow::{Context, Result, bail, ensure};
use paig_kernels::allow_tf32;
use tch::{Cuda, Device};

use super::error::{ErrorKind, OfKind};

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
    visible(text, device).of_kind(ErrorKind::Device)
}

/// Refuses a GPU that libtorch does not see.
fn visible(text: &str, device: Device) -> Result<Device> {
    ensure!(
        Cuda::is_available(),
        "device {text:?} asked for, but this libtorch sees no GPU; use --device cpu, or install the GPU libraries with \
         `make libtorch CUDA=1` and check the driver"
    );
    let Device::Cuda(index) = device else { unreachable!("cpu has returned") };
    ensure!(
        i64::try_from(index).is_ok_and(|index| index < Cuda::device_count()),
        "device {text:?} asked for, but there are {} GPUs",
        Cuda::device_count()
    );
    Ok(device)
}

/// Threads for each core, and in all, that may be asked for: more of them only wait for each other.
const MOST_PER_CORE: usize = 8;
const MOST_ON_FEW_CORES: usize = 64;

/// Threads that may be asked for on this machine.
pub fn most_threads() -> usize {
    (MOST_PER_CORE * cores()).max(MOST_ON_FEW_CORES)
}

/// The number of threads that is meant: 0 is one for each core.
///
/// # Errors
/// Many more than there are cores: such a run would stand for minutes before its first step.
pub fn threads(asked: usize) -> Result<usize> {
    let most = most_threads();
    ensure!(asked <= most, "{asked} threads: at most {most} on the {} cores of this machine", cores());
    Ok(if asked == 0 { cores() } else { asked })
}

/// Sets the number of threads libtorch computes with; 0 takes one for each core. Returns the number.
///
/// # Errors
/// As for [`threads`].
pub fn set_threads(asked: usize) -> Result<usize> {
    let threads = threads(asked)?;
    tch::set_num_threads(threads as i32);
    Ok(threads)
}

/// Lets products on a GPU be rounded to ten bits (TF32), or not, in the whole program; nothing on the CPU.
pub fn set_tf32(device: Device, allowed: bool) {
    if device != Device::Cpu {
        allow_tf32(allowed);
    }
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

pub use paig_kernels::LIBTORCH_VERSION;
