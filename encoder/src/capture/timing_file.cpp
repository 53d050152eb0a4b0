// SPDX-License-Identifier: Apache-2.0
#include "timing_file.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "capture_files.h"
#include "stgs/encoder/camera_json.h"

namespace stgs::encoder {
namespace {

using Json = nlohmann::json;

struct TimingKey {
  std::string_view name;
  double SourceCamera::*value;
  double least, most;
};

constexpr TimingKey kKeys[] = {
    {"time_offset", &SourceCamera::time_offset, -kMaxTimeOffset, kMaxTimeOffset},
    {"fps", &SourceCamera::fps, kMinFps, kMaxFps}};

Status read_times(const Json& json, const std::string& where, SourceCamera& camera) {
  if (!json.is_object())
    return invalid_file("{}: expected an object with time_offset or fps, got {}", where,
                        json.type_name());
  for (const auto& [name, value] : json.items()) {
    const auto key = std::find_if(std::begin(kKeys), std::end(kKeys),
                                  [&name = name](const TimingKey& k) { return k.name == name; });
    if (key == std::end(kKeys))
      return invalid_file("{}: unknown key \"{}\" (expected time_offset or fps)", where, name);
    const double number = value.is_number() ? value.get<double>() : std::nan("");
    if (!(number >= key->least && number <= key->most)) {
      return invalid_file("{}: {} is {} (expected a number from {} to {})", where, name,
                          value.dump(), key->least, key->most);
    }
    camera.*key->value = number;
  }
  return {};
}

}  // namespace

Status attach_timing(SourceCapture& capture) {
  const std::string path = capture.folder + "/" + kTimingFile;
  if (!capture.files->exists(path)) return {};
  STGS_ASSIGN(const Json json, read_json(*capture.files, path));
  if (!json.is_object()) {
    return invalid_file("{}: expected an object from names of cameras to their times, got {}", path,
                        json.type_name());
  }
  for (const auto& [name, times] : json.items()) {
    const auto camera = std::find_if(capture.cameras.begin(), capture.cameras.end(),
                                     [&name = name](const auto& c) { return c.name == name; });
    if (camera == capture.cameras.end()) {
      return invalid_file("{}: no camera '{}' in {}; remove it or correct its name", path, name,
                          capture.folder);
    }
    STGS_TRY(read_times(times, path + ": camera '" + name + "'", *camera));
  }
  capture.has_timing = true;
  return {};
}

}  // namespace stgs::encoder
