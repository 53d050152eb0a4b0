// SPDX-License-Identifier: Apache-2.0
// Decodes a file segment by segment and at once.
#include <algorithm>
#include <cstring>

#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

const Target stgs::fuzz::kTarget{"decode",    stgs_seeds, nullptr,
                                 repair_stgs, stgs_units, stgs_memory};

namespace {

bool same_bits(const FloatArray& a, const FloatArray& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

// Requires that decoding a segment range by range gives the same, or fails as well.
void decode_ranges(const SceneReader& reader, std::uint32_t segment,
                   const Result<Gaussians4D>& full) {
  std::size_t next = 0;
  const auto visit = [&](const Gaussians4D& range, std::size_t begin) {
    require(begin == next, "ranges are consecutive");
    next += range.size();
    if (!full.ok()) return;
    const auto own = static_cast<std::size_t>(3 * range.sh_coefficients());
    const auto all = static_cast<std::size_t>(3 * full->sh_coefficients());
    for (std::size_t i = 0; i < range.size(); ++i) {
      const float *const sh = &full->sh[all * (begin + i)], *const x =
                                                                &full->position[3 * (begin + i)];
      require(std::memcmp(&range.position[3 * i], x, 3 * sizeof(float)) == 0 &&
                  std::memcmp(&range.sh[own * i], sh, own * sizeof(float)) == 0 &&
                  std::all_of(sh + own, sh + all, [](float v) { return v == 0.0f; }),
              "ranges have the values of the segment");
    }
  };
  const Status status = reader.decode_ranges(segment, true, TimeOrigin::kPart, visit);
  require(status.ok() == full.ok(), "ranges decode if, and only if, the segment does");
  require(!full.ok() || next == full->size(), "ranges have all primitives");
}

bool all_segments_decode(const SceneReader& reader) {
  bool all = true;
  for (std::uint32_t i = 0; i < reader.segments().size(); ++i) {
    const auto full = reader.decode(i), base = reader.decode(i, false);
    require(!full.ok() || base.ok(), "a segment that decodes also decodes without SH");
    decode_ranges(reader, i, full);
    all = all && full.ok();
    if (!full.ok()) continue;
    require(full->size() == reader.segments()[i].primitives,
            "a segment has the stated number of primitives");
    require(same_bits(full->position, base->position) &&
                same_bits(full->rotation, base->rotation) && same_bits(full->time, base->time),
            "SH does not affect other attributes");
  }
  return all;
}

bool has_error(const std::vector<Issue>& issues) {
  for (const Issue& issue : issues) {
    if (issue.error) return true;
  }
  return false;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Bytes input(data, data + size);
  const auto reader = SceneReader::open(memory_source(input, "input"), kStgsLimits);
  if (!reader.ok()) return 0;
  const bool all = all_segments_decode(**reader);
  const auto scene = read_scene(memory_source(input, "input"), kStgsLimits);
  require(!scene.ok() || all, "a scene can be read only if all segments decode");
  if (!scene.ok() && all && (*reader)->importance().ok()) {
    require(scene.status().code() == StatusCode::kUnsupported,
            "if all segments decode, only the memory limit rejects the scene");
  }
  const auto issues = validate_scene(*memory_source(input, "input"), kStgsLimits);
  if (issues.ok() && !has_error(*issues)) {
    require(scene.ok() || scene.status().code() == StatusCode::kUnsupported,
            "a valid file can be read");
  }
  return 0;
}
