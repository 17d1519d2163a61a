// Bands of rows of square pictures in shared memory, with a border of zeros around the picture.

#pragma once

#include "convolution.h"
#include "device.h"

// What a block has of each channel: `rows` rows of each of `frames` frames, in quads of four pixels, and a `border` of as many
// rows above and below, and of as many quads on either side.
struct Band {
  int side, quads, rows, frames, border, pitch;
  // Bands of other channels begin so far on. An odd number of quads, so that neighbouring channels lie in other banks.
  int stride;

  // About `wanted` quads, or fewer where rows or frames do not come out even; of an even number of rows if that is wanted.
  static Band of(int side, int wanted, bool even) {
    Band band;
    band.side = side;
    band.quads = (side + 3) / 4;
    int step = even ? 2 : 1, most = wanted / band.quads / step * step, whole = (side + step - 1) / step * step;
    most = most > step ? most : step;
    band.frames = most / whole > 1 ? most / whole : 1;
    // Bands of about the same height.
    int count = (whole + most - 1) / most;
    band.rows = ((whole + count - 1) / count + step - 1) / step * step;
    return band.with_border(1);
  }

  Band with_border(int border) const {
    Band band = *this;
    band.border = border;
    band.pitch = 4 * (quads + 2 * border);
    band.stride = frames * (rows + 2 * border) * band.pitch;
    if (band.stride / 4 % 2 == 0) band.stride += 4;
    return band;
  }

  // Bands of a picture.
  __host__ __device__ int count() const { return (side + rows - 1) / rows; }

  // Of a pixel of a row, the border's rows counted.
  __device__ int place(int frame, int row, int x) const { return (frame * (rows + 2 * border) + row) * pitch + x + 4 * border; }
};

// How a thread goes through an array [pictures, lines, quads] in steps of `threads`, without a division for each.
struct Walk {
  int quads, lines, quad_step, line_step, picture_step;

  static Walk of(int quads, int lines, int threads) {
    return {quads, lines, threads % quads, threads / quads % lines, threads / quads / lines};
  }

  // Of all lines of a band, the border's too.
  static Walk through(const Band &band, int threads) { return of(band.quads, band.rows + 2 * band.border, threads); }
};

struct Place {
  int quad, line, picture;

  __device__ __forceinline__ Place(const Walk &walk, int first)
      : quad(first % walk.quads), line(first / walk.quads % walk.lines), picture(first / walk.quads / walk.lines) {}

  __device__ __forceinline__ void step(const Walk &walk) {
    quad += walk.quad_step;
    line += walk.line_step;
    picture += walk.picture_step;
    if (quad >= walk.quads) {
      quad -= walk.quads;
      line++;
    }
    if (line >= walk.lines) {
      line -= walk.lines;
      picture++;
    }
  }
};

namespace {

__device__ __forceinline__ float larger(float a, float b) { return a > b || a != a ? a : b; }

// A quad of a row in shared memory with its two neighbours; `row` is at the left one.
__device__ __forceinline__ void six(const float *row, float *pixels) {
  float4 quad = *reinterpret_cast<const float4 *>(row + 1);
  pixels[0] = row[0];
  pixels[1] = quad.x;
  pixels[2] = quad.y;
  pixels[3] = quad.z;
  pixels[4] = quad.w;
  pixels[5] = row[5];
}

// Four pixels of a row of pictures of twice the side, pooled.
__device__ __forceinline__ void pooled(const float *picture, int side, int y, int x, float *four) {
  const float *upper = picture + 4L * y * side + 2 * x, *lower = upper + 2 * side;
  for (int i = 0; i < 4; i++) {
    bool there = x + i < side;
    four[i] = there ? larger(larger(larger(upper[2 * i], upper[2 * i + 1]), lower[2 * i]), lower[2 * i + 1]) : 0;
  }
}

// Four pixels of a row of pictures of half the side, doubled.
__device__ __forceinline__ void doubled(const float *picture, int side, int y, int x, float *four) {
  int half = side / 2, row = y / 2, next = y % 2 && row + 1 < half ? row + 1 : row;
  float between[3];
  for (int i = 0; i < 3; i++) {
    int column = x / 2 + i < half ? x / 2 + i : half - 1;
    float upper = picture[row * half + column], lower = picture[next * half + column];
    between[i] = y % 2 ? 0.5f * upper + 0.5f * lower : upper;
  }
  four[0] = between[0];
  four[1] = 0.5f * between[0] + 0.5f * between[1];
  four[2] = between[1];
  four[3] = 0.5f * between[1] + 0.5f * between[2];
}

// Sets the tiles of some channels to 0: `fill_tile` does not write on either side of a picture.
__device__ __forceinline__ void clear_tile(const Band &band, float *tile, int channels, int thread, int threads) {
  for (int i = thread; i < channels * band.stride / 4; i += threads)
    reinterpret_cast<float4 *>(tile)[i] = make_float4(0, 0, 0, 0);
}

// Begins to take the bands of `channels` channels from `first_channel` on into shared memory; 0 where there is no picture.
__device__ __forceinline__ void fill_tile(const PaigInput &input, const Band &band, const Walk &walk, float *tile, int first_channel,
                                          int channels, int first_frame, int frames, int first_row, int thread) {
  int side = band.side;
  int pictures = channels * band.frames;
  for (Place at(walk, thread); at.picture < pictures; at.step(walk)) {
    int channel = band.frames == 1 ? at.picture : at.picture / band.frames;
    int frame = at.picture - channel * band.frames;
    int x = 4 * at.quad, y = first_row + at.line - band.border;
    float4 *into = reinterpret_cast<float4 *>(tile + channel * band.stride + band.place(frame, at.line, x));
    if (y < 0 || y >= side || first_frame + frame >= frames) {
      *into = make_float4(0, 0, 0, 0);
      continue;
    }
    int from = first_channel + channel;
    bool first = from < input.first_channels;
    const float *source = first ? input.first : input.second;
    int of = first ? input.first_channels : input.second_channels;
    long number = static_cast<long>(first_frame + frame) * of + (first ? from : from - input.first_channels);
    const float *row = source + (number * side + y) * side + x;
    if (input.reading == PAIG_AS_THEY_ARE && side % 4 == 0) {
      paig_begin_copy(into, reinterpret_cast<const float4 *>(row));
      continue;
    }
    float four[4];
    if (input.reading == PAIG_POOLED) {
      pooled(source + number * 4 * side * side, side, y, x, four);
    } else if (input.reading == PAIG_DOUBLED) {
      doubled(source + number * (side / 2) * (side / 2), side, y, x, four);
    } else {
      for (int k = 0; k < 4; k++) four[k] = x + k < side ? row[k] : 0;
    }
    for (int k = 1; k < 4; k++) four[k] = x + k < side ? four[k] : 0;
    *into = make_float4(four[0], four[1], four[2], four[3]);
  }
}

}  // namespace
