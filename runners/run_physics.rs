//! Trains and scores PAIG on any task.

fn main() -> std::process::ExitCode {
    paig::cli::run::any_task()
}
