// Gradients of what stands between the convolutions of a U-Net: the pooling, the doubling, and the logits of its end.

#include "device.h"
#include "pictures.h"

namespace {

constexpr int THREADS = 256;

struct Pictures {
  int side;
  long count;
};

// A thread for each pixel of `it.count` pictures.
__device__ long pixel(const Pictures &it) {
  long place = static_cast<long>(blockIdx.x) * blockDim.x + threadIdx.x;
  return place < it.count * it.side * it.side ? place : -1;
}

// Adds to `gradient`, of what was pooled, that of the pooled pictures: it goes to the first of the largest pixels. Then sets it to
// 0 where `seen`, which was pooled, is not above 0.
__global__ void pool_backward(Pictures it, const float *pooled_gradient, const float *seen, float *gradient) {
  // Of the pooled pictures.
  long place = pixel(it);
  if (place < 0) return;
  int side = it.side;
  long picture = place / (side * side);
  int y = place / side % side, x = place % side;
  long corner = (picture * 2 * side + 2 * y) * 2 * side + 2 * x;
  long places[4] = {corner, corner + 1, corner + 2 * side, corner + 2 * side + 1};
  int chosen = 0;
  float largest = seen[corner];
  for (int i = 1; i < 4; i++) {
    float value = seen[places[i]];
    if (value > largest || value != value) {
      largest = value;
      chosen = i;
    }
  }
  for (int i = 0; i < 4; i++) {
    float sum = gradient[places[i]] + (i == chosen ? pooled_gradient[place] : 0);
    gradient[places[i]] = seen[places[i]] <= 0 ? 0 : sum;
  }
}

// How much of a doubled row's gradient goes to `row` of `half` rows: that of 2 row - 1, 2 row and 2 row + 1.
__device__ __forceinline__ float share(int row, int step, int half) {
  if (step == 0) return 1;
  if (step < 0) return row > 0 ? 0.5f : 0;
  return row + 1 < half ? 0.5f : 1;
}

// From the gradient of doubled pictures that of the pictures, 0 where `seen` is not above 0.
__global__ void double_backward(Pictures it, const float *doubled_gradient, const float *seen, float *gradient) {
  long place = pixel(it);
  if (place < 0) return;
  int half = it.side, side = 2 * half;
  const float *from = doubled_gradient + place / (half * half) * side * side;
  int y = place / half % half, x = place % half;
  float sum = 0;
  for (int dy = -1; dy <= 1; dy++) {
    float by_row = share(y, dy, half);
    if (by_row == 0) continue;
    for (int dx = -1; dx <= 1; dx++) {
      float by = by_row * share(x, dx, half);
      if (by != 0) sum += by * from[(2 * y + dy) * side + 2 * x + dx];
    }
  }
  gradient[place] = seen[place] <= 0 ? 0 : sum;
}

dim3 blocks(const Pictures &it) { return dim3(paig_parts(it.count * it.side * it.side, THREADS)); }

}  // namespace

// See pool_backward; `side` is that of the pooled pictures.
extern "C" bool paig_gpu_pool_backward(const float *pooled_gradient, const float *seen, float *gradient, long pictures, int side,
                                       void *stream) {
  Pictures it = {side, pictures};
  return paig_launch(pool_backward, blocks(it), dim3(THREADS), 0, stream, it, pooled_gradient, seen, gradient);
}

// See double_backward; `side` is that of the pictures before they were doubled.
extern "C" bool paig_gpu_double_backward(const float *doubled_gradient, const float *seen, float *gradient, long pictures,
                                         int side, void *stream) {
  Pictures it = {side, pictures};
  return paig_launch(double_backward, blocks(it), dim3(THREADS), 0, stream, it, doubled_gradient, seen, gradient);
}
