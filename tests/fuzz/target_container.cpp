// SPDX-License-Identifier: Apache-2.0
// Opens a file, checks the answers of its head, and validates it.
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

const Target stgs::fuzz::kTarget{"container", stgs_seeds, nullptr,
                                 repair_stgs, stgs_units, stgs_memory};

namespace {

void check_head(const SceneReader& reader) {
  const double frames = reader.metadata().frames;
  std::uint64_t primitives = 0;
  std::size_t needed_segments = 0;
  for (const SegmentInfo& segment : reader.segments()) {
    primitives += segment.primitives;
    needed_segments += segment.is_needed() && segment.begin_ticks <= frames ? 1 : 0;
    require(segment.begin_ticks >= 0 && segment.end_ticks <= 0x1p32,
            "the times of a segment are in range");
    require(segment.offset + segment.bytes <= reader.file_bytes(), "segments lie within the file");
    require(segment.part < reader.parts().size(), "the part of a segment exists");
  }
  require(primitives <= kStgsLimits.max_primitives, "the limit on primitives holds");
  require(reader.segments_between(0, frames).size() == needed_segments,
          "segments_between returns every visible segment of the clip");
  (void)reader.segments_between(frames / 2, frames / 2);
  (void)reader.streams();
  const auto importance = reader.importance();
  require(!importance.ok() || importance->empty() || importance->size() == primitives,
          "there is one importance per primitive, or none");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Bytes input(data, data + size);
  const auto reader = SceneReader::open(memory_source(input, "input"), kStgsLimits);
  if (reader.ok()) check_head(**reader);
  const auto issues = validate_scene(*memory_source(input, "input"), kStgsLimits);
  require(issues.ok(), "validation runs on every file");
  require(reader.ok() || !issues->empty(), "a file that does not open has an issue");
  return 0;
}
