//! Two coloured balls joined by a spring.

fn main() -> std::process::ExitCode {
    paig::run::one_task("spring_color")
}
