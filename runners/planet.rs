//! Trains a small PlaNet, a latent model of frames, actions and rewards, for comparison in control. See `planet --help`.

fn main() -> std::process::ExitCode {
    paig::cli::whole::main(paig::baselines::training::WholeModel::Planet, "planet")
}
