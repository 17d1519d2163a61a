//! The program `paig`. See `paig --help`.

fn main() -> std::process::ExitCode {
    paig_cli::main()
}
