// SPDX-License-Identifier: Apache-2.0
// Live sessions of the C API with images in the memory of a CUDA device.
#include <thread>

#include "fixtures/cuda_device.h"
#include "sdk_live_fixture.h"

namespace stgs::testing {
namespace {

// A copy of pixels on the device.
struct DevicePixels {
  DeviceMemory memory;
  stgs_live_image image;

  explicit DevicePixels(const LivePixels& host) : memory(host.bytes.size()), image(host.image) {
    require_success(
        cudaMemcpy(memory.data, host.bytes.data(), memory.bytes, cudaMemcpyHostToDevice));
    image.data = memory.data;
    image.memory = STGS_MEMORY_CUDA;
  }
};

}  // namespace

TEST_CASE("images in device memory become a scene", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = filmed.start(filmed.settings());
  for (int frame = 0; frame < 8; ++frame) {
    for (std::size_t c = 0; c < filmed.cameras.size(); ++c) {
      const DevicePixels pixels(filmed.pixels(c, frame));
      REQUIRE(stgs_live_push(live.get(), filmed.calibration[c].name, frame / filmed.kFps,
                             &pixels.image) == STGS_OK);
    }
  }
  REQUIRE(stgs_live_finish(live.get(), nullptr) == STGS_OK);
  CHECK(report_of(live).dropped == 0);
  CHECK(psnr_of(filmed, open_path(filmed.recording), {1, 6}) > 19);
}

TEST_CASE("a push waits for the work in its stream", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = filmed.start(filmed.settings());
  const Stream stream;
  DevicePixels pixels(filmed.pixels(0, 0));
  pixels.image.stream = stream.handle;
  Gate gate(stream.handle);
  std::atomic<stgs_result> result = STGS_ERROR_RUNTIME;
  std::thread pushing(
      [&] { result = stgs_live_push(live.get(), filmed.calibration[0].name, 0, &pixels.image); });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  CHECK(report_of(live).images == 0);
  gate.release();
  pushing.join();
  CHECK(result == STGS_OK);
  CHECK(report_of(live).images == 1);
}

TEST_CASE("memory of the host is not taken for that of a device", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = filmed.start(filmed.settings());
  LivePixels pixels = filmed.pixels(0, 0);
  pixels.image.memory = STGS_MEMORY_CUDA;
  CHECK(stgs_live_push(live.get(), filmed.calibration[0].name, 0, &pixels.image) ==
        STGS_ERROR_ARGUMENT);
  CHECK_THAT(message_of(live), Catch::Contains("CUDA device"));
}

}  // namespace stgs::testing
