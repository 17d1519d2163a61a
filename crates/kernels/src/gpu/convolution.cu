// Convolutions with 3 x 3 kernels, and their gradient by what they see.
//
// A block computes a band of rows of some frames: it takes the band of a few channels into shared memory and adds what they
// give, while the next few are on their way. A thread has four pixels of ROWS rows in PER_THREAD channels: each number that it
// reads serves many products. Where there are few frames, and few blocks, a block has SLICES as many threads: each slice sees a
// part of the channels, so that memory serves some while others compute. What the slices have is added at the end, always in the
// same order.

#include "device.h"
#include "pictures.h"

namespace {

constexpr int PER_THREAD = 8;
// Channels that a slice has in shared memory at a time, twice.
constexpr int CHUNK = 4;
// Threads for the pixels of a block, at most.
constexpr int PIXEL_THREADS = 128;
// Of few frames, smaller blocks, so that there is one for each of a GPU's processors; and what few are, in quads.
constexpr int FEW_THREADS = 32, FEW = 1 << 16;
// Shared memory of a block of one slice, at most, where fewer pixels need less: it leaves room for another, and every GPU has it.
constexpr size_t ROOM = 96 << 10;

struct Convolution {
  PaigInput input;
  // [outputs, inputs, 3, 3]; of a gradient [inputs, outputs, 3, 3], turned by half a turn.
  const float *weight;
  // None of a gradient.
  const float *bias;
  bool gradient, relu;
  // Where this is not above 0 the result is 0; null for everywhere. As the first output.
  const float *passes;
  float *first, *second;
  int first_channels, second_channels;
  int frames;
  Band band;
  Walk walk;
};

// A thread's channels of a result at four pixels of a row.
__device__ void put(const Convolution &it, int frame, int channel, int y, int x, const float *four) {
  int side = it.band.side;
  bool first = channel < it.first_channels;
  float *picture = first ? it.first : it.second;
  int within = first ? channel : channel - it.first_channels;
  long at = ((static_cast<long>(frame) * (first ? it.first_channels : it.second_channels) + within) * side + y) * side + x;
  const float *passes = first && it.passes ? it.passes + at : nullptr;
  if (side % 4 == 0) {
    float4 value = make_float4(four[0], four[1], four[2], four[3]);
    if (passes) {
      float4 by = *reinterpret_cast<const float4 *>(passes);
      value = make_float4(by.x <= 0 ? 0 : value.x, by.y <= 0 ? 0 : value.y, by.z <= 0 ? 0 : value.z, by.w <= 0 ? 0 : value.w);
    }
    *reinterpret_cast<float4 *>(picture + at) = value;
    return;
  }
  for (int i = 0; i < 4 && x + i < side; i++) picture[at + i] = passes && passes[i] <= 0 ? 0 : four[i];
}

// Begins to take what a chunk of channels takes part with into shared memory: their bands, and their weights.
template <int CHANNELS>
__device__ __forceinline__ void fetch(const Convolution &it, float *tile, int chunk, int channels, int first_channel,
                                      int first_frame, int first_row, int thread, int threads) {
  int inputs = it.input.first_channels + it.input.second_channels, outputs = it.first_channels + it.second_channels;
  fill_tile(it.input, it.band, it.walk, tile, chunk, channels, first_frame, it.frames, first_row, thread);
  float *weights = tile + CHUNK * it.band.stride;
  for (int i = thread; i < channels * 9 * CHANNELS; i += threads) {
    int output = first_channel + i % CHANNELS, tap = i / CHANNELS % 9, input = chunk + i / CHANNELS / 9;
    int place = it.gradient ? (input * outputs + output) * 9 + 8 - tap : (output * inputs + input) * 9 + tap;
    if (output < outputs)
      paig_begin_copy(weights + i, it.weight + place);
    else
      weights[i] = 0;
  }
}

// grid: groups of frames, bands, groups of channels; block: pixels, GROUPS of PER_THREAD channels, SLICES of the inputs.
template <int GROUPS, int ROWS, int SLICES>
__global__ void __launch_bounds__(PIXEL_THREADS *GROUPS) convolve(Convolution it) {
  static_assert(SLICES == 1 || SLICES * FEW_THREADS <= PIXEL_THREADS, "no more threads than the launch bounds say");
  constexpr int CHANNELS = GROUPS * PER_THREAD;
  const Band &band = it.band;
  int inputs = it.input.first_channels + it.input.second_channels;
  int outputs = it.first_channels + it.second_channels;
  // A slice's chunk: its tile and weights; those of the next one.
  int slice = threadIdx.z;
  int room = CHUNK * (band.stride + 9 * CHANNELS);
  float *now = paig_shared() + 2 * room * slice, *next = now + room;
  int thread = threadIdx.y * blockDim.x + threadIdx.x, threads = blockDim.x * GROUPS;
  int first_row = blockIdx.y * band.rows, first_frame = blockIdx.x * band.frames;
  int first_channel = blockIdx.z * CHANNELS;

  int quad = threadIdx.x % band.quads;
  int row = threadIdx.x / band.quads % (band.rows / ROWS) * ROWS;
  int frame = threadIdx.x / band.quads / (band.rows / ROWS);
  bool has_pixels = frame < band.frames;
  // The shared memory of frame 0 is there in any case.
  int own_pixels = band.place(has_pixels ? frame : 0, row, 4 * quad - 1);
  int own_weights = CHUNK * band.stride + threadIdx.y * PER_THREAD;

  float sums[ROWS][PER_THREAD][4] = {};
  clear_tile(band, now, CHUNK, thread, threads);
  clear_tile(band, next, CHUNK, thread, threads);
  __syncthreads();
  auto fetch_chunk = [&](float *tile, int chunk) {
    if (chunk < inputs)
      fetch<CHANNELS>(it, tile, chunk, min(CHUNK, inputs - chunk), first_channel, first_frame, first_row, thread, threads);
  };
  fetch_chunk(now, CHUNK * slice);
  for (int round = 0; round < inputs; round += CHUNK * SLICES) {
    int chunk = round + CHUNK * slice, channels = min(CHUNK, inputs - chunk);
    paig_copies_arrive();
    __syncthreads();
    fetch_chunk(next, chunk + CHUNK * SLICES);
    for (int channel = 0; channel < channels; channel++) {
      float seen[ROWS + 2][6];
#pragma unroll
      for (int line = 0; line < ROWS + 2; line++)
        six(now + own_pixels + channel * band.stride + line * band.pitch, seen[line]);
#pragma unroll
      for (int tap = 0; tap < 9; tap++) {
        const float4 *by = reinterpret_cast<const float4 *>(now + own_weights + (channel * 9 + tap) * CHANNELS);
        float4 low = by[0], high = by[1];
        float factors[PER_THREAD] = {low.x, low.y, low.z, low.w, high.x, high.y, high.z, high.w};
#pragma unroll
        for (int line = 0; line < ROWS; line++)
#pragma unroll
          for (int output = 0; output < PER_THREAD; output++)
#pragma unroll
            for (int pixel = 0; pixel < 4; pixel++)
              sums[line][output][pixel] += seen[line + tap / 3][pixel + tap % 3] * factors[output];
      }
    }
    float *done = now;
    now = next;
    next = done;
  }

  // The sums of all slices, in which threads that are neighbours write side by side.
  float4 *all = reinterpret_cast<float4 *>(paig_shared());
  auto place = [&](int of_slice, int line, int output) {
    return ((of_slice * ROWS + line) * PER_THREAD + output) * threads + thread;
  };
  if (SLICES > 1) {
    __syncthreads();
#pragma unroll
    for (int line = 0; line < ROWS; line++)
#pragma unroll
      for (int output = 0; output < PER_THREAD; output++) {
        const float *four = sums[line][output];
        all[place(slice, line, output)] = make_float4(four[0], four[1], four[2], four[3]);
      }
    __syncthreads();
  }
  if (!has_pixels || first_frame + frame >= it.frames) return;
#pragma unroll
  for (int output = 0; output < PER_THREAD; output++) {
    int channel = first_channel + threadIdx.y * PER_THREAD + output;
    if (channel >= outputs) return;
    if (output % SLICES != slice) continue;
    float bias = it.bias ? it.bias[channel] : 0;
#pragma unroll
    for (int line = 0; line < ROWS; line++) {
      int y = first_row + row + line;
      float *four = sums[line][output];
      for (int other = 0; SLICES > 1 && other < SLICES; other++) {
        float4 part = all[place(other, line, output)];
        const float added[4] = {part.x, part.y, part.z, part.w};
#pragma unroll
        for (int pixel = 0; pixel < 4; pixel++) four[pixel] = other == 0 ? added[pixel] : four[pixel] + added[pixel];
      }
#pragma unroll
      for (int pixel = 0; pixel < 4; pixel++) {
        float value = four[pixel] + bias;
        four[pixel] = it.relu && value < 0 ? 0 : value;
      }
      if (y < band.side) put(it, first_frame + frame, channel, y, 4 * quad, four);
    }
  }
}

template <int GROUPS, int ROWS, int SLICES>
bool launch_blocks(Convolution it, int side, int pixel_threads, void *stream) {
  constexpr int CHANNELS = GROUPS * PER_THREAD;
  it.band = Band::of(side, pixel_threads * ROWS, ROWS == 2);
  int outputs = it.first_channels + it.second_channels;
  int pixels = it.band.frames * it.band.rows / ROWS * it.band.quads;
  dim3 block(paig_parts(pixels, 32) * 32, GROUPS, SLICES);
  it.walk = Walk::through(it.band, block.x * GROUPS);
  dim3 grid(paig_parts(it.frames, it.band.frames), it.band.count(), paig_parts(outputs, CHANNELS));
  size_t tiles = 2 * CHUNK * (it.band.stride + 9 * CHANNELS) * SLICES;
  size_t sums = SLICES > 1 ? 4 * ROWS * PER_THREAD * block.x * block.y * SLICES : 0;
  size_t shared = max(tiles, sums) * sizeof(float);
  // Of the smallest pictures most is border.
  if (shared > ROOM && pixel_threads > FEW_THREADS)
    return launch_blocks<GROUPS, ROWS, SLICES>(it, side, pixel_threads / 2, stream);
  return paig_launch(convolve<GROUPS, ROWS, SLICES>, grid, block, shared, stream, it);
}

bool launch(const Convolution &it, int side, void *stream) {
  int groups = paig_parts(it.first_channels + it.second_channels, PER_THREAD);
  long quads = static_cast<long>(it.frames) * side * ((side + 3) / 4) * groups;
  // A row of the widest pictures has more quads than a small block.
  if (quads < FEW && side <= 4 * FEW_THREADS) {
    int chunks = paig_parts(it.input.first_channels + it.input.second_channels, CHUNK);
    return chunks >= 4   ? launch_blocks<1, 1, 4>(it, side, FEW_THREADS, stream)
           : chunks >= 2 ? launch_blocks<1, 1, 2>(it, side, FEW_THREADS, stream)
                         : launch_blocks<1, 1, 1>(it, side, FEW_THREADS, stream);
  }
  // Blocks of two groups see a tile once for both.
  return groups % 2 == 0 ? launch_blocks<2, 2, 1>(it, side, PIXEL_THREADS, stream)
                         : launch_blocks<1, 2, 1>(it, side, PIXEL_THREADS, stream);
}

}  // namespace

// result [frames, outputs, side, side] = convolution of `input` with `weight` [outputs, inputs, 3, 3], plus `bias`.
extern "C" bool paig_gpu_convolve(PaigInput input, const float *weight, const float *bias, bool relu, float *result, int outputs,
                                  int frames, int side, void *stream) {
  Convolution it = {input, weight, bias, false, relu, nullptr, result, nullptr, outputs, 0, frames, {}, {}};
  return launch(it, side, stream);
}

// From the gradient [frames, outputs, side, side] of a convolution's result that of what it saw, of which the first
// `first_channels` channels go into `first` (0 where `passes` is not above 0, if that is given), the others into `second`.
extern "C" bool paig_gpu_convolve_gradient(const float *gradient, int outputs, const float *weight, float *first, int first_channels,
                                           float *second, int second_channels, const float *passes, int frames, int side,
                                           void *stream) {
  PaigInput input = {gradient, nullptr, outputs, 0, PAIG_AS_THEY_ARE};
  Convolution it = {input, weight, nullptr, true, false, passes, first, second, first_channels, second_channels, frames, {}, {}};
  return launch(it, side, stream);
}
