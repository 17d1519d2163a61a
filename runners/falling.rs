//! A white ball that is thrown and falls.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("falling")
}
