// A step of an optimizer on many variables at once.

#include "device.h"

// A variable, its gradient and what the rule keeps of it, of `count` numbers each; and a rate, downwards: below 0.
struct PaigVariable {
  float *variable, *first, *second;
  const float *gradient, *rate;
  long count;
};

enum PaigRule { PAIG_SGD = 0, PAIG_MOMENTUM = 1, PAIG_RMSPROP = 2, PAIG_ADAM = 3 };

struct PaigUpdate {
  int rule;
  // A gradient's numbers are clipped to +- this; infinity for not at all.
  float clip;
  // How much is kept of the first and of the second slot, and what is added under or to the root.
  float first_decay, second_decay, epsilon;
};

namespace {

constexpr int THREADS = 256;
// Numbers of a variable that a block changes.
constexpr long PART = 8 * THREADS;
// As many variables as the arguments of a kernel have room for.
constexpr int AT_ONCE = 64;

struct Batch {
  PaigVariable variables[AT_ONCE];
  // How many blocks each variable and those before it have.
  int blocks[AT_ONCE];
};

// As libtorch's lerp: from a part of the way to `to`.
__device__ __forceinline__ float towards(float from, float to, float part) { return from + part * (to - from); }

// grid: the parts of all variables.
__global__ void descend(Batch batch, PaigUpdate update) {
  int variable = 0, block = blockIdx.x;
  while (batch.blocks[variable] <= block) variable++;
  const PaigVariable &it = batch.variables[variable];
  float rate = *it.rate;
  long first = (block - (variable > 0 ? batch.blocks[variable - 1] : 0)) * PART;
  long end = min(it.count, first + PART);
  for (long i = first + threadIdx.x; i < end; i += THREADS) {
    float gradient = it.gradient[i];
    // What is not a number stays so.
    gradient = gradient < -update.clip ? -update.clip : gradient > update.clip ? update.clip : gradient;
    float change = gradient * rate;
    if (update.rule == PAIG_MOMENTUM) {
      float mean = it.first[i] * update.first_decay + gradient;
      it.first[i] = mean;
      change = mean * rate;
    } else if (update.rule == PAIG_RMSPROP) {
      float square = towards(it.first[i], gradient * gradient, 1 - update.first_decay);
      it.first[i] = square;
      change = gradient * rate / sqrtf(square + update.epsilon);
    } else if (update.rule == PAIG_ADAM) {
      float mean = towards(it.first[i], gradient, 1 - update.first_decay);
      float square = towards(it.second[i], gradient * gradient, 1 - update.second_decay);
      it.first[i] = mean;
      it.second[i] = square;
      change = mean * rate / (sqrtf(square) + update.epsilon);
    }
    it.variable[i] += change;
  }
}

}  // namespace

// Changes the variables by their gradients. `variables` is in the main memory.
extern "C" bool paig_gpu_descend(PaigUpdate update, const PaigVariable *variables, int count, void *stream) {
  for (int first = 0; first < count; first += AT_ONCE) {
    Batch batch = {};
    int here = min(count - first, AT_ONCE), blocks = 0;
    for (int i = 0; i < here; i++) {
      batch.variables[i] = variables[first + i];
      batch.blocks[i] = blocks += paig_parts(batch.variables[i].count, PART);
    }
    if (blocks > 0 && !paig_launch(descend, dim3(blocks), dim3(THREADS), 0, stream, batch, update)) return false;
  }
  return true;
}
