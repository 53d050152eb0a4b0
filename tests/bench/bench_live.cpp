// SPDX-License-Identifier: Apache-2.0
// Encodes the training cameras of a prepared capture live: pushes its frames at their rate, played
// back and forth, and prints a line of JSON per window and one for the run.
// usage: bench_live PREPARED RIG.json OUT.stgs SECONDS PRESET [LATENCY [KEY=VALUE ...]]
//   RIG.json  the cameras of the prepared frames, in the format of cameras.json, without sources
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

#include "stgs/encoder/live_encoder.h"
#include "stgs/format/parallel.h"
#include "stgs/format/temporary.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Frame of the capture that is played at frame n.
int played(int n, int frames) {
  const int period = std::max(1, 2 * frames - 2);
  const int k = n % period;
  return k < frames ? k : period - k;
}

// Resident memory of the process, bytes.
double resident() {
  std::ifstream file("/proc/self/statm");
  double pages = 0;
  file >> pages >> pages;
  return 4096 * pages;
}

void print(const LiveWindow& w) {
  std::printf(
      "{\"first_frame\": %d, \"frames\": %d, \"missing\": %llu, \"interval\": %d, \"iterations\": "
      "%d, \"prepare\": %.3f, \"train\": %.3f, \"steps\": %.3f, \"latency\": %.3f, \"waiting\": "
      "%d, \"primitives\": "
      "%llu, \"persistent\": %llu, \"bytes\": %llu, \"loss\": %.4f, \"written\": %d, \"memory\": "
      "%.0f}\n",
      w.first_frame, w.frames, static_cast<unsigned long long>(w.missing), w.point_interval,
      w.iterations, w.prepare_seconds, w.train_seconds, w.step_seconds, w.latency, w.waiting,
      static_cast<unsigned long long>(w.primitives), static_cast<unsigned long long>(w.persistent),
      static_cast<unsigned long long>(w.bytes), w.loss, w.written ? 1 : 0, resident());
  std::fflush(stdout);
}

Result<std::vector<std::vector<Image8>>> load_frames(const PreparedCapture& capture,
                                                     const std::vector<LiveCamera>& cameras) {
  std::vector<std::vector<Image8>> frames(cameras.size());
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const auto found = std::find_if(capture.cameras.begin(), capture.cameras.end(),
                                    [&](const Camera& k) { return k.name == cameras[c].name; });
    if (found == capture.cameras.end())
      return usage_error("camera '{}' is not in {}", cameras[c].name, capture.folder);
    frames[c].resize(static_cast<std::size_t>(capture.frames));
    Status failed;
    parallel_for(0, capture.frames, [&](int f) {
      Result<Image8> image = load_frame(capture, *found, f);
      if (image.ok())
        frames[c][static_cast<std::size_t>(f)] = std::move(*image);
      else
        failed = image.status();
    });
    STGS_TRY(failed);
  }
  return frames;
}

Status run(int argc, char** argv) {
  const std::string output = argv[3];
  const double seconds = std::atof(argv[4]);
  LiveSettings settings;
  settings.stream.train.preset = argv[5];
  settings.stream.recording = output;
  if (argc > 6) settings.latency = std::atof(argv[6]);
  for (int i = 7; i < argc; ++i) {
    const std::string set = argv[i];
    const std::size_t at = set.find('=');
    if (set.substr(0, at) == "first_seconds")
      settings.first_seconds = std::atof(set.c_str() + at + 1);
    else
      settings.stream.train.overrides.emplace_back(set.substr(0, at), set.substr(at + 1));
  }
  const LogSink log = [](int level, const std::string& line) {
    if (level <= (std::getenv("STGS_BENCH_VERBOSE") != nullptr ? 3 : 1))
      std::fprintf(stderr, "%s\n", line.c_str());
  };
  STGS_ASSIGN(const PreparedCapture capture, read_prepared_capture(argv[1]));
  PrepareSettings prepare;
  prepare.trust_calibration = true;
  STGS_ASSIGN(const auto preparer,
              LivePreparer::open(argv[2], prepare, 1 / capture.time_base.seconds(1), log));
  STGS_ASSIGN(const auto frames, load_frames(capture, preparer->cameras()));
  WorkFolder folder;
  STGS_TRY(folder.create(output));
  const std::string work = folder.path() + "/live";
  std::filesystem::create_directory(work);
  STGS_ASSIGN(const auto live, LiveEncoder::open(*preparer, work, settings, print, log));
  const double begin = now(), fps = preparer->fps();
  for (int n = 0; n < seconds * fps && !live->ended(); ++n) {
    std::this_thread::sleep_for(std::chrono::duration<double>(begin + n / fps - now()));
    const auto f = static_cast<std::size_t>(played(n, capture.frames));
    for (std::size_t c = 0; c < frames.size(); ++c) {
      const Image8& image = frames[c][f];
      STGS_ASSIGN(Image8 converted, preparer->convert(c, {image.data.data(), image.width,
                                                          image.height, 3u * image.width, false}));
      live->push(c, n / fps, std::move(converted));
    }
  }
  STGS_TRY(live->finish(output));
  const LiveReport r = live->report();
  std::printf(
      "{\"frames\": %d, \"windows\": %d, \"dropped\": %llu, \"missing\": %llu, \"lost\": %d, "
      "\"latency_median\": %.3f, \"latency_p95\": %.3f, \"latency_max\": %.3f, \"bytes\": %llu, "
      "\"mbit_per_s\": %.3f}\n",
      r.frames, r.windows, static_cast<unsigned long long>(r.dropped),
      static_cast<unsigned long long>(r.missing), r.lost_frames, r.latency_median, r.latency_p95,
      r.latency_max, static_cast<unsigned long long>(r.bytes),
      8e-6 * static_cast<double>(r.bytes) * fps / r.frames);
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 6) {
    std::fprintf(stderr,
                 "usage: bench_live PREPARED RIG.json OUT.stgs SECONDS PRESET [LATENCY [KEY=VALUE "
                 "...]]\n");
    return 2;
  }
  const Status status = run(argc, argv);
  if (status.ok()) return 0;
  std::fprintf(stderr, "%s\n", status.message().c_str());
  return 1;
}
