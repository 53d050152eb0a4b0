// SPDX-License-Identifier: Apache-2.0
#include "interchange/fourdgs_scene.h"

namespace stgs {

Result<Scene> read_back_4dgs(const ByteSource& source, const ReadLimits& limits) {
  FourdgsReport report;
  STGS_ASSIGN(const fourdgs::Contents contents, fourdgs::read_contents(source, nullptr));
  const TimeBase base = fourdgs::stored_frame_time(contents).value_or(TimeBase{});
  return fourdgs::read_birth(source, contents, base, limits, true, report, nullptr);
}

Result<Scene> read_4dgs(const ByteSource& source, const FourdgsSettings& settings,
                        const ReadLimits& limits, FourdgsReport* report, ConversionNotes* notes) {
  FourdgsReport unused;
  FourdgsReport& out = report != nullptr ? *report : unused;
  out = {};
  STGS_ASSIGN(const fourdgs::Contents contents, fourdgs::read_contents(source, notes));
  if (contents.has_keyframes()) {
    return fourdgs::read_keyframes(source, contents, settings, limits, out, notes);
  }
  if (settings.tolerances) {
    return usage_error("{}: has the temporal model {}, to which tolerances do not apply; omit them",
                       source.name(), fourdgs::kBirth);
  }
  std::optional<TimeBase> base = settings.frame_time;
  if (!base) base = fourdgs::stored_frame_time(contents);
  return fourdgs::read_birth(source, contents, base.value_or(TimeBase{}), limits, false, out,
                             notes);
}

}  // namespace stgs
