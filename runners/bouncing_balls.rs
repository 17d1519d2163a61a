//! Two coloured balls that bounce off the walls.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("bouncing_balls")
}
