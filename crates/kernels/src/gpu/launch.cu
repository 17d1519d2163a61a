// What was compiled, and why a launch failed.

#include "device.h"

extern "C" const char *paig_gpu_launch_failure() {
#ifdef __CUDACC__
  cudaError_t error = cudaGetLastError();
  return error == cudaSuccess ? nullptr : cudaGetErrorString(error);
#else
  return nullptr;
#endif
}

// Whether kernels were compiled for GPUs.
extern "C" bool paig_gpu_compiled() {
#ifdef __CUDACC__
  return true;
#else
  return false;
#endif
}

// Whether they were compiled for this one: copies into shared memory that go on beside the arithmetic came with version 8.
extern "C" bool paig_gpu_suits(int device) {
#ifdef __CUDACC__
  int version = 0;
  return cudaDeviceGetAttribute(&version, cudaDevAttrComputeCapabilityMajor, device) == cudaSuccess && version >= 8;
#else
  static_cast<void>(device);
  return false;
#endif
}
