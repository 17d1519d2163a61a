//! Makes every binary and test of this package find libtorch at run time, with no environment variable.
//!
//! Cargo hands a library's location only to direct dependents (hence `torch-sys` in Cargo.toml) and its link
//! arguments to nobody, so they are set here, once for all targets.

use std::process::Command;

/// What a result depends on.
const SOURCES: [&str; 5] = ["src", "runners", "configs", "data/assets", "Cargo.lock"];
/// Changes with every commit.
const GIT_LOG: &str = ".git/logs/HEAD";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-env=PAIG_COMMIT={}", commit());
    if std::env::var_os("CARGO_FEATURE_DOC_ONLY").is_some() {
        println!("cargo:rustc-env=PAIG_LIBTORCH_VERSION=none");
        return;
    }
    let library = std::env::var("DEP_TCH_LIBTORCH_LIB")
        .expect("torch-sys did not say where libtorch is; run `make libtorch`, or set LIBTORCH");
    println!("cargo:rustc-link-arg=-Wl,-rpath,{library}");
    compile_autograd(&library);
    let version = std::fs::read_to_string(format!("{library}/../build-version")).unwrap_or_else(|_| "2.11".into());
    println!("cargo:rustc-env=PAIG_LIBTORCH_VERSION={}", version.trim());
    // Nothing names a symbol of libtorch_cuda, so a linker that drops unused libraries would drop the GPU with it:
    // keep libtorch.so, which brings in whatever the installed libtorch has.
    println!("cargo:rustc-link-arg=-Wl,--no-as-needed");
    println!("cargo:rustc-link-arg=-L{library}");
    println!("cargo:rustc-link-arg=-ltorch");
    println!("cargo:rustc-link-arg=-Wl,--as-needed");
}

/// Compiles the node that the kernels put into libtorch's autograd graph, with the flags that torch-sys compiles with.
///
/// This script runs whenever a source changes, and libtorch's headers take long: what is there already is used again.
fn compile_autograd(library: &str) {
    const SOURCE: &str = "src/kernels/autograd.cpp";
    println!("cargo:rerun-if-changed={SOURCE}");
    println!("cargo:rerun-if-env-changed=LIBTORCH_INCLUDE");
    println!("cargo:rerun-if-env-changed=LIBTORCH_CXX11_ABI");
    let root = std::env::var("LIBTORCH_INCLUDE").unwrap_or_else(|_| format!("{library}/.."));
    let abi = std::env::var("LIBTORCH_CXX11_ABI").unwrap_or_else(|_| "1".into());
    let source = std::fs::read_to_string(SOURCE).expect("the package holds its sources");
    let version = std::fs::read_to_string(format!("{root}/build-version")).unwrap_or_default();
    let made_of = format!("{root}\n{version}\n{abi}\n{source}");
    let out = std::env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    let stamp = format!("{out}/autograd.stamp");
    if std::fs::read_to_string(&stamp).is_ok_and(|stamp| stamp == made_of) {
        println!("cargo:rustc-link-search=native={out}");
        println!("cargo:rustc-link-lib=static=paig_autograd");
        println!("cargo:rustc-link-lib=stdc++");
        return;
    }
    cc::Build::new()
        .cpp(true)
        .std("c++17")
        .warnings(false)
        .includes([format!("{root}/include"), format!("{root}/include/torch/csrc/api/include")])
        .define("_GLIBCXX_USE_CXX11_ABI", abi.as_str())
        .define("GLOG_USE_GLOG_EXPORT", None)
        .file(SOURCE)
        .compile("paig_autograd");
    std::fs::write(stamp, made_of).expect("OUT_DIR can be written");
}

/// The commit that is built, with a `+` where the sources differ from it; `unknown` outside a repository.
fn commit() -> String {
    for path in SOURCES.into_iter().chain([GIT_LOG]).filter(|path| std::path::Path::new(path).exists()) {
        println!("cargo:rerun-if-changed={path}");
    }
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_string())
    };
    let Some(commit) = git(&["rev-parse", "--short=10", "HEAD"]) else { return "unknown".into() };
    let clean = git(&[&["status", "--porcelain", "--"], &SOURCES[..]].concat());
    if clean.is_some_and(|changes| changes.is_empty()) { commit } else { commit + "+" }
}
