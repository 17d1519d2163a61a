//! Two coloured balls joined by a spring.

use paig::run::Program;

fn main() -> std::process::ExitCode {
    paig_terminal::run::one_task(
        "spring_color",
        Program { version: env!("CARGO_PKG_VERSION"), commit: env!("PAIG_COMMIT") },
    )
}
