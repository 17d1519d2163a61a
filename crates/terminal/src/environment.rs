//! The environment that libtorch computes fastest in, and the line that says where a run computes.

use std::os::unix::process::CommandExt;
use std::process::Command;

use tch::{Cuda, Device};

use paig::run::Program;
use paig::support::device::LIBTORCH_VERSION;
use paig_kernels::gpu;

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
pub fn set() {
    let missing: Vec<_> = ENVIRONMENT.into_iter().filter(|(name, _)| std::env::var_os(name).is_none()).collect();
    if missing.is_empty() {
        return;
    }
    if let Ok(program) = std::env::current_exe() {
        // On success this does not return; on failure the run goes on as it is, only slower.
        let _ = Command::new(program).args(std::env::args_os().skip(1)).envs(missing).exec();
    }
}

/// The first line of every run: versions, device, threads.
pub fn banner(program: Program, device: Device, threads: usize) -> String {
    let visible =
        if Cuda::is_available() { format!("{} GPU(s) visible", Cuda::device_count()) } else { "no GPU".into() };
    let device = match device {
        Device::Cpu => "cpu".to_string(),
        Device::Cuda(n) if gpu::suits(n) => format!("cuda:{n}"),
        Device::Cuda(n) => format!("cuda:{n}, by libtorch alone"),
        other => format!("{other:?}"),
    };
    let s = if threads == 1 { "" } else { "s" };
    let Program { version, commit } = program;
    format!(
        "paig {version} ({commit}) | libtorch {LIBTORCH_VERSION} | device {device} ({visible}) | {threads} thread{s}"
    )
}
