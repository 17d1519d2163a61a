// Masks of objects and the background, the softmax over logits, and frames seen through them: [objects, frames, pixels,
// channels], the order in which a dense layer reads them.

#include "device.h"
#include "packs.h"

struct PaigParted {
  // Of the objects; the frames' masks have one more, the background's.
  int frames, objects, channels;
  // Of a frame.
  int pixels;
};

namespace {

constexpr int THREADS = 128;

template <int SIZE>
__device__ Pack<SIZE> read(const float *from) {
  return *reinterpret_cast<const Pack<SIZE> *>(from);
}

template <int SIZE>
__device__ void write(const Pack<SIZE> &pack, float *to) {
  *reinterpret_cast<Pack<SIZE> *>(to) = pack;
}

// Pixels of the frame `blockIdx.x`.
template <int SIZE, int CHANNELS>
__global__ void __launch_bounds__(THREADS)
    part(PaigParted sizes, float background, const float *__restrict__ logits, const float *__restrict__ frames,
         float *__restrict__ masks, float *__restrict__ masked) {
  size_t frame = blockIdx.x;
  int pixels = sizes.pixels, first = blockIdx.y * THREADS * SIZE, pixel = first + threadIdx.x * SIZE;
  bool has_pixels = pixel < pixels;
  const float *of_frame = logits + frame * sizes.objects * pixels + pixel;
  float *masks_of_frame = masks + frame * (sizes.objects + 1) * pixels + pixel;

  // The softmax of a list that is seen once: what was summed is scaled down where a larger logit comes.
  float largest[SIZE], sum[SIZE];
  for (int i = 0; i < SIZE; i++) {
    largest[i] = background;
    sum[i] = 1.0f;
  }
  Pack<SIZE> seen[CHANNELS];
  if (has_pixels) {
    for (int object = 0; object < sizes.objects; object++) {
      Pack<SIZE> logit = read<SIZE>(of_frame + object * pixels);
      for (int i = 0; i < SIZE; i++) {
        float larger = fmaxf(largest[i], logit.at[i]);
        sum[i] = sum[i] * expf(largest[i] - larger) + expf(logit.at[i] - larger);
        largest[i] = larger;
      }
    }
    Pack<SIZE> mask;
    for (int i = 0; i < SIZE; i++) mask.at[i] = expf(background - largest[i]) / sum[i];
    write(mask, masks_of_frame + sizes.objects * pixels);
    for (int channel = 0; channel < CHANNELS; channel++)
      seen[channel] = read<SIZE>(frames + (frame * CHANNELS + channel) * pixels + pixel);
  }

  // Products go through shared memory, so that threads side by side write what is side by side.
  float *products = paig_shared();
  int vectors = (pixels - first < THREADS * SIZE ? pixels - first : THREADS * SIZE) / SIZE * CHANNELS;
  for (int object = 0; object < sizes.objects; object++) {
    if (has_pixels) {
      Pack<SIZE> mask = read<SIZE>(of_frame + object * pixels), product[CHANNELS];
      for (int i = 0; i < SIZE; i++) mask.at[i] = expf(mask.at[i] - largest[i]) / sum[i];
      write(mask, masks_of_frame + object * pixels);
      for (int i = 0; i < SIZE * CHANNELS; i++)
        product[i / SIZE].at[i % SIZE] = mask.at[i / CHANNELS] * seen[i % CHANNELS].at[i / CHANNELS];
      for (int i = 0; i < CHANNELS; i++) write(product[i], products + (threadIdx.x * CHANNELS + i) * SIZE);
    }
    __syncthreads();
    float *to = masked + ((object * static_cast<size_t>(sizes.frames) + frame) * pixels + first) * CHANNELS;
    for (int vector = threadIdx.x; vector < vectors; vector += THREADS)
      write(read<SIZE>(products + vector * SIZE), to + vector * SIZE);
    __syncthreads();
  }
}

// From the gradient of the masks that of the logits.
template <int SIZE>
__global__ void __launch_bounds__(THREADS)
    part_backward(PaigParted sizes, const float *__restrict__ masks, const float *__restrict__ gradient,
                  float *__restrict__ by_logits) {
  int pixels = sizes.pixels, pixel = (blockIdx.y * THREADS + threadIdx.x) * SIZE;
  if (pixel >= pixels) return;
  size_t first = static_cast<size_t>(blockIdx.x) * (sizes.objects + 1) * pixels + pixel;
  float mean[SIZE] = {};
  for (int of = 0; of <= sizes.objects; of++) {
    Pack<SIZE> mask = read<SIZE>(masks + first + of * pixels), back = read<SIZE>(gradient + first + of * pixels);
    for (int i = 0; i < SIZE; i++) mean[i] += mask.at[i] * back.at[i];
  }
  float *to = by_logits + static_cast<size_t>(blockIdx.x) * sizes.objects * pixels + pixel;
  for (int of = 0; of < sizes.objects; of++) {
    Pack<SIZE> mask = read<SIZE>(masks + first + of * pixels), back = read<SIZE>(gradient + first + of * pixels);
    for (int i = 0; i < SIZE; i++) mask.at[i] *= back.at[i] - mean[i];
    write(mask, to + of * pixels);
  }
}

// From the gradient of the masked frames that of the masks.
template <int SIZE, int CHANNELS>
__global__ void __launch_bounds__(THREADS)
    masked_backward(PaigParted sizes, const float *__restrict__ frames, const float *__restrict__ gradient,
                    float *__restrict__ by_masks) {
  size_t frame = blockIdx.x;
  int pixels = sizes.pixels, pixel = (blockIdx.y * THREADS + threadIdx.x) * SIZE;
  if (pixel >= pixels) return;
  Pack<SIZE> seen[CHANNELS];
  for (int channel = 0; channel < CHANNELS; channel++)
    seen[channel] = read<SIZE>(frames + (frame * CHANNELS + channel) * pixels + pixel);
  float *to = by_masks + frame * (sizes.objects + 1) * pixels + pixel;
  for (int object = 0; object < sizes.objects; object++) {
    const float *from = gradient + ((object * static_cast<size_t>(sizes.frames) + frame) * pixels + pixel) * CHANNELS;
    Pack<SIZE> back[CHANNELS], by_mask = {};
    for (int i = 0; i < CHANNELS; i++) back[i] = read<SIZE>(from + i * SIZE);
    for (int i = 0; i < SIZE * CHANNELS; i++)
      by_mask.at[i / CHANNELS] += back[i / SIZE].at[i % SIZE] * seen[i % CHANNELS].at[i / CHANNELS];
    write(by_mask, to + object * pixels);
  }
  write(Pack<SIZE>{}, to + sizes.objects * pixels);
}

// Whether these pixels can be taken four at a time.
template <typename... Arrays>
bool in_fours(const PaigParted &sizes, const Arrays *...arrays) {
  return sizes.pixels % 4 == 0 && begin_with_packs(arrays...);
}

dim3 grid(const PaigParted &sizes, int size) {
  return dim3(sizes.frames, paig_parts(sizes.pixels, THREADS * size));
}

}  // namespace

extern "C" {

// From logits [frames, objects, pixels] and the background's constant one, masks [frames, objects + 1, pixels]; and
// frames [frames, channels, pixels], of 1 or 3 channels, times each but the last, [objects, frames, pixels, channels].
bool paig_gpu_part(PaigParted sizes, float background, const float *logits, const float *frames, float *masks,
                   float *masked, void *stream) {
  if (sizes.frames == 0) return true;
  int size = in_fours(sizes, logits, frames, masks, masked) ? 4 : 1;
  auto kernel = size == 4 ? (sizes.channels == 1 ? part<4, 1> : part<4, 3>)
                          : (sizes.channels == 1 ? part<1, 1> : part<1, 3>);
  size_t shared = THREADS * size * sizes.channels * sizeof(float);
  return paig_launch(kernel, grid(sizes, size), THREADS, shared, stream, sizes, background, logits, frames, masks,
                     masked);
}

// The gradient of the logits from that of the masks.
bool paig_gpu_part_backward(PaigParted sizes, const float *masks, const float *gradient, float *by_logits,
                            void *stream) {
  if (sizes.frames == 0) return true;
  int size = in_fours(sizes, masks, gradient, by_logits) ? 4 : 1;
  auto kernel = size == 4 ? part_backward<4> : part_backward<1>;
  return paig_launch(kernel, grid(sizes, size), THREADS, 0, stream, sizes, masks, gradient, by_logits);
}

// The gradient of the masks from that of the masked frames.
bool paig_gpu_masked_backward(PaigParted sizes, const float *frames, const float *gradient, float *by_masks,
                              void *stream) {
  if (sizes.frames == 0) return true;
  int size = in_fours(sizes, frames, gradient, by_masks) ? 4 : 1;
  auto kernel = size == 4 ? (sizes.channels == 1 ? masked_backward<4, 1> : masked_backward<4, 3>)
                          : (sizes.channels == 1 ? masked_backward<1, 1> : masked_backward<1, 3>);
  return paig_launch(kernel, grid(sizes, size), THREADS, 0, stream, sizes, frames, gradient, by_masks);
}

}
