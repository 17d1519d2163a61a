//! Trains DDPAE, a decompositional predictive auto-encoder, for comparison. See `ddpae --help`.

fn main() -> std::process::ExitCode {
    paig::cli::whole::main(paig::baselines::whole_models::config::WholeModel::Ddpae, "ddpae")
}
