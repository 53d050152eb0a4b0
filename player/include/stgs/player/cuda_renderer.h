// SPDX-License-Identifier: Apache-2.0
// Renders with CUDA, into device memory of the caller.
#pragma once

#include <cstddef>
#include <vector>

#include "stgs/player/renderer.h"

struct CUstream_st;  // of CUDA; cudaStream_t points to it

namespace stgs::player {

// Rows of pixels in CUDA device memory.
struct CudaPlane {
  void* data = nullptr;    // null: not written
  std::size_t stride = 0;  // bytes from row to row
};
// Output of one view in CUDA device memory. All strides and addresses are multiples of 4.
struct CudaImage {
  CudaPlane rgba8;      // 4 bytes per pixel: colour and alpha
  CudaPlane planes[5];  // floats: red, green, blue, alpha, depth
};

// The renderer that make_renderer("cuda") creates, as every renderer used by one thread at a time.
class CudaRenderer : public Renderer {
 public:
  // Copies the images of the last successful draw() to CUDA device memory, one element of `to` per
  // view. The copies are enqueued on `stream` (cudaStream_t; null: the default stream) and not
  // waited for; the next draw() and the destructor wait. kUsage if `to` does not have one element
  // per view or nothing has been drawn.
  virtual Status read_cuda(const std::vector<CudaImage>& to, CUstream_st* stream) = 0;
};

}  // namespace stgs::player
