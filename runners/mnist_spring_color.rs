//! Two MNIST digits joined by a spring over a CIFAR-10 background.

use paig::run::Program;

fn main() -> std::process::ExitCode {
    paig_terminal::run::one_task(
        "mnist_spring_color",
        Program { version: env!("CARGO_PKG_VERSION"), commit: env!("PAIG_COMMIT") },
    )
}
