//! The spring, seen in one half of the frame during input and prediction.

fn main() -> std::process::ExitCode {
    paig::cli::run::one_task("spring_color_half")
}
