//! Two coloured balls that bounce off the walls.

fn main() -> std::process::ExitCode {
    paig::run::one_task("bouncing_balls")
}
