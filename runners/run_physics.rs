//! Trains and scores PAIG on any task of the task table.

fn main() -> std::process::ExitCode {
    paig::cli::run::any_task()
}
