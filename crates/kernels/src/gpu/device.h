// What the kernels of this folder are written in: CUDA. Where a program is built without its compiler, the same text is
// compiled for the processor, one thread of a block after the other, so that the kernels can be tested without a GPU.
//
// A kernel uses nothing but indices, shared memory and barriers: no warps.

#pragma once

#include <cstddef>
#include <initializer_list>

// How many parts of at most `of` so many make.
inline int paig_parts(long count, long of) { return static_cast<int>((count + of - 1) / of); }

// Why the last launch of this thread failed; null after one that did not.
extern "C" const char *paig_gpu_launch_failure();

#ifdef __CUDACC__

#include <cuda_runtime.h>

// Shared memory that a kernel may always have; more has to be asked for.
constexpr size_t PAIG_GRANTED_SHARED = 48 << 10;

// Shared memory that a block may have at most on a device.
inline size_t paig_most_shared(int device) {
  int most = 0;
  cudaDeviceGetAttribute(&most, cudaDevAttrMaxSharedMemoryPerBlockOptin, device);
  return static_cast<size_t>(most);
}

// The device that is set.
inline int paig_device() {
  int device = 0;
  cudaGetDevice(&device);
  return device;
}

// Launches `kernel` on a stream; true if that was accepted.
template <typename Kernel, typename... Arguments>
bool paig_launch(Kernel kernel, dim3 grid, dim3 block, size_t shared, void *stream, Arguments... arguments) {
  // A kernel's limit is one for all threads of the program: always the same, so that none lowers it for another.
  if (shared > PAIG_GRANTED_SHARED)
    cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(paig_most_shared(paig_device())));
  kernel<<<grid, block, shared, static_cast<cudaStream_t>(stream)>>>(arguments...);
  return cudaPeekAtLastError() == cudaSuccess;
}

// The shared memory of a launch.
__device__ inline float *paig_shared() {
  extern __shared__ __align__(16) float paig_shared_memory[];
  return paig_shared_memory;
}

// Begins to copy 4 or 16 bytes into shared memory; they are there after `paig_copies_arrive` and a barrier.
template <typename Numbers>
__device__ __forceinline__ void paig_begin_copy(Numbers *into, const Numbers *from) {
  unsigned place = static_cast<unsigned>(__cvta_generic_to_shared(into));
  if (sizeof(Numbers) == 16)
    asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(place), "l"(from));
  else
    asm volatile("cp.async.ca.shared.global [%0], [%1], 4;" ::"r"(place), "l"(from));
}

__device__ __forceinline__ void paig_copies_arrive() { asm volatile("cp.async.wait_all;" ::: "memory"); }

#else

#include <algorithm>
#include <cmath>
#include <functional>

#define __global__
#define __host__
#define __device__
#define __forceinline__ inline
#define __restrict__
#define __launch_bounds__(...)

struct dim3 {
  unsigned x = 1, y = 1, z = 1;
  dim3(unsigned x = 1, unsigned y = 1, unsigned z = 1) : x(x), y(y), z(z) {}
};

struct alignas(16) float4 {
  float x, y, z, w;
};

using std::max;
using std::min;

inline float4 make_float4(float x, float y, float z, float w) { return {x, y, z, w}; }

extern thread_local dim3 threadIdx, blockIdx, blockDim, gridDim;

// Waits for all threads of the block.
void __syncthreads();

// Calls `thread` for each thread of each block.
bool paig_run_blocks(dim3 grid, dim3 block, size_t shared, const std::function<void()> &thread);

float *paig_shared();

// That of the smallest GPUs that are served.
inline size_t paig_most_shared(int) { return 99 << 10; }

inline int paig_device() { return 0; }

template <typename Numbers>
void paig_begin_copy(Numbers *into, const Numbers *from) {
  *into = *from;
}

inline void paig_copies_arrive() {}

template <typename Kernel, typename... Arguments>
bool paig_launch(Kernel kernel, dim3 grid, dim3 block, size_t shared, void *, Arguments... arguments) {
  return paig_run_blocks(grid, block, shared, [=] { kernel(arguments...); });
}

#endif
