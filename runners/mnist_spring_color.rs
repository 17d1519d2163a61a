//! Two MNIST digits joined by a spring over a CIFAR-10 background.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("mnist_spring_color")
}
