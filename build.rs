fn main() {
    // docs.rs has no libtorch.
    if std::env::var_os("CARGO_FEATURE_DOC_ONLY").is_none() {
        paig_link::libtorch();
    }
}
