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
    let version = std::fs::read_to_string(format!("{library}/../build-version")).unwrap_or_else(|_| "2.11".into());
    println!("cargo:rustc-env=PAIG_LIBTORCH_VERSION={}", version.trim());
    // Nothing names a symbol of libtorch_cuda, so a linker that drops unused libraries would drop the GPU with it:
    // keep libtorch.so, which brings in whatever the installed libtorch has.
    println!("cargo:rustc-link-arg=-Wl,--no-as-needed");
    println!("cargo:rustc-link-arg=-L{library}");
    println!("cargo:rustc-link-arg=-ltorch");
    println!("cargo:rustc-link-arg=-Wl,--as-needed");
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
