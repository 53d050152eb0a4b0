// SPDX-License-Identifier: Apache-2.0
// The report of `stgs info`, as text and JSON.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "scene_file.h"
#include "session.h"

namespace stgs::tools {

// One record of each segment: its primitives or its SH.
struct SceneLayer {
  const char* content = "primitives";  // primitives or sh
  int tier = 0;
  std::uint64_t primitives = 0, bytes = 0;
};

// Everything that a file states about its scene. Strings belong to the scene.
struct SceneInfo {
  std::string name, profile, generator, title, audio;
  stgs_scene_info scene{};
  stgs_contents contents{};
  stgs_decoder_needs decoder{};
  std::optional<stgs_view> start_camera;
  std::vector<stgs_issue> issues;
  std::vector<stgs_lost_fragment> lost_fragments;
  std::vector<stgs_part> parts;
  std::vector<stgs_segment> segments;  // their tiers; those of a segment begin with tier 0
  std::vector<stgs_stream> streams;

  // Duration of a frame, seconds.
  double frame_seconds() const {
    return 1.0 * scene.time_base_numerator / scene.time_base_denominator;
  }
  bool has_up() const;
  std::size_t count_segments() const;
  // Returns the layers in the order of fetch priority.
  std::vector<SceneLayer> layers() const;
  // Returns the mean bit rate in kbit/s; none for a file of a single frame.
  std::optional<double> mean_kbps() const;
  // Returns whether the file states the bytes of its streams. Recordings do not.
  bool has_stream_bytes() const;
  // Returns 0 if the file has no primitives.
  double bytes_per_primitive() const;
};

Result<SceneInfo> read_info(const SceneFile& file);
Result<stgs_scene_statistics> read_statistics(SceneFile& file);

Json info_json(const SceneInfo& info);
Json statistics_json(const stgs_scene_statistics& statistics);

// Returns five lines about the scene, followed by one line for each optional field and for damage.
std::string info_text(const SceneInfo& info);
// Returns the decoder requirements and the tables of parts, tiers of segments, layers and streams.
std::string tables_text(const SceneInfo& info);
std::string statistics_text(const stgs_scene_statistics& statistics);

// Parts are listed by info_text() if they are few, otherwise by tables_text().
bool lists_parts(const SceneInfo& info);
std::string part_rows(const SceneInfo& info);
std::string level_text(const stgs_decoder_needs& needs);

}  // namespace stgs::tools
