// SPDX-License-Identifier: Apache-2.0
// Encodes live: pushes frames from memory at their rate, each camera from a thread of its own, and
// prints a line of JSON per window and one for the run.
// usage: bench_live PREPARED RIG.json OUT.stgs SECONDS PRESET [LATENCY [KEY=VALUE ...]]
//        bench_live room CAMERASxWIDTHxHEIGHT@FPS OUT.stgs SECONDS PRESET [LATENCY [KEY=VALUE ...]]
//   PREPARED  a prepared capture, whose training cameras are played back and forth
//   RIG.json  its cameras, in the format of cameras.json, without sources
//   room      a synthetic room in which motion never repeats, and whose file is compared with a
//             test camera at the end; its frames are rendered before the start: 20 s of 12 cameras
//             of 1920x1080 at 30 fps take 45 GB
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

#include "live_frames.h"
#include "stgs/encoder/live_encoder.h"
#include "stgs/format/temporary.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
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
      "{\"first_frame\": %d, \"frames\": %d, \"missing\": %llu, \"scale\": %g, \"interval\": %d, "
      "\"iterations\": "
      "%d, \"prepare\": %.3f, \"train\": %.3f, \"steps\": %.3f, \"latency\": %.3f, \"waiting\": "
      "%d, \"primitives\": "
      "%llu, \"persistent\": %llu, \"bytes\": %llu, \"loss\": %.4f, \"psnr\": %.2f, \"written\": "
      "%d, \"memory\": "
      "%.0f}\n",
      w.first_frame, w.frames, static_cast<unsigned long long>(w.missing), w.scale,
      w.point_interval, w.iterations, w.prepare_seconds, w.train_seconds, w.step_seconds, w.latency,
      w.waiting, static_cast<unsigned long long>(w.primitives),
      static_cast<unsigned long long>(w.persistent), static_cast<unsigned long long>(w.bytes),
      w.loss, w.psnr, w.written ? 1 : 0, resident());
  std::fflush(stdout);
}

// The arguments after PRESET.
void set_options(int argc, char** argv, LiveSettings& settings) {
  if (argc > 6) settings.latency = std::atof(argv[6]);
  for (int i = 7; i < argc; ++i) {
    const std::string set = argv[i];
    const std::size_t at = set.find('=');
    if (set.substr(0, at) == "first_seconds")
      settings.first_seconds = std::atof(set.c_str() + at + 1);
    else
      settings.stream.train.overrides.emplace_back(set.substr(0, at), set.substr(at + 1));
  }
}

// Films for some seconds, or until encoding ends.
Status film(bench::LiveFrames& frames, double seconds, LiveEncoder& live) {
  LivePreparer& preparer = frames.preparer();
  const std::size_t cameras = preparer.cameras().size();
  const double begin = now(), fps = preparer.fps();
  std::vector<Status> filmed(cameras);
  std::vector<std::thread> threads;
  for (std::size_t c = 0; c < cameras; ++c) {
    threads.emplace_back([&, c] {
      for (int n = 0; n < seconds * fps && !live.ended() && filmed[c].ok(); ++n) {
        std::this_thread::sleep_for(std::chrono::duration<double>(begin + n / fps - now()));
        const Image8& image = frames.frame(c, n);
        Result<Image8> converted = preparer.convert(
            c, {image.data.data(), image.width, image.height, 3u * image.width, false});
        filmed[c] = converted.status();
        if (converted.ok()) live.push(c, n / fps, std::move(*converted));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const Status& status : filmed) STGS_TRY(status);
  return {};
}

void print(const LiveReport& r, double fps, const std::vector<double>& psnr) {
  std::printf(
      "{\"frames\": %d, \"windows\": %d, \"dropped\": %llu, \"missing\": %llu, \"lost\": %d, "
      "\"latency_median\": %.3f, \"latency_p95\": %.3f, \"latency_max\": %.3f, \"bytes\": %llu, "
      "\"mbit_per_s\": %.3f, \"psnr\": [",
      r.frames, r.windows, static_cast<unsigned long long>(r.dropped),
      static_cast<unsigned long long>(r.missing), r.lost_frames, r.latency_median, r.latency_p95,
      r.latency_max, static_cast<unsigned long long>(r.bytes),
      8e-6 * static_cast<double>(r.bytes) * fps / r.frames);
  for (std::size_t i = 0; i < psnr.size(); ++i) std::printf("%s%.2f", i == 0 ? "" : ", ", psnr[i]);
  std::printf("]}\n");
}

Status run(int argc, char** argv) {
  const std::string source = argv[1], output = argv[3];
  const double seconds = std::atof(argv[4]);
  LiveSettings settings;
  settings.stream.train.preset = argv[5];
  settings.stream.recording = output;
  set_options(argc, argv, settings);
  const LogSink log = [](int level, const std::string& line) {
    if (level <= (std::getenv("STGS_BENCH_VERBOSE") != nullptr ? 3 : 1))
      std::fprintf(stderr, "%s\n", line.c_str());
  };
  STGS_ASSIGN(const auto frames, source == "room"
                                     ? bench::render_room_frames(argv[2], seconds)
                                     : bench::open_captured_frames(source, argv[2], log));
  WorkFolder folder;
  STGS_TRY(folder.create(output));
  const std::string work = folder.path() + "/live";
  std::filesystem::create_directory(work);
  LivePreparer& preparer = frames->preparer();
  STGS_ASSIGN(const auto live,
              LiveEncoder::open(
                  preparer, work, settings, [](const LiveWindow& window) { print(window); }, log));
  STGS_TRY(film(*frames, seconds, *live));
  STGS_TRY(live->finish(output));
  const LiveReport report = live->report();
  STGS_ASSIGN(const std::vector<double> psnr, frames->psnr(output, report.frames));
  print(report, preparer.fps(), psnr);
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 6) {
    std::fprintf(stderr,
                 "usage: bench_live PREPARED RIG.json OUT.stgs SECONDS PRESET [LATENCY [KEY=VALUE "
                 "...]]\n"
                 "       bench_live room CAMERASxWIDTHxHEIGHT@FPS OUT.stgs SECONDS PRESET [LATENCY "
                 "[KEY=VALUE ...]]\n");
    return 2;
  }
  const Status status = run(argc, argv);
  if (status.ok()) return 0;
  std::fprintf(stderr, "%s\n", status.message().c_str());
  return 1;
}
