//! The spring, seen in one half of the frame during input and prediction.

use paig::run::Program;

fn main() -> std::process::ExitCode {
    paig_terminal::run::one_task(
        "spring_color_half",
        Program { version: env!("CARGO_PKG_VERSION"), commit: env!("PAIG_COMMIT") },
    )
}
