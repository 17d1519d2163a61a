//! Prints what the results of a run depend on besides its config: processor, vector path, libtorch's CPU capability.

use anyhow::{Error, Result};
use paig::kernels::{libtorch_capability, vector_path};
use paig::support::device::{LIBTORCH_VERSION, cores, processor};

fn main() -> Result<()> {
    let path = vector_path().as_ref().map_err(Error::msg)?.map_or("libtorch", |instructions| instructions.name());
    println!(
        "{}, {} cores | vector path {path} | libtorch {LIBTORCH_VERSION}, CPU capability {}",
        processor().unwrap_or_else(|| "unknown processor".into()),
        cores(),
        libtorch_capability()
    );
    Ok(())
}
