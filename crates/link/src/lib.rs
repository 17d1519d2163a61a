//! For build scripts: lets the programs and tests of a package find libtorch at run time, with no environment variable, and
//! states the commit of a program.
//!
//! Cargo hands libtorch's location only to direct dependents of `torch-sys`, and link arguments to nobody, so the build
//! script of each package with programs or tests calls [`libtorch`].

use std::path::Path;
use std::process::Command;

/// The project's folder, from a package with programs.
const ROOTS: [&str; 2] = ["..", "../.."];

/// What programs do before their libraries are initialized.
const BEFORE_LIBRARIES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/src/before_libraries.c");

/// In the project's folder: what a result depends on.
const SOURCES: [&str; 7] = ["src", "crates", "runners", "configs", "data/assets", "Cargo.toml", "Cargo.lock"];

/// Sets the search path and the link arguments of the package's programs and tests. Returns the folder of libtorch's
/// libraries.
///
/// # Panics
/// If `torch-sys` is no direct dependency of the package.
pub fn libtorch() -> String {
    println!("cargo:rerun-if-changed=build.rs");
    let library = std::env::var("DEP_TCH_LIBTORCH_LIB")
        .expect("no libtorch: run `make libtorch` or set LIBTORCH; the package must depend on torch-sys directly");
    println!("cargo:rustc-link-arg=-Wl,-rpath,{library}");
    if is_macos() {
        // Its linker drops no library.
        return library;
    }
    // Nothing names a symbol of libtorch_cuda, so a linker that drops unused libraries would drop the GPU with it:
    // libtorch.so brings in whatever the installed libtorch has.
    println!("cargo:rustc-link-arg=-Wl,--no-as-needed");
    println!("cargo:rustc-link-arg=-L{library}");
    println!("cargo:rustc-link-arg=-ltorch");
    println!("cargo:rustc-link-arg=-Wl,--as-needed");
    library
}

/// The same for a package of programs, which also find the commit they were built from in `PAIG_COMMIT`, and complete their
/// environment when they start.
///
/// # Panics
/// As [`libtorch`]; without a C compiler.
pub fn program() {
    libtorch();
    println!("cargo:rustc-env=PAIG_COMMIT={}", commit());
    if is_on("linux") {
        println!("cargo:rerun-if-changed={BEFORE_LIBRARIES}");
        for object in cc::Build::new().file(BEFORE_LIBRARIES).compile_intermediates() {
            println!("cargo:rustc-link-arg-bins={}", object.display());
        }
    }
}

/// Only the commit, for a module that is loaded into a process which has loaded libtorch: on Linux it needs no search path.
pub fn module() {
    println!("cargo:rerun-if-changed=build.rs");
    if is_macos() {
        // Of the environment's torch, beside the package of the module.
        println!("cargo:rustc-link-arg=-Wl,-rpath,@loader_path/../torch/lib");
    }
    println!("cargo:rustc-env=PAIG_COMMIT={}", commit());
}

fn is_macos() -> bool {
    is_on("macos")
}

fn is_on(system: &str) -> bool {
    std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|target| target == system)
}

/// The C++ standard library that C++ sources are linked with.
pub fn cpp_library() -> &'static str {
    if is_macos() { "c++" } else { "stdc++" }
}

/// The commit of the sources, with a `+` where the sources differ from it; `unknown` outside a repository.
fn commit() -> String {
    let Some(root) = ROOTS.into_iter().map(Path::new).find(|root| root.join("Cargo.lock").exists()) else {
        return "unknown".into();
    };
    let rerun_if_changed = |path: &str| {
        let path = root.join(path);
        if path.exists() {
            println!("cargo:rerun-if-changed={}", path.display());
        }
    };
    SOURCES.into_iter().for_each(rerun_if_changed);
    // The sources of a release may lie within a repository of something else.
    if !root.join(".git").exists() {
        return "unknown".into();
    }
    let git = |arguments: &[&str]| {
        let output = Command::new("git").current_dir(root).args(arguments).output().ok()?;
        let output = Some(output).filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_string())
    };
    // Changes with every commit; of a worktree it lies elsewhere.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        rerun_if_changed(&log);
    }
    let Some(commit) = git(&["rev-parse", "--short=10", "HEAD"]) else { return "unknown".into() };
    let clean = git(&[&["status", "--porcelain", "--"], &SOURCES[..]].concat());
    if clean.is_some_and(|changes| changes.is_empty()) { commit } else { commit + "+" }
}
