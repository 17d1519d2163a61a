//! Trains a small PlaNet, a latent model of frames, actions and rewards, for comparison in control. See `planet --help`.

fn main() -> std::process::ExitCode {
    paig::cli::whole::main(paig::baselines::whole_models::config::WholeModel::Planet, "planet")
}
