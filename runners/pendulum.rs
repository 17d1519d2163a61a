//! A pendulum driven by a known torque.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("pendulum")
}
