// Numbers side by side in memory, read and written at once.

#pragma once

#include <cstdint>

namespace {

template <int SIZE>
struct alignas(SIZE * sizeof(float)) Pack {
  float at[SIZE];
};

// Whether arrays begin where packs of four may.
template <typename... Arrays>
bool begin_with_packs(const Arrays *...arrays) {
  return ((reinterpret_cast<uintptr_t>(arrays) | ...) & 15) == 0;
}

}  // namespace
