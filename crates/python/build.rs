fn main() {
    paig_link::module();
}
