// SPDX-License-Identifier: Apache-2.0
#include "interchange/fourdgs_scene.h"

namespace stgs {

bool is_4dgs(std::span<const std::uint8_t> head) {
  if (head.size() < fourdgs::kMagic.size()) return false;
  for (std::size_t i = 0; i < fourdgs::kMagic.size(); ++i) {
    if (i != fourdgs::kVersionByte && head[i] != fourdgs::kMagic[i]) return false;
  }
  return true;
}

Result<Scene> read_back_4dgs(const ByteSource& source, const ReadLimits& limits) {
  FourdgsReport report;
  ImportMemory memory(limits, source.name());
  STGS_ASSIGN(const fourdgs::Contents contents, fourdgs::read_contents(source, memory, nullptr));
  const TimeBase base = fourdgs::stored_frame_time(contents).value_or(TimeBase{});
  return fourdgs::read_birth(source, contents, base, memory, true, report, nullptr);
}

Result<Scene> read_4dgs(const ByteSource& source, const FourdgsSettings& settings,
                        const ReadLimits& limits, FourdgsReport* report, ConversionNotes* notes) {
  FourdgsReport unused;
  FourdgsReport& out = report != nullptr ? *report : unused;
  out = {};
  ImportMemory memory(limits, source.name());
  STGS_ASSIGN(const fourdgs::Contents contents, fourdgs::read_contents(source, memory, notes));
  if (contents.has_keyframes()) {
    return fourdgs::read_keyframes(source, contents, settings, memory, out, notes);
  }
  if (settings.tolerances) {
    return usage_error("{}: has the temporal model {}, to which tolerances do not apply; omit them",
                       source.name(), fourdgs::kBirth);
  }
  std::optional<TimeBase> base = settings.frame_time;
  if (!base) base = fourdgs::stored_frame_time(contents);
  return fourdgs::read_birth(source, contents, base.value_or(TimeBase{}), memory, false, out,
                             notes);
}

}  // namespace stgs
