// SPDX-License-Identifier: Apache-2.0
// The report of `stgs info`, as text and JSON.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "session.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/scene_statistics.h"

namespace stgs::tools {

// One record of each segment: its primitives or its SH.
struct SceneLayer {
  const char* content = "primitives";  // primitives or sh
  int tier = 0;
  std::uint64_t primitives = 0, bytes = 0;
};

// Returns the layers of a file in the order of fetch priority.
std::vector<SceneLayer> layers_of(const SceneReader& reader);
// Returns the mean bit rate in kbit/s; none for a file of a single frame.
std::optional<double> mean_kbps(const SceneReader& reader);
// Returns 0 if the file has no primitives.
double bytes_per_primitive(const SceneReader& reader);
bool has_up(const SceneMetadata& metadata);

// `name` is the displayed location of the file.
Json info_json(const SceneReader& reader, const std::string& name);
Json statistics_json(const SceneStatistics& statistics);

// Returns five lines about the scene, followed by one line for each optional field and for damage.
std::string info_text(const SceneReader& reader, const std::string& name);
// Returns the decoder requirements and the tables of parts, segments, layers and streams.
std::string tables_text(const SceneReader& reader);
std::string statistics_text(const SceneStatistics& statistics);

}  // namespace stgs::tools
