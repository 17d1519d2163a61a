fn main() {
    paig_link::program();
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux") {
        before_libraries();
    }
}

/// Links what the program tries before the constructors of its libraries.
fn before_libraries() {
    let source = "src/before_libraries.c";
    println!("cargo:rerun-if-changed={source}");
    for object in cc::Build::new().file(source).compile_intermediates() {
        println!("cargo:rustc-link-arg-bins={}", object.display());
    }
}
