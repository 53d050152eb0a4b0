// SPDX-License-Identifier: Apache-2.0
// Decoding all of a file, segment by segment and at once.
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

bool decodes_everywhere(const SceneReader& reader) {
  bool all = true;
  for (std::uint32_t i = 0; i < reader.segments().size(); ++i) {
    const auto whole = reader.decode(i), base = reader.decode(i, false);
    require(!whole.ok() || base.ok(), "what decodes whole decodes without its harmonics");
    all = all && whole.ok();
    if (!whole.ok()) continue;
    require(whole->size() == reader.segments()[i].primitives, "a segment has its primitives");
    require(same_bits(whole->position, base->position) &&
                same_bits(whole->rotation, base->rotation) && same_bits(whole->time, base->time),
            "harmonics change nothing else");
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
  const bool all = decodes_everywhere(**reader);
  const auto scene = read_scene(memory_source(input, "input"), kStgsLimits);
  require(!scene.ok() || all, "a scene is whole only if its segments are");
  if (!scene.ok() && all && (*reader)->importance().ok()) {
    require(scene.status().code() == StatusCode::kUnsupported, "only the limit of memory is left");
  }
  const auto issues = validate_scene(*memory_source(input, "input"), kStgsLimits);
  if (issues.ok() && !has_error(*issues)) {
    require(scene.ok() || scene.status().code() == StatusCode::kUnsupported,
            "a valid file can be read");
  }
  return 0;
}
