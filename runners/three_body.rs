//! Three coloured balls that attract each other.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("3bp_color")
}
