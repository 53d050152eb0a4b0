// SPDX-License-Identifier: Apache-2.0
// Measures the heap of imports under a memory limit.
#pragma once

#include <string>

#include "../fuzz/heap.h"
#include "catch.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/read_limits.h"
#include "stgs/format/scene_file.h"

namespace stgs::testing {

inline constexpr std::uint64_t kBombMiB = 1 << 20;
inline constexpr ReadLimits kBombLimits{200'000'000, 64 * kBombMiB};

// Checks that an import is refused, and that its heap stays within the limit, a constant for
// uncounted allocations, and twice the file. Returns the message.
template <typename Import>
std::string refusal(std::uint64_t file_bytes, const Import& import) {
  fuzz::limit_heap(std::uint64_t{1} << 40);
  const Result<Scene> scene = import();
  const std::uint64_t peak = fuzz::heap_peak();
  fuzz::unlimit_heap();
  INFO("peak " << static_cast<double>(peak) / kBombMiB << " MiB, file of "
               << static_cast<double>(file_bytes) / kBombMiB
               << " MiB: " << scene.status().message());
  CHECK(peak <= kBombLimits.max_memory + 16 * kBombMiB + 2 * file_bytes);
  CHECK_FALSE(scene.ok());
  if (scene.ok()) return "";
  const StatusCode code = scene.status().code();
  CHECK((code == StatusCode::kUnsupported || code == StatusCode::kInvalidFile));
  return scene.status().message();
}

// As above, of a file in memory. read(source) imports it.
template <typename Read>
std::string refusal_of(const std::string& file, const Read& read) {
  const auto source = memory_source({file.begin(), file.end()}, "bomb");
  return refusal(file.size(), [&] { return read(*source); });
}

}  // namespace stgs::testing
