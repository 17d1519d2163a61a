fn main() {
    paig_link::libtorch();
}
