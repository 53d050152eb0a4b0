// SPDX-License-Identifier: Apache-2.0
// Compares frames that a GPU converts, undistorts and scales with the CPU.
#include <cuda_runtime_api.h>

#include <opencv2/imgproc.hpp>
#include <thread>

#include "capture/camera_plan.h"
#include "video_cases.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

// A camera of 320x180 pixels, with lens distortion or without.
CameraPlan plan_of(cv::Size size, bool has_lens, double scale) {
  SourceCamera camera;
  camera.name = "a";
  camera.fx = camera.fy = 250;
  camera.cx = 0.5 * size.width + 1;
  camera.cy = 0.5 * size.height - 2;
  if (has_lens) {
    camera.lens = LensModel::kOpenCv;
    camera.distortion = {-0.3, 0.1, 0.002, -0.004};
  }
  const auto plan = plan_camera(camera, {size.width, size.height, 1, 30}, scale);
  REQUIRE(plan.ok());
  return *plan;
}

MappingDevice gpu_device() {
  auto made = geometry::make_cuda_frame_warper(0);
  INFO(made.status().message());
  REQUIRE(made.ok());
  return {std::move(*made), true, {}};
}

struct Warp {
  bool has_lens;
  double scale;
};
const Warp kWarps[] = {{false, 1}, {true, 1}, {false, 0.5}, {true, 0.5}, {true, 0.7}};

// Scaled values are sums of floats.
double tolerance(const Warp& warp) {
  return warp.scale < 1 ? 1 : 0;
}

}  // namespace

TEST_CASE("frames that a GPU converts and undistorts are those of the CPU") {
  const TemporaryFolder folder;
  const MappingDevice gpu = gpu_device();
  for (const Case& video :
       {Case{"a.mp4", {.frames = 3}}, Case{"b.mp4", {.frames = 3, .rotation = 90}},
        Case{"c.mp4", {.frames = 3, .rotation = 180}},
        Case{"d.mp4", {.frames = 3, .rotation = 270}}, Case{"e.mp4", {.height = 182, .frames = 3}},
        Case{"f.mp4", {.frames = 3, .full_range = true}},
        Case{"g.mp4", {.format = "yuvj420p", .frames = 3}},
        Case{"h.mp4", {.frames = 3, .filter = "h264_metadata=crop_left=64:crop_top=8"}},
        Case{"i.mp4",
             {.encoder = "libx265",
             .format = "yuv420p10le",
             .frames = 3,
             .options = "x265-params=log-level=none"}},
        Case{"j.mp4", {.format = "yuv422p", .frames = 3}}}) {
    const std::string path = folder / video.name;
    if (!write_case(path, video.spec)) continue;
    for (const VideoDecoding& decoding : {VideoDecoding(), on_gpu()}) {
      for (const Warp& warp : kWarps) {
        INFO(video.name << ", NVDEC " << (decoding.device != nullptr) << ", lens " << warp.has_lens
                        << ", scale " << warp.scale);
        const auto decoder = opened(path, decoding), reference = opened(path, {});
        REQUIRE(decoder.ok());
        REQUIRE(reference.ok());
        for (int f = 0; f < video.spec.frames; ++f) {
          REQUIRE((*decoder)->advance().ok());
          REQUIRE((*reference)->advance().ok());
          const CameraPlan plan = plan_of((*decoder)->size(), warp.has_lens, warp.scale);
          const auto mapping = FrameMapping::make(plan, gpu);
          REQUIRE(mapping.ok());
          const auto found = mapped_frame(**decoder, **mapping);
          INFO(found.status().message());
          REQUIRE(found.ok());
          const auto expected = mapped_frame(**reference, FrameMapping(plan));
          REQUIRE(expected.ok());
          REQUIRE(found->size() == expected->size());
          CHECK(cv::norm(*found, *expected, cv::NORM_INF) <= tolerance(warp));
        }
      }
    }
  }
}

TEST_CASE("images that a GPU undistorts are those of the CPU, also several at a time") {
  const MappingDevice gpu = gpu_device();
  cv::Mat image(180, 320, CV_8UC4);
  cv::RNG random(3);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  cv::Mat colours;
  cv::cvtColor(image, colours, cv::COLOR_BGRA2BGR);
  for (const Warp& warp : kWarps) {
    INFO("lens " << warp.has_lens << ", scale " << warp.scale);
    const CameraPlan plan = plan_of(image.size(), warp.has_lens, warp.scale);
    const auto mapping = FrameMapping::make(plan, gpu);
    REQUIRE(mapping.ok());
    const auto expected = FrameMapping(plan).frame(colours);
    REQUIRE(expected.ok());
    std::vector<Result<cv::Mat>> found(20, Status(StatusCode::kRuntime, "not run"));
    std::vector<std::thread> threads;
    for (std::size_t k = 0; k < found.size(); ++k) {
      const bool has_alpha = k % 2 == 1 && !plan.is_identity();
      threads.emplace_back(
          [&, k, has_alpha] { found[k] = (*mapping)->frame(has_alpha ? image : colours); });
    }
    for (std::thread& thread : threads) thread.join();
    for (const auto& one : found) {
      INFO(one.status().message());
      REQUIRE(one.ok());
      CHECK(cv::norm(*one, *expected, cv::NORM_INF) <= tolerance(warp));
    }
  }
}

TEST_CASE("cameras beyond the memory of a GPU are changed by the CPU, or refused") {
  std::size_t free = 0, total = 0;
  REQUIRE(cudaMemGetInfo(&free, &total) == cudaSuccess);
  constexpr std::size_t kLeft = std::size_t{1} << 30;
  void* taken = nullptr;
  REQUIRE(cudaMalloc(&taken, free - kLeft) == cudaSuccess);
  MappingDevice gpu = gpu_device();
  REQUIRE(cudaFree(taken) == cudaSuccess);
  std::vector<std::string> lines;
  gpu.log = [&](int, const std::string& line) { lines.push_back(line); };
  const CameraPlan large = plan_of({6000, 6000}, true, 1), small = plan_of({320, 180}, true, 1);
  const Status refused = FrameMapping::make(large, gpu).status();
  INFO(refused.message());
  CHECK(refused.code() == StatusCode::kNoMemory);
  CHECK(refused.message().find("use --backend cpu") != std::string::npos);
  gpu.required = false;
  const auto changed = FrameMapping::make(large, gpu);
  REQUIRE(changed.ok());
  CHECK(!(*changed)->is_on_gpu());
  REQUIRE(lines.size() == 1);
  CHECK(lines[0].find("camera 'a'") == 0);
  for (int i = 0; i < 2000; ++i) {  // the tables of earlier ones are released
    const auto mapping = FrameMapping::make(small, gpu);
    REQUIRE(mapping.ok());
    REQUIRE((*mapping)->is_on_gpu());
  }
}
