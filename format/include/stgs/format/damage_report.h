// SPDX-License-Identifier: Apache-2.0
// Reading the intact content of a damaged file, with a report of the damage (spec 10).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs {

// The content of a file that could not be read.
struct DamageReport {
  // As returned by the SceneReader functions of these names.
  std::vector<Issue> damage;
  std::vector<LostFragment> lost_fragments;
  std::uint64_t incomplete_bytes = 0;
  // Segments in total, segments without their primitives, and segments without their SH only. Their
  // records are damaged, missing or of a later version.
  std::uint64_t total_segments = 0, segments = 0, segments_without_sh = 0;
  std::uint64_t primitives = 0;   // of `segments`
  std::uint64_t further = 0;      // damaged further records (spec 5.7)
  std::uint64_t bytes = 0;        // of all these records
  std::vector<TickRange> ranges;  // times at which they would be needed; ascending, disjoint
  Status reason;                  // why the first of them cannot be read; ok: none
  Status importance;  // why the importances cannot be read; ok: they were, or none exist

  // Returns whether there is any damage.
  bool any() const {
    return !damage.empty() || incomplete_bytes > 0 || !reason.ok() || !importance.ok();
  }
};

// Describes the damage, with bytes and seconds: one line per kind, and one for each of the first 20
// issues and lost fragments. The file name is not included.
std::vector<std::string> describe_damage(const DamageReport& report, const TimeBase& time_base);

// Reads the intact records of all segments; primitives in file order. SH that cannot be read are 0;
// segments that cannot be read are omitted with their importances. Fails if no primitive of a
// non-empty file can be read, if the source fails, or if the file needs a feature that this build
// lacks. Times and their limit are as for read_scene().
Result<Scene> recover_scene(std::unique_ptr<ByteSource> source, DamageReport& report,
                            const ReadLimits& limits = {});
// As above, from a path.
Result<Scene> recover_scene(const std::string& path, DamageReport& report,
                            const ReadLimits& limits = {});
// As above, from an open reader. `name` is used in messages.
Result<Scene> recover_scene(const SceneReader& reader, const std::string& name,
                            DamageReport& report, const ReadLimits& limits = {});

// Lists content of a file that a Scene cannot represent and that rewriting would drop, one line
// each, with names and bytes: further records, private records and numbers, content of later
// versions (spec 3.5, 5.7, 6.2). Reads the records of all segments but decodes none. If records are
// damaged the list covers the readable ones.
Result<std::vector<std::string>> scene_extras(const std::string& path,
                                              const ReadLimits& limits = {});

}  // namespace stgs
