// Convolutions of square pictures with 3 x 3 kernels and zero padding, and what stands between them in a U-Net.

#pragma once

// How a kernel reads the pictures that a convolution sees, in the order in which they are concatenated.
enum PaigReading {
  PAIG_AS_THEY_ARE = 0,
  // Pictures of twice the side: the largest of four pixels.
  PAIG_POOLED = 1,
  // Pictures of half the side, doubled as TensorFlow 1's resize_bilinear does it.
  PAIG_DOUBLED = 2,
};

// What a convolution sees: pictures [frames, channels, side, side] of one or two tensors.
struct PaigInput {
  const float *first, *second;
  int first_channels, second_channels;
  int reading;
};
