//! Two coloured balls that bounce off the walls.

use paig::run::Program;

fn main() -> std::process::ExitCode {
    paig_terminal::run::one_task(
        "bouncing_balls",
        Program { version: env!("CARGO_PKG_VERSION"), commit: env!("PAIG_COMMIT") },
    )
}
