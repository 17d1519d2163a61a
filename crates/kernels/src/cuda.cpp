// What tch has no calls for on a GPU: a stream of one's own, work that is recorded once and repeated, and what matrix
// products may be rounded to. Compiled against a libtorch without CUDA it says that there is none.

#include <ATen/Context.h>

#ifdef PAIG_CUDA
#include <ATen/cuda/CUDAGraph.h>
#include <c10/cuda/CUDAStream.h>
#endif

#include <exception>
#include <string>

namespace {

thread_local std::string failure;

template <typename Work>
bool done(Work work) {
  try {
    work();
    return true;
  } catch (const std::exception &error) {
    failure = error.what();
    return false;
  }
}

}  // namespace

extern "C" {

// Why the last call of this thread failed.
const char *paig_cuda_failure() { return failure.c_str(); }

// Whether float32 products may be computed in numbers of ten bits (TF32).
void paig_allow_tf32(bool allowed) {
  at::globalContext().setAllowTF32CuDNN(allowed);
  at::globalContext().setAllowTF32CuBLAS(allowed);
}

#ifdef PAIG_CUDA

bool paig_cuda_built() { return true; }

// What this thread does on the device from now on goes through a stream of its own: a recording must not touch the default one.
bool paig_cuda_stream(int device) {
  return done([=] {
    c10::cuda::set_device(static_cast<c10::DeviceIndex>(device));
    auto stream = c10::cuda::getStreamFromPool(false, static_cast<c10::DeviceIndex>(device));
    c10::cuda::setCurrentCUDAStream(stream);
  });
}

// The stream in which this thread works on a device, for launches that follow at once.
bool paig_cuda_current_stream(int device, void **stream) {
  return done([=] {
    c10::cuda::set_device(static_cast<c10::DeviceIndex>(device));
    *stream = c10::cuda::getCurrentCUDAStream(static_cast<c10::DeviceIndex>(device)).stream();
  });
}

// Begins to record what is launched instead of doing it; null if that failed.
void *paig_graph_begin() {
  at::cuda::CUDAGraph *graph = nullptr;
  bool begun = done([&] {
    graph = new at::cuda::CUDAGraph();
    // Gradients are computed in another thread, and other threads may train other models.
    graph->capture_begin({0, 0}, cudaStreamCaptureModeThreadLocal);
  });
  if (!begun) delete graph;
  return begun ? graph : nullptr;
}

bool paig_graph_end(void *graph) {
  return done([=] { static_cast<at::cuda::CUDAGraph *>(graph)->capture_end(); });
}

bool paig_graph_replay(void *graph) {
  return done([=] { static_cast<at::cuda::CUDAGraph *>(graph)->replay(); });
}

void paig_graph_free(void *graph) {
  done([=] { delete static_cast<at::cuda::CUDAGraph *>(graph); });
}

#else

bool paig_cuda_built() { return false; }
bool paig_cuda_stream(int) { return true; }
bool paig_cuda_current_stream(int, void **) { return true; }

void *paig_graph_begin() {
  failure = "this program was built with a libtorch without CUDA";
  return nullptr;
}

bool paig_graph_end(void *) { return false; }
bool paig_graph_replay(void *) { return false; }
void paig_graph_free(void *) {}

#endif

}
