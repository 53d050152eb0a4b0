// SPDX-License-Identifier: Apache-2.0
// usage: record_fragments FILE COUNT MILLISECONDS
// Records COUNT fragments, waits MILLISECONDS after each, and closes the file.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "fragment_fixture.h"

using namespace stgs;

namespace {

Status record(const std::string& path, std::uint32_t count, int wait) {
  STGS_ASSIGN(const auto recorder,
              SceneRecorder::create(path, testing::recording_metadata(), 1,
                                    testing::recording_settings(Profile::kQuantised)));
  for (std::uint32_t i = 0; i < count; ++i) {
    STGS_TRY(recorder->append(testing::make_fragment(i), (i + 1) * testing::kFragmentFrames));
    std::this_thread::sleep_for(std::chrono::milliseconds(wait));
  }
  return recorder->close();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) return 1;
  const Status status =
      record(argv[1], static_cast<std::uint32_t>(std::atoi(argv[2])), std::atoi(argv[3]));
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.message().c_str());
  return static_cast<int>(status.code());
}
