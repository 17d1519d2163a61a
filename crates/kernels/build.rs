//! Compiles the C++ bridge to libtorch and the GPU kernels.

use std::path::Path;
use std::process::Command;

/// In `src/gpu`.
const GPU_KERNELS: [&str; 17] = [
    "adjoint.cu",
    "convolution.cu",
    "convolution.h",
    "device.cpp",
    "device.h",
    "launch.cu",
    "logits.cu",
    "masks.cu",
    "optimizer.cu",
    "packs.h",
    "pictures.h",
    "roll_out.cu",
    "shares.cu",
    "shares.h",
    "sprites.cu",
    "squared_error.cu",
    "weight_gradient.cu",
];

/// The GPUs that kernels are compiled for, and for later ones a text that the driver compiles.
const GPUS: [&str; 4] = [
    "arch=compute_80,code=sm_80",
    "arch=compute_89,code=sm_89",
    "arch=compute_90,code=sm_90",
    "arch=compute_90,code=compute_90",
];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if std::env::var_os("CARGO_FEATURE_DOC_ONLY").is_some() {
        println!("cargo:rustc-env=PAIG_LIBTORCH_VERSION=none");
        return;
    }
    let library = paig_link::libtorch();
    let cuda = cuda_headers(&library);
    compile_bridge(&library, cuda.as_deref());
    compile_gpu_kernels(&library, cuda.as_deref());
    println!("cargo:rustc-env=PAIG_LIBTORCH_VERSION={}", version(&library));
}

/// That of libtorch, by its headers.
fn version(library: &str) -> String {
    let root = std::env::var("LIBTORCH_INCLUDE").unwrap_or_else(|_| format!("{library}/.."));
    let file = format!("{root}/include/torch/headeronly/version.h");
    println!("cargo:rerun-if-changed={file}");
    let text = std::fs::read_to_string(&file).unwrap_or_default();
    let part = |name: &str| text.lines().find_map(|line| line.strip_prefix(&format!("#define TORCH_VERSION_{name} ")));
    let parts: Option<Vec<_>> = ["MAJOR", "MINOR", "PATCH"].into_iter().map(part).collect();
    parts.map_or_else(|| "unknown".into(), |parts| parts.join("."))
}

/// The headers of CUDA, where libtorch has it: beside its wheel, or in an installed toolkit. Without them the program still
/// computes on a GPU, but step by step.
fn cuda_headers(library: &str) -> Option<String> {
    println!("cargo:rerun-if-env-changed=CUDA_HOME");
    let of_gpu = format!("{library}/libtorch_cuda.so");
    println!("cargo:rerun-if-changed={library}");
    if !Path::new(&of_gpu).exists() {
        return None;
    }
    let toolkit = std::env::var("CUDA_HOME").unwrap_or_else(|_| "/usr/local/cuda".into());
    let places = [format!("{library}/../../nvidia/cu13/include"), format!("{toolkit}/include")];
    let found = places.into_iter().find(|place| {
        ["cuda_runtime_api.h", "crt/host_config.h"].iter().all(|header| Path::new(place).join(header).exists())
    });
    if found.is_none() {
        println!("cargo:warning=no headers of CUDA found (set CUDA_HOME): steps on a GPU will not be recorded");
    }
    found
}

/// Compiles the calls of libtorch that tch has not, with the flags that torch-sys compiles with.
///
/// This script runs whenever a source changes, and libtorch's headers take long: what is there already is used again.
fn compile_bridge(library: &str, cuda: Option<&str>) {
    const SOURCES: [&str; 3] = ["src/autograd.cpp", "src/capability.cpp", "src/cuda.cpp"];
    SOURCES.iter().for_each(|source| println!("cargo:rerun-if-changed={source}"));
    println!("cargo:rerun-if-env-changed=LIBTORCH_INCLUDE");
    println!("cargo:rerun-if-env-changed=LIBTORCH_CXX11_ABI");
    let root = std::env::var("LIBTORCH_INCLUDE").unwrap_or_else(|_| format!("{library}/.."));
    let abi = std::env::var("LIBTORCH_CXX11_ABI").unwrap_or_else(|_| "1".into());
    let sources =
        SOURCES.map(|source| std::fs::read_to_string(source).expect("the package holds its sources")).concat();
    let version = version(library);
    let made_of = format!("{root}\n{version}\n{abi}\n{cuda:?}\n{sources}");
    let out = std::env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    let stamp = format!("{out}/bridge.stamp");
    if std::fs::read_to_string(&stamp).is_ok_and(|stamp| stamp == made_of) {
        println!("cargo:rustc-link-search=native={out}");
        println!("cargo:rustc-link-lib=static=paig_bridge");
        println!("cargo:rustc-link-lib={}", paig_link::cpp_library());
    } else {
        let mut build = cc::Build::new();
        build
            .cpp(true)
            .std("c++17")
            .warnings(false)
            .includes([format!("{root}/include"), format!("{root}/include/torch/csrc/api/include")])
            .define("_GLIBCXX_USE_CXX11_ABI", abi.as_str())
            .define("GLOG_USE_GLOG_EXPORT", None)
            .files(SOURCES);
        if let Some(headers) = cuda {
            build.define("PAIG_CUDA", None).include(headers);
        }
        build.compile("paig_bridge");
        std::fs::write(stamp, made_of).expect("OUT_DIR can be written");
    }
    if cuda.is_some() {
        println!("cargo:rustc-link-search=native={library}");
        println!("cargo:rustc-link-lib=torch_cuda");
        println!("cargo:rustc-link-lib=c10_cuda");
    }
}

/// CUDA's compiler, and where the runtime that goes with it is.
struct Toolkit {
    compiler: String,
    version: String,
    libraries: String,
}

impl Toolkit {
    /// Beside libtorch's wheel, where `CUDA_HOME` says, or installed.
    fn find(libtorch: &str) -> Option<Self> {
        let beside = format!("{libtorch}/../../nvidia/cu13");
        if Path::new(&beside).exists() {
            println!("cargo:rerun-if-changed={beside}");
        }
        let home = std::env::var("CUDA_HOME").ok();
        let roots = [beside].into_iter().chain(home).chain(["/usr/local/cuda", "/usr"].map(String::from));
        let found = roots.into_iter().find_map(|root| Self::at(&root));
        if found.is_none() {
            println!(
                "cargo:warning=CUDA's compiler (nvcc) was not found (set CUDA_HOME): libtorch computes on the GPU"
            );
        }
        found
    }

    fn at(root: &str) -> Option<Self> {
        let compiler = format!("{root}/bin/nvcc");
        let said = Command::new(&compiler).arg("--version").output().ok().filter(|said| said.status.success())?;
        let folders = ["lib", "lib64", "targets/x86_64-linux/lib", "lib/x86_64-linux-gnu"];
        let mut folders = folders.into_iter().map(|folder| format!("{root}/{folder}"));
        let libraries = folders.find(|folder| Path::new(folder).join("libcudart_static.a").exists())?;
        Some(Toolkit { compiler, version: String::from_utf8_lossy(&said.stdout).into(), libraries })
    }

    /// Where the kernels of a file are, compiled; none where the compiler cannot.
    fn compiled(&self, kernel: &str, out: &str) -> Option<String> {
        let object = format!("{out}/{}.o", kernel.replace('/', "-"));
        let gpus = GPUS.iter().flat_map(|gpu| ["-gencode", gpu]);
        let arguments = ["-O3", "-std=c++17", "-Xcompiler", "-fPIC", "-c", kernel, "-o", &object];
        let done = Command::new(&self.compiler).args(arguments.into_iter().chain(gpus)).status();
        if done.is_ok_and(|status| status.success()) {
            return Some(object);
        }
        println!("cargo:warning={} failed on {kernel}: libtorch computes on the GPU", self.compiler);
        None
    }
}

/// Compiles the kernels for GPUs: by CUDA's compiler where it is at hand, otherwise for the processor, which tests them there.
fn compile_gpu_kernels(library: &str, cuda: Option<&str>) {
    const FOLDER: &str = "src/gpu";
    const DEVICE: &str = "src/gpu/device.cpp";
    const FOR_GPUS: &str = "for GPUs";
    const FOR_THE_PROCESSOR: &str = "for the processor";
    println!("cargo:rerun-if-changed={FOLDER}");
    let files = GPU_KERNELS.map(|name| format!("{FOLDER}/{name}"));
    let kernels: Vec<_> = files.iter().filter(|file| file.ends_with(".cu")).collect();
    let toolkit = cuda.and_then(|_| Toolkit::find(library));
    let sources: Vec<_> = files.iter().map(|file| std::fs::read_to_string(file).expect("sources are text")).collect();
    let by = toolkit.as_ref().map(|Toolkit { compiler, version, libraries }| [compiler, version, libraries]);
    let made_of = format!("{by:?}\n{GPUS:?}\n{}", sources.concat());
    let out = std::env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    let stamp = format!("{out}/gpu_kernels.stamp");
    let made = std::fs::read_to_string(&stamp).ok();
    // A compiler that failed is tried again: what it lacked may be there by now.
    let best = if toolkit.is_some() { FOR_GPUS } else { FOR_THE_PROCESSOR };
    let made = made.and_then(|made| made.strip_prefix(&made_of).map(str::to_string)).filter(|made| made == best);
    let result = if let Some(result) = made {
        println!("cargo:rustc-link-search=native={out}");
        println!("cargo:rustc-link-lib=static=paig_gpu_kernels");
        println!("cargo:rustc-link-lib={}", paig_link::cpp_library());
        result
    } else {
        let mut build = cc::Build::new();
        let objects = |toolkit: &Toolkit| -> Option<Vec<String>> {
            kernels.iter().map(|kernel| toolkit.compiled(kernel, &out)).collect()
        };
        let result = match toolkit.as_ref().and_then(objects) {
            Some(objects) => {
                build.objects(objects);
                FOR_GPUS
            }
            None => {
                build.cpp(true).std("c++17").warnings(false).flag("-xc++").files(&kernels).file(DEVICE);
                FOR_THE_PROCESSOR
            }
        };
        build.compile("paig_gpu_kernels");
        std::fs::write(stamp, made_of + result).expect("OUT_DIR can be written");
        result.to_string()
    };
    if let Some(toolkit) = toolkit.filter(|_| result == FOR_GPUS) {
        println!("cargo:rustc-link-search=native={}", toolkit.libraries);
        println!("cargo:rustc-link-lib=static=cudart_static");
    }
}
