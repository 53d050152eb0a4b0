// SPDX-License-Identifier: Apache-2.0
// Compares renders of a scene with those of the reference rasteriser of "3D Gaussian Splatting"
// (Kerbl et al. 2023). Its licence forbids redistribution, so the user provides it: configure with
// -DSTGS_PEER_3DGS=FOLDER of graphdeco-inria/diff-gaussian-rasterization.
//
// usage: bench_peer_3dgs SCENE.stgs SECONDS CAMERA.json...     prints JSON; one view per camera
#include <cuda_rasterizer/rasterizer.h>
#include <cuda_runtime.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>
#include <vector>

#include "camera_file.h"
#include "session.h"
#include "stgs/encoder/metrics.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {
namespace {

constexpr int kRepeats = 20;

// Device memory that grows on demand.
class DeviceMemory {
 public:
  DeviceMemory() = default;
  DeviceMemory(const DeviceMemory&) = delete;
  DeviceMemory& operator=(const DeviceMemory&) = delete;
  ~DeviceMemory() { cudaFree(data_); }
  char* allocate(std::size_t bytes) {
    if (bytes <= bytes_) return data_;
    cudaFree(data_);
    data_ = nullptr;
    bytes_ = cudaMalloc(reinterpret_cast<void**>(&data_), bytes) == cudaSuccess ? bytes : 0;
    return data_;
  }
  const float* upload(std::span<const float> values) {
    char* const device = allocate(values.size() * sizeof(float));
    if (device != nullptr) {
      cudaMemcpy(device, values.data(), values.size() * sizeof(float), cudaMemcpyHostToDevice);
    }
    return reinterpret_cast<const float*>(device);
  }

 private:
  char* data_ = nullptr;
  std::size_t bytes_ = 0;
};

// The input of the peer: the primitives at one time, with activations applied.
struct StaticSet {
  std::vector<float> position, scale, rotation, opacity, sh;
  int degree = 0, coefficients = 0;

  StaticSet(const Gaussians4D& set, float ticks)
      : rotation(set.rotation.begin(), set.rotation.end()),
        sh(set.sh.begin(), set.sh.end()),
        degree(set.sh_degree),
        coefficients(set.sh_coefficients()) {
    const std::size_t n = set.size();
    position.resize(3 * n);
    scale.resize(3 * n);
    opacity.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const float dt = ticks - set.time[i];
      float square = 0;
      for (int c = 0; c < 4; ++c) square += rotation[4 * i + c] * rotation[4 * i + c];
      for (int c = 0; c < 4; ++c) rotation[4 * i + c] /= std::sqrt(square);
      for (int c = 0; c < 3; ++c) {
        position[3 * i + c] = set.position[3 * i + c] + set.velocity[3 * i + c] * dt;
        scale[3 * i + c] = std::exp(set.log_scale[3 * i + c]);
      }
      opacity[i] = math::opacity_of(set.opacity_logit[i]) *
                   math::visibility(dt, set.sigma[i], set.radius[i]);
    }
  }
};

class Peer {
 public:
  explicit Peer(const StaticSet& set)
      : n_(static_cast<int>(set.opacity.size())),
        degree_(set.degree),
        coefficients_(set.coefficients),
        position_(arrays_[0].upload(set.position)),
        scale_(arrays_[1].upload(set.scale)),
        rotation_(arrays_[2].upload(set.rotation)),
        opacity_(arrays_[3].upload(set.opacity)),
        sh_(arrays_[4].upload(set.sh)) {}

  // Renders an image; `ms` receives the median time.
  Result<Image> render(const math::PinholeCamera& camera, const float background[3], double& ms) {
    const math::Mat3& r = camera.rotation;
    const math::Vec3& t = camera.translation;
    // Column-major, as the peer expects.
    const std::vector<float> view = {r.xx, r.yx, r.zx, 0, r.xy, r.yy, r.zy, 0,
                                     r.xz, r.yz, r.zz, 0, t.x,  t.y,  t.z,  1};
    const float tan_x = 0.5f * camera.width / camera.fx, tan_y = 0.5f * camera.height / camera.fy;
    std::vector<float> clip(16);
    for (int column = 0; column < 4; ++column) {
      const float* const v = &view[4 * column];
      clip[4 * column] = v[0] / tan_x;
      clip[4 * column + 1] = v[1] / tan_y;
      clip[4 * column + 2] = clip[4 * column + 3] = v[2];
    }
    const std::vector<float> eye = {-(r.xx * t.x + r.yx * t.y + r.zx * t.z),
                                    -(r.xy * t.x + r.yy * t.y + r.zy * t.z),
                                    -(r.xz * t.x + r.yz * t.y + r.zz * t.z)};
    const float* const on_device[] = {inputs_[0].upload(view), inputs_[1].upload(clip),
                                      inputs_[2].upload(eye), inputs_[3].upload({background, 3})};
    Image image;
    image.reshape(static_cast<int>(camera.width), static_cast<int>(camera.height), 3);
    auto* const colour =
        reinterpret_cast<float*>(colour_.allocate(image.data.size() * sizeof(float)));
    const auto allocator = [](DeviceMemory& memory) {
      return [&memory](std::size_t bytes) { return memory.allocate(bytes); };
    };
    std::vector<double> times;
    for (int k = 0; k < kRepeats; ++k) {
      cudaDeviceSynchronize();
      const double start = now_seconds();
      CudaRasterizer::Rasterizer::forward(
          allocator(buffers_[0]), allocator(buffers_[1]), allocator(buffers_[2]), n_, degree_,
          coefficients_, on_device[3], image.width, image.height, position_, sh_, nullptr, opacity_,
          scale_, 1.0f, rotation_, nullptr, on_device[0], on_device[1], on_device[2], tan_x, tan_y,
          false, colour);
      cudaDeviceSynchronize();
      times.push_back(1000 * (now_seconds() - start));
    }
    std::nth_element(times.begin(), times.begin() + kRepeats / 2, times.end());
    ms = times[kRepeats / 2];
    cudaMemcpy(image.data.data(), colour, image.data.size() * sizeof(float),
               cudaMemcpyDeviceToHost);
    if (const cudaError_t error = cudaGetLastError(); error != cudaSuccess) {
      return runtime_error("the peer: {}", cudaGetErrorString(error));
    }
    return image;
  }

 private:
  int n_, degree_, coefficients_;
  DeviceMemory arrays_[5], inputs_[4], buffers_[3], colour_;
  const float *position_, *scale_, *rotation_, *opacity_, *sh_;
};

Status compare(const std::string& path, double seconds, int cameras, char** names) {
  STGS_ASSIGN(const Scene scene, read_scene(path));
  const SceneMetadata& metadata = scene.metadata;
  const auto ticks = static_cast<float>(metadata.time_base.ticks(seconds));
  Peer peer(StaticSet(scene.gaussians, ticks));
  STGS_ASSIGN(auto timeline, player::Timeline::open(path));
  STGS_ASSIGN(auto renderer, player::make_renderer("cuda"));
  Json views = Json::array();
  for (int k = 0; k < cameras; ++k) {
    STGS_ASSIGN(const encoder::Camera camera, read_camera(names[k]));
    const float* const b = metadata.background;
    const player::View view{camera.pinhole(metadata.near_plane), {b[0], b[1], b[2]}};
    if (camera.cx != 0.5 * camera.width || camera.cy != 0.5 * camera.height) {
      return usage_error("{}: the principal point is not the image centre, which the peer requires",
                         names[k]);
    }
    std::vector<player::Frame> frames;
    STGS_TRY(renderer->render(*timeline, seconds, {view}, frames, nullptr));
    double ms = 0;
    STGS_ASSIGN(const Image theirs, peer.render(view.camera, b, ms));
    const Image& ours = frames[0].colour;
    views.push_back({{"camera", names[k]},
                     {"psnr", encoder::psnr_of(encoder::mean_squared_error(ours, theirs))},
                     {"max_difference", encoder::max_difference(ours, theirs)},
                     {"peer_ms", ms}});
  }
  const Json json = {{"scene", path},
                     {"seconds", seconds},
                     {"primitives", scene.gaussians.size()},
                     {"renderer", renderer->name()},
                     {"views", views}};
  std::puts(json.dump(1).c_str());
  return {};
}

Status bench(int argc, char** argv) {
  if (argc < 4) return usage_error("usage: bench_peer_3dgs SCENE.stgs SECONDS CAMERA.json...");
  return compare(argv[1], std::strtod(argv[2], nullptr), argc - 3, argv + 3);
}

}  // namespace
}  // namespace stgs::tools

int main(int argc, char** argv) {
  const stgs::Status status = stgs::tools::bench(argc, argv);
  if (!status.ok()) std::fprintf(stderr, "bench_peer_3dgs: %s\n", status.message().c_str());
  return static_cast<int>(status.code());
}
