// SPDX-License-Identifier: Apache-2.0
// Encodes a prepared capture in windows that share a persistent set, as 'stgs encode --window' does
// after it has prepared them. Prints a line per window and one for the file, as JSON.
// usage: bench_windows PREPARED OUT.stgs FRAMES PRESET [LATER_SHARE [KEY=VALUE ...]]
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "stgs/encoder/stream_encoder.h"
#include "stgs/encoder/windows.h"
#include "stgs/format/temporary.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

Status encode(const std::string& prepared, const std::string& output, int length,
              const StreamSettings& settings) {
  STGS_ASSIGN(const PreparedCapture capture, read_prepared_capture(prepared));
  WorkFolder folder;
  STGS_TRY(folder.create(output));
  const std::string work = folder.path() + "/windows";
  std::filesystem::create_directory(work);
  const double begin = now();
  STGS_ASSIGN(const auto encoder, StreamEncoder::open(work, settings));
  for (int first = 0; first < capture.frames; first += length) {
    const FrameSpan span = {first, std::min(first + length, capture.frames)};
    STGS_ASSIGN(const PreparedCapture window, extract_window(capture, span));
    const double start = now();
    STGS_ASSIGN(const StreamWindow out, encoder->encode(window, {}, {}));
    std::printf(
        "{\"first_frame\": %d, \"frames\": %d, \"iterations\": %d, \"seconds\": %.3f, \"steps\": "
        "%.3f, \"primitives\": %llu, \"persistent\": %llu, \"bytes\": %llu}\n",
        out.first_frame, out.frames, out.training.iterations, now() - start, out.training.seconds,
        static_cast<unsigned long long>(out.primitives),
        static_cast<unsigned long long>(out.persistent),
        static_cast<unsigned long long>(out.bytes));
  }
  STGS_TRY(encoder->finish(output));
  std::printf("{\"seconds\": %.3f, \"bytes\": %llu}\n", now() - begin,
              static_cast<unsigned long long>(std::filesystem::file_size(output)));
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 5) {
    std::fprintf(stderr,
                 "usage: bench_windows PREPARED OUT.stgs FRAMES PRESET [LATER_SHARE [KEY=VALUE "
                 "...]]\n");
    return 2;
  }
  StreamSettings settings;
  settings.train.preset = argv[4];
  settings.train.held_out_evaluations = 0;
  if (argc > 5) settings.later_share = std::atof(argv[5]);
  for (int i = 6; i < argc; ++i) {
    const std::string set = argv[i];
    const std::size_t at = set.find('=');
    settings.train.overrides.emplace_back(set.substr(0, at), set.substr(at + 1));
  }
  const Status status = encode(argv[1], argv[2], std::atoi(argv[3]), settings);
  if (status.ok()) return 0;
  std::fprintf(stderr, "%s\n", status.message().c_str());
  return 1;
}
