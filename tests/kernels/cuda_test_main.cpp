// SPDX-License-Identifier: Apache-2.0
// main() of the tests that need a CUDA device. Exit code 77: no device found.
#include <cuda_runtime_api.h>

#include <cstdio>

#include "catch_runner.h"

int main(int argc, char** argv) {
  int count = 0;
  if (const cudaError_t error = cudaGetDeviceCount(&count); error != cudaSuccess || count == 0) {
    std::printf("skipped: no CUDA device (%s)\n", cudaGetErrorString(error));
    return 77;
  }
  return stgs::testing::run_cases(argc, argv);
}
