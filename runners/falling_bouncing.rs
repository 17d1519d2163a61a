//! A white ball that falls and bounces off the walls.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("falling_bouncing")
}
