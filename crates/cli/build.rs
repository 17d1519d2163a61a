fn main() {
    paig_link::program();
}
