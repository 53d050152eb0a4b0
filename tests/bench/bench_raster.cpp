// SPDX-License-Identifier: Apache-2.0
// Times of the CPU rasteriser's stages, forward and backward, on random but realistic scenes.
// Usage: bench_raster [repetitions] [threads]. Prints one JSON object; times are the least of the
// repetitions, in ms.
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "backend/cpu/blend_backward.h"
#include "backend/cpu/project_backward.h"
#include "raster_scene.h"
#include "stgs/format/raster.h"
#include "train/image_loss.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

template <typename Work>
double milliseconds(int repetitions, Work work) {
  std::vector<double> times;
  for (int i = 0; i < repetitions; ++i) {
    const auto start = std::chrono::steady_clock::now();
    work();
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
    times.push_back(took.count());
  }
  return *std::min_element(times.begin(), times.end());
}

struct Row {
  int width, height;
  std::size_t primitives;
};

void measure(const Row& row, int repetitions, bool first) {
  const auto camera = testing::scene_camera(row.width, row.height);
  // About five pixels of standard deviation at 640 wide, as in trained scenes of this many.
  testing::SceneShape shape;
  shape.log_scale_mean = -4.2f;
  const Gaussians4D set = testing::random_scene(row.primitives, camera, 1, shape);
  const RasterSettings settings;
  SplatFrame frame;
  RasterOutput output;
  const double slice_ms = milliseconds(repetitions, [&] {
    begin_frame(camera, frame);
    slice(set, 10.0f, camera, settings, 0, frame);
  });
  const double bin_ms = milliseconds(repetitions, [&] { bin(frame); });
  const double blend_ms = milliseconds(repetitions, [&] { blend(frame, settings, output); });

  Image d_colour = output.colour, error = output.alpha;
  cpu::BlendBackwardScratch scratch;
  std::vector<cpu::SplatGradients> splats;
  cpu::PrimitiveGradients gradients;
  Image8 truth{row.width, row.height, 3, {}};
  truth.data.resize(output.colour.data.size(), 128);
  ImageLoss loss;
  const double loss_ms =
      milliseconds(repetitions, [&] { loss.evaluate(output.colour, truth, {}, d_colour, error); });
  const double blend_backward_ms = milliseconds(repetitions, [&] {
    cpu::blend_backward(frame, settings, output, d_colour, &error, scratch, splats);
  });
  const double project_backward_ms = milliseconds(repetitions, [&] {
    cpu::project_backward(set, 10.0f, camera, settings, frame, splats, gradients);
    cpu::modulation_backward(set, set.velocity, frame, gradients);
  });
  const double forward = slice_ms + bin_ms + blend_ms;
  double drawn_radius = 0;
  for (const Splat& s : frame.splats) drawn_radius += s.extent.x + s.extent.y;
  std::printf(
      "%s\n    {\"width\": %d, \"height\": %d, \"primitives\": %zu, \"visible\": %zu, "
      "\"instances\": %zu, \"mean_extent_px\": %.1f,\n     \"slice_ms\": %.2f, \"bin_ms\": %.2f, "
      "\"blend_ms\": %.2f, \"forward_fps\": %.1f, \"blend_backward_ms\": %.2f, "
      "\"project_backward_ms\": %.2f, \"image_loss_ms\": %.2f, \"step_ms\": %.2f}",
      first ? "" : ",", row.width, row.height, row.primitives, frame.splats.size(),
      frame.instances.size(), drawn_radius / 2.0 / static_cast<double>(frame.splats.size()),
      slice_ms, bin_ms, blend_ms, 1000.0 / forward, blend_backward_ms, project_backward_ms, loss_ms,
      forward + loss_ms + blend_backward_ms + project_backward_ms);
}

}  // namespace

int main(int argc, char** argv) {
  const int repetitions = argc > 1 ? std::max(1, std::atoi(argv[1])) : 15;
  const int threads = argc > 2 ? std::max(1, std::atoi(argv[2])) : 2;
  tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                            static_cast<std::size_t>(threads));
  std::printf("{\"target\": \"%s\", \"threads\": %d, \"repetitions\": %d, \"runs\": [",
              vector_target().c_str(), threads, repetitions);
  bool first = true;
  for (const Row& row : {Row{640, 360, 28000}, Row{640, 360, 70000}, Row{480, 360, 28000},
                         Row{480, 360, 43000}, Row{480, 360, 70000}}) {
    measure(row, repetitions, first);
    first = false;
  }
  std::printf("\n  ]}\n");
  return 0;
}
