//! Trains VideoLSTM, a convolutional LSTM on frames, for comparison. See `video_lstm --help`.

fn main() -> std::process::ExitCode {
    paig::cli::whole::main(paig::baselines::whole_models::config::WholeModel::VideoLstm, "video_lstm")
}
