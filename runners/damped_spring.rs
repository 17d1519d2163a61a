//! Two coloured balls joined by a spring, with friction.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("damped_spring")
}
