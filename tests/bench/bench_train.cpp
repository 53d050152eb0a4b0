// SPDX-License-Identifier: Apache-2.0
// Trains a prepared capture and measures what it costs and what it gives on the held-out cameras.
// Usage: bench_train DIR [preset=fast] [iterations=N] [max_seconds=S] [ablate=NAMES] [seed=N]
//                    [hyper-parameter=value ...]
// Prints one JSON object: seconds, steps a second, primitives, loss, PSNR of
// every held-out camera (mean over its frames), peak memory.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>

#include "stgs/encoder/metrics.h"
#include "stgs/encoder/train.h"
#include "stgs/format/raster.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

double psnr(Image& shown, const Image8& truth) {
  for (float& v : shown.data) v = std::fmin(1.0f, std::fmax(0.0f, v));
  return psnr_of(mean_squared_error(shown, to_float(truth)));
}

bool set_option(const std::string& name, const std::string& value, TrainSettings& settings) {
  if (name == "preset") {
    settings.preset = value;
  } else if (name == "iterations") {
    settings.iterations = std::stoi(value);
  } else if (name == "max_seconds") {
    settings.max_seconds = std::stod(value);
  } else if (name == "max_primitives") {
    settings.max_primitives = std::stoi(value);
  } else if (name == "seed") {
    settings.seed = std::stoull(value);
  } else if (name == "ablate") {
    settings.ablate = value;
  } else {
    settings.overrides.emplace_back(name, value);
  }
  return !value.empty();
}

int fail(const Status& status) {
  std::fprintf(stderr, "bench_train: %s\n", status.message().c_str());
  return static_cast<int>(status.code());
}

void print_held_out(const PreparedCapture& capture, const Scene& scene) {
  SplatFrame frame;
  RasterOutput output;
  double sum = 0;
  int views = 0;
  for (const Camera& camera : capture.cameras) {
    if (!camera.test) continue;
    double camera_sum = 0;
    for (int f = 0; f < capture.frames; ++f) {
      const Result<Image8> truth = load_frame(capture, camera, f);
      if (!truth.ok()) continue;
      render(scene.gaussians, static_cast<float>(f), camera.pinhole(capture.near_plane), {}, frame,
             output);
      camera_sum += psnr(output.colour, *truth);
    }
    std::printf("\"psnr_%s\": %.3f, ", camera.name.c_str(), camera_sum / capture.frames);
    sum += camera_sum;
    views += capture.frames;
  }
  if (views > 0) std::printf("\"psnr\": %.3f, ", sum / views);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fputs("usage: bench_train DIR [name=value ...]\n", stderr);
    return 1;
  }
  TrainSettings settings;
  for (int i = 2; i < argc; ++i) {
    const char* equals = std::strchr(argv[i], '=');
    if (equals == nullptr ||
        !set_option(std::string(argv[i], static_cast<std::size_t>(equals - argv[i])), equals + 1,
                    settings)) {
      std::fprintf(stderr, "bench_train: '%s' is not name=value\n", argv[i]);
      return 1;
    }
  }
  const Result<PreparedCapture> capture = read_prepared_capture(argv[1]);
  if (!capture.ok()) return fail(capture.status());
  TrainReport report;
  const Result<Scene> scene = train(*capture, settings, nullptr, nullptr, &report);
  if (!scene.ok()) return fail(scene.status());
  std::printf("{\"iterations\": %d, \"seconds\": %.2f, \"ms_a_step\": %.2f, \"primitives\": %zu, ",
              report.iterations, report.seconds, 1e3 * report.seconds / report.iterations,
              report.primitives);
  print_held_out(*capture, *scene);
  std::printf("\"loss\": %.5f, \"peak_memory_mib\": %.0f}\n", report.final_loss,
              static_cast<double>(report.peak_memory) / (1 << 20));
  return 0;
}
