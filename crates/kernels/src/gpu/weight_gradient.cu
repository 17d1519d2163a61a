// Gradients of the weights and biases of convolutions with 3 x 3 kernels.
//
// A block goes through its share of the bands of all frames. Its threads are INPUTS channels that are seen times GROUPS of OUTPUTS
// channels of the result times shares of a band's pixels, the slices; each has the gradients of nine weights for OUTPUTS channels
// in registers. The next band is on its way meanwhile. What the blocks have in the end is added by a second kernel, always in the same order.

#include "device.h"
#include "pictures.h"
#include "shares.h"

namespace {

constexpr int INPUTS = 8, OUTPUTS = 8, THREADS = 256;
constexpr int TAPS = 9;
// Quads of a band that a block has at a time, and numbers of it in shared memory, at most: it has two, and on the largest GPUs
// there is room for two blocks.
constexpr int QUADS = 128, ROOM = 14100;
// Blocks that fill a GPU.
constexpr int BLOCKS = 264;

struct WeightGradient {
  PaigInput input;
  // Of the result, [frames, outputs, side, side].
  const float *gradient;
  // Of each share those of the weights [outputs, inputs, 9], and after them those of the biases [outputs].
  float *shares;
  int outputs, frames;
  // Of OUTPUTS channels in a block.
  int groups;
  // Of what was seen, and of the result.
  Band band, result;
  Walk fill, fill_result, slices;
};

// Of all weights and biases.
__host__ __device__ inline long results(int inputs, int outputs) { return static_cast<long>(outputs) * (inputs * TAPS + 1); }

// grid: shares of the work, chunks of inputs, chunks of outputs; block: INPUTS x GROUPS x slices.
template <int GROUPS>
__global__ void __launch_bounds__(THREADS, 2) add_up(WeightGradient it) {
  constexpr int SLICES = THREADS / INPUTS / GROUPS, RESULTS = GROUPS * OUTPUTS;
  const Band &band = it.band, &of_result = it.result;
  int inputs = it.input.first_channels + it.input.second_channels;
  float *now = paig_shared(), *next = now + INPUTS * band.stride + RESULTS * of_result.stride;
  int input = threadIdx.x, group = threadIdx.y, slice = threadIdx.z;
  int thread = (slice * GROUPS + group) * INPUTS + input;
  int first_input = blockIdx.y * INPUTS, first_output = blockIdx.z * RESULTS;
  int channels = min(INPUTS, inputs - first_input);
  int outputs = min(RESULTS, it.outputs - first_output);
  PaigInput gradient = {it.gradient, nullptr, it.outputs, 0, PAIG_AS_THEY_ARE};
  int own_results = INPUTS * band.stride + group * OUTPUTS * of_result.stride;

  float sums[OUTPUTS][TAPS] = {};
  float bias = 0;
  for (float *tile : {now, next}) {
    clear_tile(band, tile, INPUTS, thread, THREADS);
    clear_tile(of_result, tile + INPUTS * band.stride, RESULTS, thread, THREADS);
  }
  int bands = band.count(), all = (it.frames + band.frames - 1) / band.frames * bands;
  auto fetch = [&](float *tile, int place) {
    int frame = place / bands * band.frames, row = place % bands * band.rows;
    fill_tile(it.input, band, it.fill, tile, first_input, channels, frame, it.frames, row, thread);
    tile += INPUTS * band.stride;
    fill_tile(gradient, of_result, it.fill_result, tile, first_output, outputs, frame, it.frames, row, thread);
  };
  __syncthreads();
  if (static_cast<int>(blockIdx.x) < all) fetch(now, blockIdx.x);
  for (int place = blockIdx.x; place < all; place += gridDim.x) {
    paig_copies_arrive();
    __syncthreads();
    if (place + static_cast<int>(gridDim.x) < all) fetch(next, place + gridDim.x);
    for (Place at(it.slices, slice); at.picture < band.frames; at.step(it.slices)) {
      const float *from = now + input * band.stride + band.place(at.picture, at.line, 4 * at.quad - 1);
      const float *of = now + own_results + of_result.place(at.picture, at.line, 4 * at.quad);
      float pixels[3][6];
#pragma unroll
      for (int line = 0; line < 3; line++) six(from + line * band.pitch, pixels[line]);
#pragma unroll
      for (int output = 0; output < OUTPUTS; output++) {
        float4 four = *reinterpret_cast<const float4 *>(of + output * of_result.stride);
#pragma unroll
        for (int tap = 0; tap < TAPS; tap++) {
          const float *by = &pixels[tap / 3][tap % 3];
          sums[output][tap] += by[0] * four.x + by[1] * four.y + by[2] * four.z + by[3] * four.w;
        }
      }
      // The biases of OUTPUTS channels are shared out among INPUTS threads.
      float4 own = *reinterpret_cast<const float4 *>(of + input * of_result.stride);
      bias += own.x + own.y + own.z + own.w;
    }
    float *done = now;
    now = next;
    next = done;
  }

  // The slices of a block are added tap by tap; after the taps, the biases.
  float *share = it.shares + blockIdx.x * results(inputs, it.outputs), *parts = paig_shared();
  for (int tap = 0; tap <= TAPS; tap++) {
    __syncthreads();
#pragma unroll
    for (int output = 0; output < OUTPUTS; output++) {
      float value = bias;
#pragma unroll
      for (int k = 0; k < TAPS; k++) value = tap == k ? sums[output][k] : value;
      parts[((slice * GROUPS + group) * OUTPUTS + output) * INPUTS + input] = value;
    }
    __syncthreads();
    if (thread >= RESULTS * INPUTS) continue;
    int output = thread / INPUTS, of = thread % INPUTS;
    float sum = 0;
    for (int k = 0; k < SLICES; k++) sum += parts[k * RESULTS * INPUTS + thread];
    if (tap < TAPS && output < outputs && of < channels)
      share[(static_cast<long>(first_output + output) * inputs + first_input + of) * TAPS + tap] = sum;
    int biased = output / OUTPUTS * OUTPUTS + of;
    if (tap == TAPS && output % OUTPUTS == 0 && biased < outputs && blockIdx.y == 0)
      share[results(inputs, it.outputs) - it.outputs + first_output + biased] = sum;
  }
}

int numbers(const WeightGradient &it) { return INPUTS * it.band.stride + it.groups * OUTPUTS * it.result.stride; }

// How the work is divided: the most groups and quads for which there is room, or the fewest.
WeightGradient plan(PaigInput input, const float *gradient, int outputs, int frames, int side, int device) {
  WeightGradient it = {input, gradient, nullptr, outputs, frames, 0, {}, {}, {}, {}, {}};
  int most = paig_most_shared(device) / (2 * sizeof(float)), room = min(ROOM, most);
  bool fits = false;
  for (it.groups = outputs > 2 * OUTPUTS ? 4 : outputs > OUTPUTS ? 2 : 1; !fits; it.groups /= 2) {
    for (int quads = QUADS; quads > 0 && !fits; quads /= 2) {
      it.band = Band::of(side, quads, false);
      it.result = it.band.with_border(0);
      fits = numbers(it) <= room;
    }
    if (fits || it.groups == 1) break;
  }
  it.fill = Walk::through(it.band, THREADS);
  it.fill_result = Walk::through(it.result, THREADS);
  it.slices = Walk::of(it.band.quads, it.band.rows, THREADS / INPUTS / it.groups);
  return it;
}

int shares_of(const WeightGradient &it) {
  int inputs = it.input.first_channels + it.input.second_channels;
  int all = paig_parts(it.frames, it.band.frames) * it.band.count();
  int pairs = paig_parts(inputs, INPUTS) * paig_parts(it.outputs, OUTPUTS * it.groups);
  return max(1, min(all, BLOCKS / pairs));
}

template <int GROUPS>
bool launch(const WeightGradient &it, void *stream) {
  int inputs = it.input.first_channels + it.input.second_channels;
  dim3 grid(shares_of(it), paig_parts(inputs, INPUTS), paig_parts(it.outputs, OUTPUTS * GROUPS));
  dim3 block(INPUTS, GROUPS, THREADS / INPUTS / GROUPS);
  size_t shared = max(2 * numbers(it), THREADS * OUTPUTS) * sizeof(float);
  return paig_launch(add_up<GROUPS>, grid, block, shared, stream, it);
}

}  // namespace

// Whether a device has shared memory enough for pictures of this side.
extern "C" bool paig_gpu_weight_gradient_fits(int side, int device) {
  WeightGradient it = plan({nullptr, nullptr, INPUTS, 0, PAIG_AS_THEY_ARE}, nullptr, OUTPUTS, 1, side, device);
  return 2 * numbers(it) * sizeof(float) <= paig_most_shared(device);
}

// Among how many blocks of a device the work is shared out for each pair of chunks.
extern "C" int paig_gpu_weight_gradient_shares(int inputs, int outputs, int frames, int side, int device) {
  return shares_of(plan({nullptr, nullptr, inputs, 0, PAIG_AS_THEY_ARE}, nullptr, outputs, frames, side, device));
}

// From what a convolution saw and the gradient [frames, outputs, side, side] of its result that of its weight [outputs, inputs,
// 3, 3], and after it in `result` that of its bias [outputs]. `workspace` has room for as many numbers of each share.
extern "C" bool paig_gpu_weight_gradient(PaigInput input, const float *gradient, float *result, float *workspace, int outputs,
                                         int frames, int side, void *stream) {
  WeightGradient it = plan(input, gradient, outputs, frames, side, paig_device());
  it.shares = workspace;
  bool launched = it.groups == 4 ? launch<4>(it, stream) : it.groups == 2 ? launch<2>(it, stream) : launch<1>(it, stream);
  long count = results(input.first_channels + input.second_channels, outputs);
  return launched && paig_gpu_add_shares(workspace, result, shares_of(it), count, stream);
}
