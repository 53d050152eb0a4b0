// SPDX-License-Identifier: Apache-2.0
// Images are copied from a CUDA device row by row, in the order of a stream.
#include <algorithm>
#include <vector>

#include "fixtures/cuda_device.h"
#include "stgs/encoder/device_image.h"

using namespace stgs;
using namespace stgs::testing;

TEST_CASE("rows are copied from a device without their padding, after the work of the stream") {
  constexpr std::size_t kRowBytes = 90, kStride = 128, kRows = 20;
  const DeviceMemory memory(kStride * kRows);
  std::vector<std::uint8_t> given(memory.bytes);
  for (std::size_t i = 0; i < given.size(); ++i) given[i] = static_cast<std::uint8_t>(i * 7);
  const Stream stream;
  require_success(cudaMemcpyAsync(memory.data, given.data(), given.size(), cudaMemcpyHostToDevice,
                                  stream.handle));
  std::vector<std::uint8_t> out(kRowBytes * kRows);
  const Status status = encoder::copy_from_device(
      {memory.data, kStride, kRowBytes, kRows, stream.handle}, out.data());
  INFO(status.message());
  REQUIRE(status.ok());
  for (std::size_t y = 0; y < kRows; ++y)
    CHECK(std::equal(out.begin() + y * kRowBytes, out.begin() + (y + 1) * kRowBytes,
                     given.begin() + y * kStride));
}

TEST_CASE("memory of the host is not copied as that of a device") {
  std::vector<std::uint8_t> pixels(300), out(300);
  CHECK(encoder::copy_from_device({pixels.data(), 30, 30, 10, nullptr}, out.data()).code() ==
        StatusCode::kUsage);
}
