"""The libraries of libtorch that a CPU build loads, as they are in the official wheels for Linux on x86-64.

`setup/fetch_libtorch.py` of the repository and `paig.libtorch` fetch these files. `libtorch_cpu` needs the two CUDA
libraries (runtime and CUPTI) in order to load, also where nothing computes on a GPU.
"""

TORCH_VERSION = "2.11.0"
TORCH = f"torch=={TORCH_VERSION}"
# The versions that `torch==2.11.0` pins through cuda-toolkit 13.0.2.
CUDA_RUNTIME = "nvidia-cuda-runtime==13.0.96"
CUPTI = "nvidia-cuda-cupti==13.0.85"

LIBRARIES = {
    TORCH: ("torch/lib/libtorch_cpu.so", "torch/lib/libc10.so", "torch/lib/libgomp.so.1"),
    CUDA_RUNTIME: ("nvidia/cu13/lib/libcudart.so.13",),
    CUPTI: ("nvidia/cu13/lib/libcupti.so.13",),
}

# A wheel that differs in one byte is refused, also where its own checksums agree.
SHA256 = {
    "torch/lib/libtorch_cpu.so": "2e1034d418c1c881c86f67fc357b8723efc3f22bdb266f06aace8e6ca9c170b3",
    "torch/lib/libc10.so": "be5e17cd7752a6af003978706379384c3108f6b68916bb1949e610f6397bb640",
    "torch/lib/libgomp.so.1": "e28fb2896a3d612b46a27d7f8ef840d34c9efbc29b70a044c42095fb94856890",
    "nvidia/cu13/lib/libcudart.so.13": "96c42e418cec19054186b9429c321603cc190bf26a18104e19408117a2a817b0",
    "nvidia/cu13/lib/libcupti.so.13": "e2f9ed861fe27c492b8bb52b5e3220ef5120f3edcda36312e96b7fd8a186be3e",
}

# The libraries are the same in the wheels of every Python: this one is taken whatever Python runs.
PYTHON_TAG = "cp312"
PLATFORMS = (
    "manylinux_2_28_x86_64",
    "manylinux_2_17_x86_64",
    "manylinux2014_x86_64",
    "manylinux_2_25_x86_64",
    "manylinux_2_27_x86_64",
)
