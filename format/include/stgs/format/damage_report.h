// SPDX-License-Identifier: Apache-2.0
// Reading all of a file that is damaged, as far as it is sound, and telling what is not (spec 5.7,
// 5.12).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs {

// What cannot be had of a file.
struct DamageReport {
  // As the SceneReader functions of these names.
  std::vector<Issue> damage;
  std::vector<LostFragment> lost_fragments;
  std::uint64_t incomplete_bytes = 0;
  std::uint32_t unreached_frames = 0;
  // Segments of a tier whose records are damaged, missing or of a later version: of so many,
  // without any of their primitives, or without their harmonics alone.
  std::uint64_t total_segments = 0, segments = 0, segments_without_sh = 0;
  std::uint64_t primitives = 0;  // of the former
  std::uint64_t further = 0;     // damaged records of timed data (spec 5.13)
  std::uint64_t bytes = 0;       // of all these records
  std::vector<TickRange>
      ranges;         // at which they would be seen, ascending and apart from each other
  Status reason;      // why the first of them is lost; ok: none is
  Status importance;  // why the importances are; ok: there are none, or they are read

  bool any() const {
    return !damage.empty() || incomplete_bytes > 0 || !reason.ok() || !importance.ok();
  }
};

// A line for each kind of loss, with bytes and seconds, for people; without the file's name.
std::vector<std::string> describe_damage(const DamageReport& losses, const TimeBase& time_base);

// What is sound of all segments of a file; primitives in file order. Where harmonics alone are lost
// they are 0; what else is lost is left out, with its importances. An error where there are
// primitives and none can be read, where the source fails, or the build lacks what the file needs.
Result<Scene> recover_scene(std::unique_ptr<ByteSource> source, DamageReport& losses,
                            const ReadLimits& limits = {});
Result<Scene> recover_scene(const std::string& path, DamageReport& losses,
                            const ReadLimits& limits = {});

// What a sound file holds beside its scene and a Scene does not, so that whoever writes it anew
// loses it, a line each, with names and bytes: timed data, private records and numbers, and what is
// of a later version (spec 3.5, 5.13, 6.5). Reads all segments' records, but decodes none. Where
// records are damaged it is what can be found.
Result<std::vector<std::string>> scene_extras(const std::string& path,
                                              const ReadLimits& limits = {});

}  // namespace stgs
