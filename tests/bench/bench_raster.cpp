// SPDX-License-Identifier: Apache-2.0
// Prints the times of the stages of the CPU rasteriser, forward and backward, on random but
// realistic scenes, as JSON. Each stage is [elapsed ms, CPU ms of all threads], the minimum of the
// repetitions. The CPU time hardly depends on other programs.
//
// usage: bench_raster [REPETITIONS [THREADS]]

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "../fixtures/loop_threads.h"
#include "backend/cpu/blend_backward.h"
#include "backend/cpu/project_backward.h"
#include "raster_scene.h"
#include "stgs/format/raster.h"
#include "train/image_loss.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

struct Time {
  double elapsed = 1e30, cpu = 1e30;  // ms
};

template <typename Work>
Time measure_stage(int repetitions, Work work) {
  Time best;
  for (int i = 0; i < repetitions; ++i) {
    const auto start = std::chrono::steady_clock::now();
    const std::clock_t start_cpu = std::clock();
    work();
    const double cpu = 1000.0 * static_cast<double>(std::clock() - start_cpu) /
                       static_cast<double>(CLOCKS_PER_SEC);
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
    best.elapsed = std::min(best.elapsed, took.count());
    best.cpu = std::min(best.cpu, cpu);
  }
  return best;
}

struct Row {
  int width, height;
  std::size_t primitives;
};

void measure(const Row& row, int repetitions, bool first) {
  const auto camera = testing::scene_camera(row.width, row.height);
  // Standard deviations of about five pixels at a width of 640, as in trained scenes of this size.
  testing::SceneShape shape;
  shape.log_scale_mean = -4.2f;
  const Gaussians4D set = testing::random_scene(row.primitives, camera, 1, shape);
  const RasterSettings settings;
  SplatFrame frame;
  RasterOutput output;
  const Time slice_time = measure_stage(repetitions, [&] {
    begin_frame(camera, frame);
    slice(set, 10.0f, camera, settings, 0, frame);
  });
  const Time bin_time = measure_stage(repetitions, [&] { bin(frame); });
  const Time blend_time = measure_stage(repetitions, [&] { blend(frame, settings, output); });

  Image d_colour = output.colour, error = output.alpha;
  cpu::BlendBackwardScratch scratch;
  std::vector<cpu::SplatGradients> splats;
  cpu::PrimitiveGradients gradients;
  Image8 ground_truth{row.width, row.height, 3, {}};
  ground_truth.data.resize(output.colour.data.size(), 128);
  ImageLoss loss;
  const Time loss_time = measure_stage(
      repetitions, [&] { loss.evaluate(output.colour, ground_truth, {}, d_colour, error); });
  const Time blend_backward_time = measure_stage(repetitions, [&] {
    cpu::blend_backward(frame, settings, output, d_colour, &error, scratch, splats);
  });
  const Time project_backward_time = measure_stage(repetitions, [&] {
    cpu::project_backward(set, 10.0f, camera, settings, frame, splats, gradients);
    cpu::modulation_backward(set, frame, gradients);
  });
  double extent = 0;
  for (const Splat& s : frame.splats) extent += (s.extent.x + s.extent.y) / 2.0;
  std::printf(
      "%s\n    {\"width\": %d, \"height\": %d, \"primitives\": %zu, \"visible\": %zu, "
      "\"instances\": %zu, \"mean_extent_px\": %.1f",
      first ? "" : ",", row.width, row.height, row.primitives, frame.splats.size(),
      frame.instances.size(), extent / static_cast<double>(frame.splats.size()));
  Time forward{0, 0}, step{0, 0};
  const auto print = [](const char* name, Time t) {
    std::printf(", \"%s\": [%.2f, %.2f]", name, t.elapsed, t.cpu);
  };
  const auto stage = [&](const char* name, Time t, bool in_forward) {
    print(name, t);
    step.elapsed += t.elapsed;
    step.cpu += t.cpu;
    if (in_forward) forward = step;
  };
  stage("slice", slice_time, true);
  stage("bin", bin_time, true);
  stage("blend", blend_time, true);
  stage("image_loss", loss_time, false);
  stage("blend_backward", blend_backward_time, false);
  stage("project_backward", project_backward_time, false);
  print("forward", forward);
  print("step", step);
  std::printf("}");
}

}  // namespace

int main(int argc, char** argv) {
  const int repetitions = argc > 1 ? std::max(1, std::atoi(argv[1])) : 15;
  const int threads = argc > 2 ? std::max(1, std::atoi(argv[2])) : 2;
  const testing::LoopThreads limit(threads);
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
