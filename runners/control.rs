//! Brings what is seen to a goal by planning. See `control --help`.

fn main() -> std::process::ExitCode {
    paig::cli::control::main()
}
