// Blocks of threads on the processor, for a program that is built without CUDA's compiler: see device.h.

// With it glibc takes the stack of another fiber for an error.
#undef _FORTIFY_SOURCE

#include "device.h"

#ifndef __CUDACC__

#include <memory>
#include <vector>

#include <setjmp.h>
#include <ucontext.h>

thread_local dim3 threadIdx, blockIdx, blockDim, gridDim;

namespace {

constexpr size_t STACK = 64 << 10;

// A thread of a block, which stops at barriers. It is made once, and waits for work in between. A jump from one to the other
// is a hundred times as fast as swapcontext, which asks the system.
struct Fiber {
  jmp_buf stopped;
  ucontext_t context;
  std::unique_ptr<char[]> stack;
  dim3 place;
  bool done;
};

thread_local jmp_buf scheduler;
thread_local Fiber *running;
thread_local const std::function<void()> *work;
thread_local std::vector<float4> shared_memory;

void stop() {
  if (_setjmp(running->stopped) == 0) _longjmp(scheduler, 1);
}

void live() {
  for (;;) {
    (*work)();
    running->done = true;
    stop();
  }
}

void go_on(Fiber &fiber) {
  running = &fiber;
  threadIdx = fiber.place;
  if (_setjmp(scheduler) != 0) return;
  if (fiber.stack) _longjmp(fiber.stopped, 1);
  fiber.stack.reset(new char[STACK]);
  getcontext(&fiber.context);
  fiber.context.uc_stack.ss_sp = fiber.stack.get();
  fiber.context.uc_stack.ss_size = STACK;
  fiber.context.uc_link = nullptr;
  makecontext(&fiber.context, live, 0);
  setcontext(&fiber.context);
}

void run_block(std::vector<Fiber> &fibers, size_t count) {
  for (size_t i = 0; i < count; i++) {
    fibers[i].done = false;
    fibers[i].place = dim3(i % blockDim.x, i / blockDim.x % blockDim.y, i / blockDim.x / blockDim.y);
  }
  for (size_t left = count; left > 0;)
    for (size_t i = 0; i < count; i++) {
      if (fibers[i].done) continue;
      go_on(fibers[i]);
      left -= running->done;
    }
}

}  // namespace

void __syncthreads() { stop(); }

float *paig_shared() { return &shared_memory.data()->x; }

bool paig_run_blocks(dim3 grid, dim3 block, size_t shared, const std::function<void()> &thread) {
  // As many as a block of a GPU may have: they must stay where they are.
  static thread_local std::vector<Fiber> fibers(1024);
  size_t count = static_cast<size_t>(block.x) * block.y * block.z;
  if (count > fibers.size() || shared > paig_most_shared(0)) return false;
  work = &thread;
  gridDim = grid;
  blockDim = block;
  for (unsigned z = 0; z < grid.z; z++)
    for (unsigned y = 0; y < grid.y; y++)
      for (unsigned x = 0; x < grid.x; x++) {
        blockIdx = dim3(x, y, z);
        // What was not written is not a number.
        shared_memory.assign(shared / sizeof(float4) + 1, {NAN, NAN, NAN, NAN});
        run_block(fibers, count);
      }
  return true;
}

#endif
