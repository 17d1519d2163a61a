//! Three coloured balls that attract each other.

use paig::run::Program;

fn main() -> std::process::ExitCode {
    paig_terminal::run::one_task(
        "3bp_color",
        Program { version: env!("CARGO_PKG_VERSION"), commit: env!("PAIG_COMMIT") },
    )
}
