//! The line that says where a run computes.

use tch::{Cuda, Device};

use paig::run::Program;
use paig::support::device::LIBTORCH_VERSION;
use paig_kernels::gpu;

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
