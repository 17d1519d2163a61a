//! Two coloured balls joined by a spring.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("spring_color")
}
