// Sums whose parts are computed by threads or blocks that do not see each other, always in the same order.

#pragma once

#include "device.h"

// into [count] = the sum of `shares` such arrays.
extern "C" bool paig_gpu_add_shares(const float *from, float *into, int shares, long count, void *stream);

namespace {

// Adds up a number of each of THREADS threads, a power of two; the first has the sum. Takes a number of shared memory for each,
// which nobody may use until all threads have gone on to another barrier.
template <int THREADS>
__device__ __forceinline__ float block_sum(float number) {
  float *sums = paig_shared();
  sums[threadIdx.x] = number;
  for (int half = THREADS / 2; half > 0; half /= 2) {
    __syncthreads();
    if (static_cast<int>(threadIdx.x) < half) sums[threadIdx.x] += sums[threadIdx.x + half];
  }
  return sums[threadIdx.x];
}

}  // namespace
