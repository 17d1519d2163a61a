// The last layer of the U-Net: each pixel's channels to one logit for each object, and its gradients.

#include "shares.h"

namespace {

constexpr int THREADS = 256;
// Objects and channels that a thread has in registers.
constexpr int OBJECTS = 4, CHANNELS = 8;
// Blocks that fill a GPU.
constexpr int BLOCKS = 264;

struct Logits {
  // [frames, channels, pixels], [objects, channels], [objects].
  const float *seen, *weight, *bias;
  int channels, objects, frames;
  // A multiple of 4.
  int pixels;
};

__device__ __forceinline__ float4 four_at(const float *from) { return *reinterpret_cast<const float4 *>(from); }

__device__ __forceinline__ void add_product(float *sums, float factor, float4 by) {
  sums[0] += factor * by.x;
  sums[1] += factor * by.y;
  sums[2] += factor * by.z;
  sums[3] += factor * by.w;
}

// A thread's quad of pixels; false where there is none.
__device__ bool own_quad(const Logits &it, int &frame, int &pixel) {
  long quad = static_cast<long>(blockIdx.x) * blockDim.x + threadIdx.x;
  int quads = it.pixels / 4;
  frame = quad / quads;
  pixel = quad % quads * 4;
  return frame < it.frames;
}

// grid: quads of pixels, chunks of objects.
__global__ void forward(Logits it, float *logits) {
  int frame, pixel;
  if (!own_quad(it, frame, pixel)) return;
  int first = blockIdx.y * OBJECTS, objects = min(OBJECTS, it.objects - first);
  float sums[OBJECTS][4] = {};
  for (int channel = 0; channel < it.channels; channel++) {
    float4 seen = four_at(it.seen + (static_cast<long>(frame) * it.channels + channel) * it.pixels + pixel);
#pragma unroll
    for (int object = 0; object < OBJECTS; object++)
      if (object < objects) add_product(sums[object], it.weight[(first + object) * it.channels + channel], seen);
  }
#pragma unroll
  for (int object = 0; object < OBJECTS; object++) {
    if (object >= objects) return;
    float bias = it.bias[first + object];
    float *into = logits + (static_cast<long>(frame) * it.objects + first + object) * it.pixels + pixel;
    const float *sum = sums[object];
    *reinterpret_cast<float4 *>(into) = make_float4(sum[0] + bias, sum[1] + bias, sum[2] + bias, sum[3] + bias);
  }
}

// Of what was seen, 0 where that is not above 0. grid: quads of pixels, chunks of channels.
__global__ void backward(Logits it, const float *logits_gradient, float *gradient) {
  int frame, pixel;
  if (!own_quad(it, frame, pixel)) return;
  int first = blockIdx.y * CHANNELS, channels = min(CHANNELS, it.channels - first);
  float sums[CHANNELS][4] = {};
  for (int object = 0; object < it.objects; object++) {
    float4 by = four_at(logits_gradient + (static_cast<long>(frame) * it.objects + object) * it.pixels + pixel);
#pragma unroll
    for (int channel = 0; channel < CHANNELS; channel++)
      if (channel < channels) add_product(sums[channel], it.weight[object * it.channels + first + channel], by);
  }
#pragma unroll
  for (int channel = 0; channel < CHANNELS; channel++) {
    if (channel >= channels) return;
    long place = (static_cast<long>(frame) * it.channels + first + channel) * it.pixels + pixel;
    float4 seen = four_at(it.seen + place);
    const float *sum = sums[channel];
    *reinterpret_cast<float4 *>(gradient + place) =
        make_float4(seen.x <= 0 ? 0 : sum[0], seen.y <= 0 ? 0 : sum[1], seen.z <= 0 ? 0 : sum[2], seen.w <= 0 ? 0 : sum[3]);
  }
}

// Of one number after the other.
__device__ float next_block_sum(float number) {
  __syncthreads();
  return block_sum<THREADS>(number);
}

// Shares of the gradients of weights [shares, objects, channels] and biases [shares, objects]. grid: shares, chunks of
// channels, chunks of objects.
__global__ void weight_backward(Logits it, const float *logits_gradient, float *weights, float *biases) {
  int first_channel = blockIdx.y * CHANNELS, first_object = blockIdx.z * OBJECTS;
  int channels = min(CHANNELS, it.channels - first_channel), objects = min(OBJECTS, it.objects - first_object);
  float sums[OBJECTS][CHANNELS] = {}, bias[OBJECTS] = {};
  int quads = it.pixels / 4;
  long all = static_cast<long>(it.frames) * quads;
  for (long quad = static_cast<long>(blockIdx.x) * THREADS + threadIdx.x; quad < all; quad += static_cast<long>(gridDim.x) * THREADS) {
    int frame = quad / quads, pixel = quad % quads * 4;
    float4 by[OBJECTS];
#pragma unroll
    for (int object = 0; object < OBJECTS; object++) {
      by[object] = make_float4(0, 0, 0, 0);
      if (object < objects)
        by[object] = four_at(logits_gradient + (static_cast<long>(frame) * it.objects + first_object + object) * it.pixels + pixel);
      bias[object] += by[object].x + by[object].y + by[object].z + by[object].w;
    }
#pragma unroll
    for (int channel = 0; channel < CHANNELS; channel++) {
      if (channel >= channels) break;
      float4 seen = four_at(it.seen + (static_cast<long>(frame) * it.channels + first_channel + channel) * it.pixels + pixel);
#pragma unroll
      for (int object = 0; object < OBJECTS; object++)
        sums[object][channel] += seen.x * by[object].x + seen.y * by[object].y + seen.z * by[object].z + seen.w * by[object].w;
    }
  }
#pragma unroll
  for (int object = 0; object < OBJECTS; object++) {
#pragma unroll
    for (int channel = 0; channel < CHANNELS; channel++) {
      float sum = next_block_sum(sums[object][channel]);
      if (threadIdx.x == 0 && object < objects && channel < channels)
        weights[(static_cast<long>(blockIdx.x) * it.objects + first_object + object) * it.channels + first_channel + channel] = sum;
    }
    float sum = next_block_sum(bias[object]);
    if (threadIdx.x == 0 && object < objects && blockIdx.y == 0) biases[blockIdx.x * it.objects + first_object + object] = sum;
  }
}

dim3 grid_of(const Logits &it, int chunks_of_it) {
  long quads = static_cast<long>(it.frames) * (it.pixels / 4);
  return dim3(paig_parts(quads, THREADS), chunks_of_it);
}

}  // namespace

// logits [frames, objects, pixels] of `seen` [frames, channels, pixels]; `pixels` is a multiple of 4.
extern "C" bool paig_gpu_logits(const float *seen, const float *weight, const float *bias, float *logits, int channels, int objects,
                                int frames, int pixels, void *stream) {
  Logits it = {seen, weight, bias, channels, objects, frames, pixels};
  return paig_launch(forward, grid_of(it, paig_parts(objects, OBJECTS)), dim3(THREADS), 0, stream, it, logits);
}

// Numbers of the workspace that the gradients need.
extern "C" size_t paig_gpu_logits_workspace(int channels, int objects) {
  return static_cast<size_t>(BLOCKS) * objects * (channels + 1);
}

// From the gradient of the logits those of what was seen (0 where that is not above 0), of the weight and of the bias.
extern "C" bool paig_gpu_logits_backward(const float *logits_gradient, const float *seen, const float *weight, float *gradient,
                                         float *weight_gradient, float *bias_gradient, float *workspace, int channels, int objects,
                                         int frames, int pixels, void *stream) {
  Logits it = {seen, weight, nullptr, channels, objects, frames, pixels};
  float *biases = workspace + static_cast<long>(BLOCKS) * objects * channels;
  dim3 grid(BLOCKS, paig_parts(channels, CHANNELS), paig_parts(objects, OBJECTS));
  return paig_launch(backward, grid_of(it, paig_parts(channels, CHANNELS)), dim3(THREADS), 0, stream, it, logits_gradient, gradient) &&
         paig_launch(weight_backward, grid, dim3(THREADS), THREADS * sizeof(float), stream, it, logits_gradient, workspace, biases) &&
         paig_gpu_add_shares(workspace, weight_gradient, BLOCKS, objects * channels, stream) &&
         paig_gpu_add_shares(biases, bias_gradient, BLOCKS, objects, stream);
}
