// The sum of squared differences, and its gradient.

#include "packs.h"
#include "shares.h"

// Two arrays [rows, width], the numbers of a row side by side, and the floats from the start of a row to the next.
struct PaigCompared {
  const float *a, *b;
  int rows, width;
  int64_t stride_a, stride_b;
};

namespace {

constexpr int THREADS = 256;
// Four for each processor of a large GPU.
constexpr int MOST_BLOCKS = 528;

// Differences of numbers side by side.
template <int SIZE>
__device__ Pack<SIZE> difference(const PaigCompared &compared, int pack) {
  int packs = compared.width / SIZE, row = pack / packs, column = pack % packs * SIZE;
  Pack<SIZE> a = *reinterpret_cast<const Pack<SIZE> *>(compared.a + row * compared.stride_a + column);
  Pack<SIZE> b = *reinterpret_cast<const Pack<SIZE> *>(compared.b + row * compared.stride_b + column);
  for (int i = 0; i < SIZE; i++) a.at[i] -= b.at[i];
  return a;
}

// The share of each block.
template <int SIZE>
__global__ void __launch_bounds__(THREADS) add_squares(PaigCompared compared, int packs, float *__restrict__ shares) {
  float sum = 0.0f;
  for (int pack = blockIdx.x * THREADS + threadIdx.x; pack < packs; pack += gridDim.x * THREADS) {
    Pack<SIZE> seen = difference<SIZE>(compared, pack);
    for (int i = 0; i < SIZE; i++) sum += seen.at[i] * seen.at[i];
  }
  sum = block_sum<THREADS>(sum);
  if (threadIdx.x == 0) shares[blockIdx.x] = sum;
}

template <int SIZE>
__global__ void __launch_bounds__(THREADS)
    scale_differences(PaigCompared compared, int packs, const float *gradient, float *__restrict__ by_a) {
  float factor = 2.0f * *gradient;
  for (int pack = blockIdx.x * THREADS + threadIdx.x; pack < packs; pack += gridDim.x * THREADS) {
    Pack<SIZE> scaled = difference<SIZE>(compared, pack);
    for (int i = 0; i < SIZE; i++) scaled.at[i] *= factor;
    *reinterpret_cast<Pack<SIZE> *>(by_a + static_cast<size_t>(pack) * SIZE) = scaled;
  }
}

// Numbers that can be taken at once.
int pack_size(const PaigCompared &compared) {
  bool in_fours = (compared.width | compared.stride_a | compared.stride_b) % 4 == 0;
  return in_fours && begin_with_packs(compared.a, compared.b) ? 4 : 1;
}

int blocks_of(int packs) {
  return min(paig_parts(packs, THREADS), MOST_BLOCKS);
}

}  // namespace

extern "C" {

// Floats of the workspace that the sum needs.
size_t paig_gpu_squared_error_workspace() { return MOST_BLOCKS; }

// sum (a - b)^2 to `total`.
bool paig_gpu_squared_error(PaigCompared compared, float *workspace, float *total, void *stream) {
  int size = pack_size(compared), packs = compared.rows * (compared.width / size), blocks = blocks_of(packs);
  constexpr size_t shared = THREADS * sizeof(float);
  auto kernel = size == 4 ? add_squares<4> : add_squares<1>;
  return (blocks == 0 || paig_launch(kernel, blocks, THREADS, shared, stream, compared, packs, workspace)) &&
         paig_gpu_add_shares(workspace, total, blocks, 1, stream);
}

// Its gradient by a, [rows, width] from the beginning of an allocation, from that of the sum.
bool paig_gpu_squared_error_backward(PaigCompared compared, const float *gradient, float *by_a, void *stream) {
  int size = pack_size(compared), packs = compared.rows * (compared.width / size), blocks = blocks_of(packs);
  if (blocks == 0) return true;
  auto kernel = size == 4 ? scale_differences<4> : scale_differences<1>;
  return paig_launch(kernel, blocks, THREADS, 0, stream, compared, packs, gradient, by_a);
}

}
