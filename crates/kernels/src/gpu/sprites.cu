// Sprites moved by a separable spatial transformer and composed over a background, as in ../sprites/mod.rs.
//
// The gradient of a sprite sampled by rows and columns is a product of three matrices, taken one after the other: a
// thread has a column of a frame and adds its pixels' gradients to the two rows of the sprite that each falls between;
// then, for each pixel of the sprite, the few columns of frames that see it are gathered. So no two threads add to one
// number.

#include "shares.h"

struct PaigScene {
  int frames, objects, channels, window, side;
  // Taken off a mask's logit after it was sampled.
  float outside;
  // The background's logit.
  float background;
};

// Sprites [objects, 1 + channels, window, window] with the masks' logits first, a background [channels, side, side],
// and the source pixel of each row and column, [objects, frames, side].
struct PaigDrawn {
  const float *sprites, *background, *rows, *columns;
};

// Frames [frames, channels, side, side] that were drawn, the logarithm of the sum of the exponentials of each pixel's
// logits [frames, side, side], and the gradient of the frames.
struct PaigSeen {
  const float *frames, *normaliser, *gradient;
};

struct PaigDrawnGradients {
  float *sprites, *background, *rows, *columns;
};

namespace {

// Threads of a block that has one for each pixel.
constexpr int PIXELS = 256;
// Columns of frames that a block goes through at a time, where a frame has not more; and at most.
constexpr int COLUMNS = 128, MOST_COLUMNS = 512;
// Rows after which what they add up to is summed.
constexpr int ROWS = 16;
// Blocks that have sums of their own, to be added up later: some for each processor of a large GPU.
constexpr int MOST_SLICES = 792, MOST_BACKGROUND_SLICES = 1056;
// Of the shared memory of a processor, what leaves others room.
constexpr size_t MOST_SHARED = 96 << 10;

// Where a row or column falls in a sprite: between a pixel and the one a step further, with these weights; outside,
// both weights are 0, and so is the step.
struct Sample {
  int below, step;
  float weight_below, weight_above;
};

__device__ bool is_inside(float pixel, int size) {
  float below = floorf(pixel);
  return below >= 0.0f && below + 1.0f <= static_cast<float>(size - 1);
}

__device__ Sample sampled(float pixel, int size) {
  // What is no place shows in the weight.
  if (!is_inside(pixel, size)) return {0, 0, pixel - pixel, pixel - pixel};
  float below = floorf(pixel);
  return {static_cast<int>(below), 1, below + 1.0f - pixel, pixel - below};
}

__device__ bool is_outside(Sample sample) { return sample.step == 0 && sample.weight_below == 0.0f; }

// A place whose weight is 0 for all pixels where the given one is outside, and not a number where that is none.
__device__ float place_of(float pixel, int size) { return is_inside(pixel, size) ? pixel : pixel - pixel - 2.0f; }

// The weight of a sprite's pixel at a place.
__device__ float weight_of(float place, int pixel) {
  float distance = fabsf(place - static_cast<float>(pixel));
  return distance >= 1.0f ? 0.0f : 1.0f - distance;
}

// A layer's value between four pixels, and its derivatives.
struct Interpolated {
  float value, by_row, by_column;
};

__device__ Interpolated interpolated(const float *corner, int window, Sample row, Sample column) {
  const float *next = corner + row.step * window;
  float a = corner[0], b = corner[column.step], c = next[0], d = next[column.step];
  float below = column.weight_below * a + column.weight_above * b;
  float above = column.weight_below * c + column.weight_above * d;
  return {row.weight_below * below + row.weight_above * above, above - below,
          row.weight_below * (b - a) + row.weight_above * (d - c)};
}

// Draws pixels of the frame `blockIdx.x`, and keeps their normalisers if there is memory for them.
template <int CHANNELS>
__global__ void __launch_bounds__(PIXELS)
    draw_pixels(PaigScene scene, PaigDrawn drawn, float *__restrict__ frames, float *__restrict__ normaliser) {
  int side = scene.side, window = scene.window, pixels = side * side, area = window * window;
  int pixel = blockIdx.y * PIXELS + threadIdx.x;
  if (pixel >= pixels) return;
  int y = pixel / side, x = pixel % side;
  float largest = scene.background, sum = 1.0f, colours[CHANNELS];
  for (int channel = 0; channel < CHANNELS; channel++) colours[channel] = drawn.background[channel * pixels + pixel];
  for (int object = 0; object < scene.objects; object++) {
    size_t line = (static_cast<size_t>(object) * scene.frames + blockIdx.x) * side;
    Sample row = sampled(drawn.rows[line + y], window), column = sampled(drawn.columns[line + x], window);
    const float *corner = drawn.sprites + object * (1 + CHANNELS) * area + row.below * window + column.below;
    float logit = interpolated(corner, window, row, column).value - scene.outside;
    // The softmax of a list that is seen once: what was summed is scaled down where a larger logit comes.
    float larger = fmaxf(largest, logit), kept = expf(largest - larger), weight = expf(logit - larger);
    largest = larger;
    sum = sum * kept + weight;
    for (int channel = 0; channel < CHANNELS; channel++) {
      float colour = interpolated(corner + (1 + channel) * area, window, row, column).value;
      colours[channel] = colours[channel] * kept + weight * colour;
    }
  }
  size_t frame = blockIdx.x;
  for (int channel = 0; channel < CHANNELS; channel++)
    frames[(frame * CHANNELS + channel) * pixels + pixel] = colours[channel] / sum;
  if (normaliser != nullptr) normaliser[frame * pixels + pixel] = largest + logf(sum);
}

// How the frames are shared out for the gradients: sets of some frames, whose columns stand side by side, and blocks
// that each go through some sets for one object.
struct Shares {
  int slots, sets, blocks;
  // Floats of a block: in any case in shared memory, and those that may be elsewhere.
  size_t fixed, columns;
  bool in_shared;
  int background_slices;

  explicit Shares(const PaigScene &scene) {
    slots = scene.side < COLUMNS ? COLUMNS / scene.side : 1;
    sets = paig_parts(scene.frames, slots);
    int most = scene.objects < MOST_SLICES ? MOST_SLICES / scene.objects : 1;
    blocks = sets > 0 ? paig_parts(sets, paig_parts(sets, most)) : 0;
    size_t lanes = slots * scene.side;
    fixed = lanes + ROWS * (lanes | 1) + 2 * slots * scene.window;
    columns = (1 + scene.channels) * scene.window * lanes;
    in_shared = (fixed + columns) * sizeof(float) <= MOST_SHARED;
    int tiles = paig_parts(scene.side * scene.side, PIXELS);
    int most_background = tiles < MOST_BACKGROUND_SLICES ? MOST_BACKGROUND_SLICES / tiles : 1;
    background_slices = scene.frames < most_background ? scene.frames : most_background;
  }

  int threads(const PaigScene &scene) const { return paig_parts(slots * scene.side, 32) * 32; }
  size_t shared() const { return (fixed + (in_shared ? columns : 0)) * sizeof(float); }
};

// The gradients by one object's rows and columns, and a slice of those by its sprite: `slices` is [blocks, objects,
// layers, window, window].
template <int CHANNELS>
__global__ void __launch_bounds__(MOST_COLUMNS)
    trace_sprites(PaigScene scene, PaigDrawn drawn, PaigSeen seen, Shares shares, float *__restrict__ by_rows,
                  float *__restrict__ by_columns, float *__restrict__ slices, float *spilled) {
  constexpr int LAYERS = 1 + CHANNELS;
  int side = scene.side, window = scene.window, area = window * window, pixels = side * side;
  int lanes = shares.slots * side, stride = lanes | 1, thread = threadIdx.x, object = blockIdx.y;
  int slot = thread / side, x = thread % side;
  const float *sprite = drawn.sprites + object * LAYERS * area;
  float *slice = slices + (static_cast<size_t>(blockIdx.x) * scene.objects + object) * LAYERS * area;

  // Places of columns [lanes]; terms of the gradients by rows [ROWS, stride]; first and last of the columns that see
  // each of the sprite's [slots, window]; the gradient of the sprite with its columns sampled [layers, window, lanes].
  float *places = paig_shared(), *terms = places + lanes;
  int *first = reinterpret_cast<int *>(terms + ROWS * stride), *last = first + shares.slots * window;
  float *columns = reinterpret_cast<float *>(last + shares.slots * window);
  if (!shares.in_shared)
    columns = spilled + (static_cast<size_t>(blockIdx.x) * scene.objects + object) * shares.columns;

  for (int set = blockIdx.x; set < shares.sets; set += gridDim.x) {
    size_t frame = set * shares.slots + slot, line = (static_cast<size_t>(object) * scene.frames + frame) * side;
    bool has_frame = slot < shares.slots && frame < static_cast<size_t>(scene.frames);
    float pixel_of_column = has_frame ? drawn.columns[line + x] : -1.0f;
    Sample column = sampled(pixel_of_column, window);
    if (slot < shares.slots) {
      places[thread] = place_of(pixel_of_column, window);
      for (int i = 0; i < LAYERS * window; i++) columns[i * lanes + thread] = 0.0f;
    }
    float by_column = 0.0f;
    for (int top = 0; top < side; top += ROWS) {
      for (int y = top; has_frame && y < side && y < top + ROWS; y++) {
        Sample row = sampled(drawn.rows[line + y], window);
        float by_row = 0.0f;
        if (!is_outside(row)) {
          int pixel = y * side + x;
          float back[CHANNELS], by_layer[LAYERS] = {};
          for (int channel = 0; channel < CHANNELS; channel++) {
            size_t at = (frame * CHANNELS + channel) * pixels + pixel;
            back[channel] = seen.gradient[at];
            by_layer[0] -= back[channel] * seen.frames[at];
          }
          const float *corner = sprite + row.below * window + column.below;
          Interpolated logit = interpolated(corner, window, row, column);
          float mask = expf(logit.value - scene.outside - seen.normaliser[frame * pixels + pixel]);
          for (int channel = 0; channel < CHANNELS; channel++) {
            Interpolated colour = interpolated(corner + (1 + channel) * area, window, row, column);
            by_layer[0] += back[channel] * colour.value;
            by_layer[1 + channel] = mask * back[channel];
            by_row += by_layer[1 + channel] * colour.by_row;
            by_column += by_layer[1 + channel] * colour.by_column;
          }
          by_layer[0] *= mask;
          by_row += by_layer[0] * logit.by_row;
          by_column += by_layer[0] * logit.by_column;
          // All are read before one is written, so that no read waits. The two rows are one only where both weights are
          // not a number.
          float *below = columns + row.below * lanes + thread, *above = below + row.step * lanes;
          float sums[2][LAYERS];
          for (int layer = 0; layer < LAYERS; layer++) {
            sums[0][layer] = below[layer * window * lanes] + row.weight_below * by_layer[layer];
            sums[1][layer] = above[layer * window * lanes] + row.weight_above * by_layer[layer];
          }
          for (int layer = 0; layer < LAYERS; layer++) {
            below[layer * window * lanes] = sums[0][layer];
            above[layer * window * lanes] = sums[1][layer];
          }
        }
        terms[(y - top) * stride + thread] = by_row;
      }
      __syncthreads();
      for (int i = thread; i < ROWS * shares.slots; i += blockDim.x) {
        int y = top + i % ROWS, of = set * shares.slots + i / ROWS;
        if (y >= side || of >= scene.frames) continue;
        const float *of_row = terms + i % ROWS * stride + i / ROWS * side;
        float sum = 0.0f;
        for (int term = 0; term < side; term++) sum += of_row[term];
        by_rows[(static_cast<size_t>(object) * scene.frames + of) * side + y] = sum;
      }
      __syncthreads();
    }
    if (has_frame) by_columns[line + x] = by_column;

    for (int i = thread; i < shares.slots * window; i += blockDim.x) {
      const float *of_slot = places + i / window * side;
      int from = side, to = -1;
      for (int place = 0; place < side; place++) {
        if (weight_of(of_slot[place], i % window) == 0.0f) continue;
        if (to < 0) from = place;
        to = place;
      }
      first[i] = from;
      last[i] = to;
    }
    __syncthreads();
    for (int i = thread; i < LAYERS * area; i += blockDim.x) {
      int pixel = i % window;
      float sum = 0.0f;
      for (int of = 0; of < shares.slots; of++) {
        const float *of_slot = columns + i / window * lanes + of * side;
        for (int at = first[of * window + pixel]; at <= last[of * window + pixel]; at++)
          sum += weight_of(places[of * side + at], pixel) * of_slot[at];
      }
      slice[i] = set == static_cast<int>(blockIdx.x) ? sum : slice[i] + sum;
    }
    __syncthreads();
  }
}

// A slice of the gradient by the background, [slices, channels, side, side]: that of every frame `blockIdx.y` plus a
// multiple of the slices.
template <int CHANNELS>
__global__ void __launch_bounds__(PIXELS) trace_background(PaigScene scene, PaigSeen seen, float *__restrict__ slices) {
  int pixels = scene.side * scene.side, pixel = blockIdx.x * PIXELS + threadIdx.x;
  if (pixel >= pixels) return;
  float sums[CHANNELS] = {};
  for (size_t frame = blockIdx.y; frame < static_cast<size_t>(scene.frames); frame += gridDim.y) {
    float mask = expf(scene.background - seen.normaliser[frame * pixels + pixel]);
    for (int channel = 0; channel < CHANNELS; channel++)
      sums[channel] += mask * seen.gradient[(frame * CHANNELS + channel) * pixels + pixel];
  }
  for (int channel = 0; channel < CHANNELS; channel++)
    slices[(static_cast<size_t>(blockIdx.y) * CHANNELS + channel) * pixels + pixel] = sums[channel];
}

int sprite_numbers(const PaigScene &scene) {
  return scene.objects * (1 + scene.channels) * scene.window * scene.window;
}

int background_numbers(const PaigScene &scene) { return scene.channels * scene.side * scene.side; }

template <int CHANNELS>
bool draw(const PaigScene &scene, const PaigDrawn &drawn, float *frames, float *normaliser, void *stream) {
  dim3 grid(scene.frames, paig_parts(scene.side * scene.side, PIXELS));
  return paig_launch(draw_pixels<CHANNELS>, grid, PIXELS, 0, stream, scene, drawn, frames, normaliser);
}

template <int CHANNELS>
bool draw_backward(const PaigScene &scene, const PaigDrawn &drawn, const PaigSeen &seen, const PaigDrawnGradients &by,
                   float *workspace, void *stream) {
  Shares shares(scene);
  float *background = workspace + static_cast<size_t>(shares.blocks) * sprite_numbers(scene);
  float *spilled = background + static_cast<size_t>(shares.background_slices) * background_numbers(scene);
  bool traced = true;
  if (scene.frames > 0) {
    dim3 blocks(shares.blocks, scene.objects);
    dim3 tiles(paig_parts(scene.side * scene.side, PIXELS), shares.background_slices);
    traced = paig_launch(trace_sprites<CHANNELS>, blocks, shares.threads(scene), shares.shared(), stream, scene, drawn,
                         seen, shares, by.rows, by.columns, workspace, spilled) &&
             paig_launch(trace_background<CHANNELS>, tiles, PIXELS, 0, stream, scene, seen, background);
  }
  return traced && paig_gpu_add_shares(workspace, by.sprites, shares.blocks, sprite_numbers(scene), stream) &&
         paig_gpu_add_shares(background, by.background, shares.background_slices, background_numbers(scene), stream);
}

}  // namespace

extern "C" {

// Draws frames [frames, channels, side, side], of 1 or 3 channels, and the normaliser of their gradients unless null.
bool paig_gpu_draw(PaigScene scene, PaigDrawn drawn, float *frames, float *normaliser, void *stream) {
  if (scene.frames == 0) return true;
  return (scene.channels == 1 ? draw<1> : draw<3>)(scene, drawn, frames, normaliser, stream);
}

// Floats of the workspace that the gradients need.
size_t paig_gpu_draw_workspace(PaigScene scene) {
  Shares shares(scene);
  size_t spilled = shares.in_shared ? 0 : static_cast<size_t>(shares.blocks) * scene.objects * shares.columns;
  return static_cast<size_t>(shares.blocks) * sprite_numbers(scene) +
         static_cast<size_t>(shares.background_slices) * background_numbers(scene) + spilled;
}

// The gradients of what was drawn; frames of at most 512 columns.
bool paig_gpu_draw_backward(PaigScene scene, PaigDrawn drawn, PaigSeen seen, PaigDrawnGradients by, float *workspace,
                            void *stream) {
  return (scene.channels == 1 ? draw_backward<1> : draw_backward<3>)(scene, drawn, seen, by, workspace, stream);
}

}
