// Arrays that are added up: see shares.h.

#include "shares.h"

namespace {

// Numbers that a block adds up, and among how many threads the shares of one are divided.
constexpr int COLUMNS = 32, DIVISION = 16;

__global__ void add_shares(const float *from, float *into, int shares, long count) {
  float *sums = paig_shared();
  long place = static_cast<long>(blockIdx.x) * COLUMNS + threadIdx.x;
  float sum = 0;
  if (place < count)
#pragma unroll 4
    for (int share = threadIdx.y; share < shares; share += DIVISION) sum += from[share * count + place];
  sums[threadIdx.y * COLUMNS + threadIdx.x] = sum;
  __syncthreads();
  if (threadIdx.y > 0 || place >= count) return;
  for (int part = 1; part < DIVISION; part++) sum += sums[part * COLUMNS + threadIdx.x];
  into[place] = sum;
}

}  // namespace

extern "C" bool paig_gpu_add_shares(const float *from, float *into, int shares, long count, void *stream) {
  dim3 grid(paig_parts(count, COLUMNS));
  size_t shared = COLUMNS * DIVISION * sizeof(float);
  return paig_launch(add_shares, grid, dim3(COLUMNS, DIVISION), shared, stream, from, into, shares, count);
}
