// SPDX-License-Identifier: Apache-2.0
// Prints how long the frames of a capture take from its files to memory: decoding, conversion,
// undistortion and scaling, on the CPU and on CUDA.
// usage: bench_frames CAPTURE [SCALE]    Exit code 0; 1: an error.
#include <sys/resource.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <string>

#include "capture/write_frames.h"
#include "geometry/view_matcher.h"
#include "stgs/encoder/frame_memory.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

const LogSink kPrint = [](int, const std::string& line) { std::printf("  %s\n", line.c_str()); };

double wall_seconds() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(now).count();
}

double core_seconds() {
  rusage used{};
  ::getrusage(RUSAGE_SELF, &used);
  return double(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
         1e-6 * double(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
}

// Writes all frames to memory, and prints the time.
Status measure(const SourceCapture& source, PrepareSettings settings, const char* decoder,
               const char* backend) {
  settings.video_decoder = decoder;
  settings.backend = backend;
  PreparedCapture prepared;
  STGS_ASSIGN(const auto plans, plan_frames(source, settings, prepared, kPrint));
  prepared.memory = std::make_shared<FrameMemory>();
  prepared.memory_only = true;
  OpenVideos videos;
  STGS_ASSIGN(videos.decoding, choose_video_decoding(settings, kEndless, kPrint));
  STGS_ASSIGN(videos.mapping_device, choose_mapping_device(settings, kPrint));
  const double wall = wall_seconds(), core = core_seconds();
  STGS_TRY(write_frames(source, plans, prepared, videos, {}));
  std::printf("decoder %s, backend %s: %.2f s, %.2f core seconds\n", decoder, backend,
              wall_seconds() - wall, core_seconds() - core);
  log_decoders(source, videos, kPrint);
  return {};
}

Status run(const std::string& folder, double scale) {
  cv::setNumThreads(1);  // as in prepare()
  PrepareSettings settings;
  settings.scale = scale;
  STGS_ASSIGN(const SourceCapture source, load_source(folder, settings, {}, kPrint));
  for (const char* backend : {"cpu", "cuda"})
    for (const char* decoder : {"cpu", "cuda"})
      STGS_TRY(measure(source, settings, decoder, backend));
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 1;
  const Status status = run(argv[1], argc > 2 ? std::atof(argv[2]) : 1);
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.message().c_str());
  return status.ok() ? 0 : 1;
}
