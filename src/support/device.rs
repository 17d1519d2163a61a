//! Where a run computes, and the line that says so.

use std::os::unix::process::CommandExt;
use std::process::Command;

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

/// What the C libraries read from the environment before `main`, and why it is set. Results depend on none of it.
const ENVIRONMENT: [(&str, &str); 2] = [
    // OpenMP's threads sleep while they wait: its default, to spin, makes a training several times slower as soon as
    // anything else runs on the machine.
    ("OMP_WAIT_POLICY", "passive"),
    // Freed tensors stay with the process, in large pages: by default each one of some MB goes back to the kernel and is
    // fetched again, page by page, which takes a fifth of a training on frames of 64 x 64.
    (
        "GLIBC_TUNABLES",
        "glibc.malloc.mmap_threshold=4294967296:glibc.malloc.trim_threshold=17179869184:glibc.malloc.hugetlb=1",
    ),
];

/// Starts the program over with the environment in which libtorch computes fastest. A value the user has set stands.
pub fn set_environment() {
    let missing: Vec<_> = ENVIRONMENT.into_iter().filter(|(name, _)| std::env::var_os(name).is_none()).collect();
    if missing.is_empty() {
        return;
    }
    if let Ok(program) = std::env::current_exe() {
        // On success this does not return; on failure the run goes on as it is, only slower.
        let _ = Command::new(program).args(std::env::args_os().skip(1)).envs(missing).exec();
    }
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

/// The first line of every run: versions, device, threads.
pub fn banner(device: Device, threads: usize) -> String {
    let gpu = if Cuda::is_available() { format!("{} GPU(s) visible", Cuda::device_count()) } else { "no GPU".into() };
    let device = match device {
        Device::Cpu => "cpu".to_string(),
        Device::Cuda(n) => format!("cuda:{n}"),
        other => format!("{other:?}"),
    };
    let s = if threads == 1 { "" } else { "s" };
    format!(
        "paig {} ({COMMIT}) | libtorch {LIBTORCH_VERSION} | device {device} ({gpu}) | {threads} thread{s}",
        env!("CARGO_PKG_VERSION")
    )
}
