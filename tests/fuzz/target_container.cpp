// SPDX-License-Identifier: Apache-2.0
// Opening a file, all that is answered from its head, and validating it.
#include "stgs_file.h"

using namespace stgs;
using namespace stgs::fuzz;

const Target stgs::fuzz::kTarget{"container", stgs_seeds, nullptr,
                                 repair_stgs, stgs_units, stgs_memory};

namespace {

void look_at(const SceneReader& reader) {
  const double frames = reader.metadata().frames;
  std::uint64_t primitives = 0;
  std::size_t shown = 0;
  for (const SegmentInfo& segment : reader.segments()) {
    primitives += segment.primitives;
    shown += segment.is_shown() && segment.begin_ticks <= frames ? 1 : 0;
    require(segment.begin_ticks >= 0 && segment.end_ticks <= 0x1p32, "a segment is of moments");
    require(segment.offset + segment.bytes <= reader.file_bytes(), "a segment lies in the file");
    require(segment.part < reader.parts().size(), "a segment is of a part that there is");
  }
  require(primitives == reader.primitives(), "the segments have all the primitives");
  require(primitives <= kStgsLimits.max_primitives, "the limit of primitives holds");
  require(reader.segments_between(0, frames).size() == shown,
          "what is shown lies between the ends");
  (void)reader.segments_between(frames / 2, frames / 2);
  (void)reader.streams();
  const auto importance = reader.importance();
  require(!importance.ok() || importance->empty() || importance->size() == primitives,
          "an importance for each primitive, or none");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Bytes input(data, data + size);
  const auto reader = SceneReader::open(memory_source(input, "input"), kStgsLimits);
  if (reader.ok()) look_at(**reader);
  const auto issues = validate_scene(*memory_source(input, "input"), kStgsLimits);
  require(issues.ok(), "every file in memory can be validated");
  require(reader.ok() || !issues->empty(), "what cannot be opened has an issue");
  return 0;
}
