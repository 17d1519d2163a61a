// The roll-out of an equation and its gradient, one thread for each clip: a substep is a list of operations on single
// numbers, and a thread keeps these numbers in slots.
//
// Slots: what is held for the frame, the time since the frame, the state (positions, then velocities), the raw
// parameters, the numbers that stand in the list, and then what each operation gives, in the order of the list. First
// come the operations that depend on the parameters alone; they are computed once.

#include "shares.h"

namespace {

// A batch of a hundred clips is to be spread over several multiprocessors: nothing but latency counts here.
constexpr int THREADS = 32;
// A block's shared memory on every GPU of the last years. A list that needs more stays in the GPU's memory.
constexpr size_t MOST_SHARED = 96 << 10;
// Threads that sum the clips' gradients by one parameter.
constexpr int SUMMING = 128;

// As in roll_out.rs.
enum Operation {
  PLUS,
  MINUS,
  TIMES,
  OVER,
  PLUS_PRODUCT,
  MINUS_PRODUCT,
  NORM,
  NEGATIVE,
  SQRT,
  EXP,
  LN,
  SIN,
  COS,
  TAN,
  TANH,
  SIGMOID,
  ABS,
  SIGN,
  POWER,
  ATAN2,
  MIN,
  MAX,
  AT_MOST,
  AT_LEAST,
};

// Above the operation: which of its operands a gradient is wanted of.
constexpr int OPERATION = 0xff, LEARNS_A = 0x100, LEARNS_B = 0x200, LEARNS_C = 0x400;

struct alignas(16) Instruction {
  int operation, a, b, c;
};

constexpr int HELD = 0, SINCE = 1, STATE = 2;

}  // namespace

// The list of an equation.
struct PaigProgram {
  // The instructions (first those that are computed once), the slots of the state after a substep, and the numbers.
  const int *text;
  int still, moving;
  // Of all objects.
  int coordinates;
  int parameters, numbers;
  // Slots of the near and far walls, of x and of y each, and of what they leave of a speed; -1 without walls.
  int near[2], far[2], left;
  int substeps;
  // Whether what is held is the time, which goes on where the dataset ends.
  int tells_time;
  // Time of a substep, and of a frame.
  float h, dt;
};

// What is held for the frames of each clip. Null if nothing is.
struct PaigHeld {
  const float *values;
  int frames;
  // Floats from one clip to the next, and from one frame to the next.
  int clip_step, frame_step;
};

namespace {

struct Forward {
  // [batch, 2 * coordinates]
  const float *initial;
  const float *parameters;
  PaigHeld held;
  // [frames, 2, batch, coordinates]
  float *states;
  // The state before each substep, [frames * substeps, 2 * coordinates, batch]; null if no gradient will be asked for.
  float *history;
  // Room for the slots where shared memory has none.
  float *room;
  int batch, frames;
};

struct Backward {
  // As the states.
  const float *gradient;
  const float *parameters;
  PaigHeld held;
  const float *history;
  float *room;
  // [batch, 2 * coordinates]
  float *by_initial;
  // [parameters, batch]
  float *by_clip;
  int batch, frames;
};

// The numbers of one thread; those of its block stand side by side.
template <bool NEAR>
struct Slots {
  float *first;
  int step;

  __device__ __forceinline__ float &operator[](int slot) const {
    return first[static_cast<size_t>(slot) * (NEAR ? THREADS : step)];
  }
};

// Where things stand.
struct Layout {
  // Floats of the list in shared memory.
  int words;
  // Slots of the first parameter, of the first number, and of the first result, and how many there are.
  int parameters, numbers, results, slots;
};

Layout laid_out(const PaigProgram &program) {
  Layout layout;
  int words = 4 * (program.still + program.moving) + 2 * program.coordinates + program.numbers;
  layout.words = (words + 3) / 4 * 4;
  layout.parameters = STATE + 2 * program.coordinates;
  layout.numbers = layout.parameters + program.parameters;
  layout.results = layout.numbers + program.numbers;
  layout.slots = layout.results + program.still + program.moving;
  return layout;
}

// Bytes of shared memory for the list and for so many numbers in each slot.
size_t shared_for(const Layout &layout, int sets) {
  return sizeof(float) * (layout.words + static_cast<size_t>(sets) * layout.slots * THREADS);
}

__device__ float result(int operation, float a, float b, float c) {
  switch (operation) {
    case PLUS: return a + b;
    case MINUS: return a - b;
    case TIMES: return a * b;
    case OVER: return a / b;
    case PLUS_PRODUCT: return a + b * c;
    case MINUS_PRODUCT: return a - b * c;
    case NORM: return sqrtf(a * a + b * b);
    case NEGATIVE: return -a;
    case SQRT: return sqrtf(a);
    case EXP: return expf(a);
    case LN: return logf(a);
    case SIN: return sinf(a);
    case COS: return cosf(a);
    case TAN: return tanf(a);
    case TANH: return tanhf(a);
    case SIGMOID: return 1 / (1 + expf(-a));
    case ABS: return fabsf(a);
    case SIGN: return (a > 0) - (a < 0);
    case POWER: return powf(a, b);
    case ATAN2: return atan2f(a, b);
    // What is not a number stays so, whichever of the two it is.
    case MIN: return a < b || a != a ? a : b;
    case MAX: return a > b || a != a ? a : b;
    case AT_MOST: return a > b ? b : a;
    default: return a < b ? b : a;
  }
}

// The gradients of the operands from that of the result `y`, by libtorch's rules where there is no derivative.
__device__ void operands(int operation, float g, float y, float &a, float &b, float &c) {
  switch (operation) {
    case PLUS:
      a = b = g;
      break;
    case MINUS:
      a = g;
      b = -g;
      break;
    case TIMES: {
      float by_a = g * b;
      b = g * a;
      a = by_a;
      break;
    }
    case OVER:
      a = g / b;
      b = -g * (y / b);
      break;
    case PLUS_PRODUCT: {
      float by_b = g * c;
      c = g * b;
      b = by_b;
      a = g;
      break;
    }
    case MINUS_PRODUCT: {
      float by_b = -g * c;
      c = -g * b;
      b = by_b;
      a = g;
      break;
    }
    case NORM: {
      float share = y == 0 ? 0 : g / y;
      a *= share;
      b *= share;
      break;
    }
    case NEGATIVE: a = -g; break;
    case SQRT: a = g / (2 * y); break;
    case EXP: a = g * y; break;
    case LN: a = g / a; break;
    case SIN: a = g * cosf(a); break;
    case COS: a = -g * sinf(a); break;
    case TAN: a = g * (1 + y * y); break;
    case TANH: a = g * (1 - y * y); break;
    case SIGMOID: a = g * (1 - y) * y; break;
    case ABS: a = g * ((a > 0) - (a < 0)); break;
    case SIGN: a = 0; break;
    case POWER: {
      float by_a = b == 0 ? 0 : g * (b * powf(a, b - 1));
      b = g * (a == 0 && b >= 0 ? 0 : y * logf(a));
      a = by_a;
      break;
    }
    case ATAN2: {
      float square = a * a + b * b, share = square == 0 ? 0 : 1 / square;
      float by_a = g * (b * share);
      b = g * (-a * share);
      a = by_a;
      break;
    }
    // Of two that are equal each takes a half.
    case MIN:
    case MAX: {
      float part = a == b ? g / 2 : g;
      bool first = operation == MIN ? a > b : a < b, second = operation == MIN ? a < b : a > b;
      a = first ? 0 : part;
      b = second ? 0 : part;
      break;
    }
    // Between a number and a limit that stands in the text, the number takes all.
    case AT_MOST: a = a <= b ? g : 0; break;
    default: a = a >= b ? g : 0; break;
  }
}

// Computes `count` instructions; the first result goes to the slot `into`. Each is read while the one before it is
// computed.
template <bool NEAR>
__device__ __forceinline__ void compute(const Instruction *list, int count, Slots<NEAR> values, int into) {
  if (count == 0) return;
  Instruction next = list[0];
  for (int i = 0; i < count; i++) {
    Instruction now = next;
    if (i + 1 < count) next = list[i + 1];
    values[into + i] = result(now.operation & OPERATION, values[now.a], values[now.b], values[now.c]);
  }
}

// Takes the gradients of the results to those of what they were computed from, and clears them.
template <bool NEAR>
__device__ __forceinline__ void compute_backward(const Instruction *list, int count, Slots<NEAR> values,
                                                 Slots<NEAR> gradients, int into) {
  if (count == 0) return;
  Instruction next = list[count - 1];
  for (int i = count - 1; i >= 0; i--) {
    Instruction now = next;
    if (i > 0) next = list[i - 1];
    float a = values[now.a], b = values[now.b], c = values[now.c];
    float gradient = gradients[into + i];
    gradients[into + i] = 0;
    operands(now.operation & OPERATION, gradient, values[into + i], a, b, c);
    if (now.operation & LEARNS_A) gradients[now.a] += a;
    if (now.operation & LEARNS_B) gradients[now.b] += b;
    if (now.operation & LEARNS_C) gradients[now.c] += c;
  }
}

// How a wall turned a coordinate back: impact.rs says why so.
struct Impact {
  // Whether it is the far one.
  bool far;
  // How far the wall was passed, the way of the substep, and the share of it beyond the wall before it is bounded.
  float beyond, way, share;
  // That share, and the speed that was gained there.
  float since, gained;
};

// The slot of x or of y: not by an index, which would need the structure in memory.
__device__ __forceinline__ int of_axis(const int *slots, int coordinate) {
  return coordinate % 2 == 0 ? slots[0] : slots[1];
}

__device__ __forceinline__ bool passed(float x, float near, float far) { return x > far || x < near; }

__device__ __forceinline__ Impact impact(float x, float speed, float from, float speed_before, float near, float far) {
  Impact hit;
  hit.far = x > far || far < near;
  hit.beyond = x - (hit.far ? far : near);
  float way = x - from;
  hit.way = way == 0 ? 1 : way;
  hit.share = hit.beyond / hit.way;
  hit.since = hit.share < 0 ? 0 : hit.share > 1 ? 1 : hit.share;
  hit.gained = (speed - speed_before) * hit.since;
  return hit;
}

// The state after a substep, turned back by the walls.
template <bool NEAR>
__device__ __forceinline__ void move_on(const PaigProgram &program, const int *moved, Slots<NEAR> values) {
  int coordinates = program.coordinates;
  for (int i = 0; i < coordinates; i++) {
    float x = values[moved[i]], speed = values[moved[coordinates + i]];
    float &place = values[STATE + i], &rate = values[STATE + coordinates + i];
    if (program.left >= 0) {
      float near = values[of_axis(program.near, i)], far = values[of_axis(program.far, i)];
      if (passed(x, near, far)) {
        float left = values[program.left];
        Impact hit = impact(x, speed, place, rate, near, far);
        speed = hit.gained - (speed - hit.gained) * left;
        x = (hit.far ? far : near) - hit.beyond * left;
      }
    }
    place = x;
    rate = speed;
  }
}

// From the gradient of the state after a substep to that of what the list computed, and of what the walls took from the
// state before.
template <bool NEAR>
__device__ __forceinline__ void move_on_backward(const PaigProgram &program, const int *moved, Slots<NEAR> values,
                                                 Slots<NEAR> gradients) {
  int coordinates = program.coordinates;
  for (int i = 0; i < coordinates; i++) {
    int place = STATE + i, rate = STATE + coordinates + i;
    float by_x = gradients[place], by_speed = gradients[rate];
    float by_place = 0, by_rate = 0;
    if (program.left >= 0) {
      float near = values[of_axis(program.near, i)], far = values[of_axis(program.far, i)];
      float x = values[moved[i]], speed = values[moved[coordinates + i]];
      if (passed(x, near, far)) {
        float left = values[program.left];
        Impact hit = impact(x, speed, values[place], values[rate], near, far);
        gradients[program.left] -= by_speed * (speed - hit.gained) + by_x * hit.beyond;
        float by_gained = by_speed * (1 + left), by_wall = by_x, by_beyond = -by_x * left;
        by_rate = -by_gained * hit.since;
        by_x = 0;
        if (hit.share >= 0 && hit.share <= 1) {
          float by_share = by_gained * (speed - values[rate]);
          by_beyond += by_share / hit.way;
          if (x != values[place]) by_x = -by_share * (hit.share / hit.way);
          by_place = -by_x;
        }
        by_speed = by_gained * hit.since - by_speed * left;
        by_x += by_beyond;
        by_wall -= by_beyond;
        gradients[hit.far ? of_axis(program.far, i) : of_axis(program.near, i)] += by_wall;
      }
    }
    gradients[place] = by_place;
    gradients[rate] = by_rate;
    gradients[moved[i]] = by_x;
    gradients[moved[coordinates + i]] = by_speed;
  }
}

// What is held at a frame.
__device__ __forceinline__ float held_at(const PaigProgram &program, const PaigHeld &held, int clip, int frame) {
  const float *own = held.values + static_cast<size_t>(clip) * held.clip_step;
  if (frame < held.frames) return own[frame * held.frame_step];
  if (!program.tells_time) return 0;
  // The clock goes on where the dataset ends; without one it begins at 0.
  int last = held.frames - 1;
  return last < 0 ? frame * program.dt : own[last * held.frame_step] + (frame - last) * program.dt;
}

// The list, and the numbers of this thread: in shared memory or where they stand.
template <bool NEAR>
struct Workplace {
  PaigProgram program;
  Layout layout;
  const Instruction *list;
  const int *moved;
  Slots<NEAR> values, gradients;

  __device__ __forceinline__ Workplace(const PaigProgram &program, const Layout &layout, float *room)
      : program(program), layout(layout) {
    const int *text = program.text;
    int instructions = 4 * (program.still + program.moving);
    if constexpr (NEAR) {
      int *shared = reinterpret_cast<int *>(paig_shared());
      int length = instructions + 2 * program.coordinates + program.numbers;
      for (int i = threadIdx.x; i < length; i += THREADS) shared[i] = text[i];
      __syncthreads();
      text = shared;
      values = {paig_shared() + layout.words + threadIdx.x, 0};
      gradients = {values.first + layout.slots * THREADS, 0};
    } else {
      int threads = gridDim.x * THREADS;
      values = {room + blockIdx.x * THREADS + threadIdx.x, threads};
      gradients = {values.first + static_cast<size_t>(layout.slots) * threads, threads};
    }
    list = reinterpret_cast<const Instruction *>(text);
    moved = text + instructions;
  }

  // Fills the slots of the parameters and the numbers, and computes what depends on them alone.
  __device__ __forceinline__ void begin(const float *parameters) const {
    const float *numbers = reinterpret_cast<const float *>(moved + 2 * program.coordinates);
    for (int i = 0; i < program.parameters; i++) values[layout.parameters + i] = parameters[i];
    for (int i = 0; i < program.numbers; i++) values[layout.numbers + i] = numbers[i];
    values[HELD] = values[SINCE] = 0;
    compute(list, program.still, values, layout.results);
  }

  // Computes what moves with the state, at a substep.
  __device__ __forceinline__ void substep(int substep) const {
    values[SINCE] = substep * program.h;
    compute(list + program.still, program.moving, values, layout.results + program.still);
  }
};

template <bool NEAR>
__global__ void roll_out(PaigProgram program, Layout layout, Forward run) {
  Workplace<NEAR> work(program, layout, run.room);
  int clip = blockIdx.x * THREADS + threadIdx.x;
  if (clip >= run.batch) return;
  int coordinates = program.coordinates, numbers = 2 * coordinates;
  work.begin(run.parameters);
  for (int i = 0; i < numbers; i++) work.values[STATE + i] = run.initial[clip * numbers + i];
  float *history = run.history + clip;
  for (int frame = 0; frame < run.frames; frame++) {
    work.values[HELD] = held_at(program, run.held, clip, frame);
    for (int substep = 0; substep < program.substeps; substep++) {
      if (run.history != nullptr) {
        for (int i = 0; i < numbers; i++, history += run.batch) *history = work.values[STATE + i];
      }
      work.substep(substep);
      move_on(program, work.moved, work.values);
    }
    for (int half = 0; half < 2; half++) {
      float *row = run.states + (static_cast<size_t>(frame * 2 + half) * run.batch + clip) * coordinates;
      for (int i = 0; i < coordinates; i++) row[i] = work.values[STATE + half * coordinates + i];
    }
  }
}

template <bool NEAR>
__global__ void roll_out_backward(PaigProgram program, Layout layout, Backward run) {
  Workplace<NEAR> work(program, layout, run.room);
  int clip = blockIdx.x * THREADS + threadIdx.x;
  if (clip >= run.batch) return;
  int coordinates = program.coordinates, numbers = 2 * coordinates;
  work.begin(run.parameters);
  for (int i = 0; i < layout.slots; i++) work.gradients[i] = 0;
  for (int frame = run.frames - 1; frame >= 0; frame--) {
    work.values[HELD] = held_at(program, run.held, clip, frame);
    for (int half = 0; half < 2; half++) {
      const float *row = run.gradient + (static_cast<size_t>(frame * 2 + half) * run.batch + clip) * coordinates;
      for (int i = 0; i < coordinates; i++) work.gradients[STATE + half * coordinates + i] += row[i];
    }
    for (int substep = program.substeps - 1; substep >= 0; substep--) {
      size_t row = (static_cast<size_t>(frame) * program.substeps + substep) * numbers;
      const float *before = run.history + row * run.batch + clip;
      for (int i = 0; i < numbers; i++, before += run.batch) work.values[STATE + i] = *before;
      work.substep(substep);
      move_on_backward(program, work.moved, work.values, work.gradients);
      compute_backward(work.list + program.still, program.moving, work.values, work.gradients,
                       layout.results + program.still);
    }
  }
  for (int i = 0; i < numbers; i++) run.by_initial[clip * numbers + i] = work.gradients[STATE + i];
  compute_backward(work.list, program.still, work.values, work.gradients, layout.results);
  for (int i = 0; i < program.parameters; i++) {
    run.by_clip[static_cast<size_t>(i) * run.batch + clip] = work.gradients[layout.parameters + i];
  }
}

// The sum of each row of `by_clip`, always in the same order.
__global__ void sum_of_clips(const float *by_clip, float *sums, int batch) {
  const float *own = by_clip + static_cast<size_t>(blockIdx.x) * batch;
  float sum = 0;
  for (int clip = threadIdx.x; clip < batch; clip += SUMMING) sum += own[clip];
  sum = block_sum<SUMMING>(sum);
  if (threadIdx.x == 0) sums[blockIdx.x] = sum;
}

unsigned blocks(int batch) { return paig_parts(batch, THREADS); }

bool is_near(const Layout &layout, int sets) { return shared_for(layout, sets) <= MOST_SHARED; }

}  // namespace

// Floats of room in the GPU's memory that a roll-out needs, or its gradient; none where shared memory has it.
extern "C" size_t paig_gpu_roll_out_room(PaigProgram program, int batch, bool backward) {
  Layout layout = laid_out(program);
  int sets = backward ? 2 : 1;
  return is_near(layout, sets) ? 0 : static_cast<size_t>(sets) * layout.slots * blocks(batch) * THREADS;
}

// The states of all frames. At least one clip.
extern "C" bool paig_gpu_roll_out(PaigProgram program, const float *initial, const float *parameters, PaigHeld held,
                                  float *states, float *history, float *room, int batch, int frames, void *stream) {
  Layout layout = laid_out(program);
  Forward run{initial, parameters, held, states, history, room, batch, frames};
  if (!is_near(layout, 1))
    return paig_launch(roll_out<false>, blocks(batch), THREADS, 0, stream, program, layout, run);
  return paig_launch(roll_out<true>, blocks(batch), THREADS, shared_for(layout, 1), stream, program, layout, run);
}

// The gradients by the initial state and by the raw parameters, summed over the clips.
extern "C" bool paig_gpu_roll_out_backward(PaigProgram program, const float *gradient, const float *parameters,
                                           PaigHeld held, const float *history, float *room, float *by_initial,
                                           float *by_clip, float *by_parameters, int batch, int frames, void *stream) {
  Layout layout = laid_out(program);
  Backward run{gradient, parameters, held, history, room, by_initial, by_clip, batch, frames};
  bool launched = is_near(layout, 2) ? paig_launch(roll_out_backward<true>, blocks(batch), THREADS,
                                                   shared_for(layout, 2), stream, program, layout, run)
                                     : paig_launch(roll_out_backward<false>, blocks(batch), THREADS, 0, stream,
                                                   program, layout, run);
  if (!launched || program.parameters == 0) return launched;
  return paig_launch(sum_of_clips, program.parameters, SUMMING, sizeof(float) * SUMMING, stream,
                     static_cast<const float *>(by_clip), by_parameters, batch);
}
