// SPDX-License-Identifier: Apache-2.0
#include "train/fingerprint.h"

#include <xxhash.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <vector>

#include "stgs/format/json_text.h"

namespace stgs::encoder {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxListedDifferences = 12;

const std::string* find(const Fingerprint& fingerprint, const std::string& name) {
  const auto entry = std::find_if(fingerprint.begin(), fingerprint.end(),
                                  [&name](const auto& e) { return e.first == name; });
  return entry == fingerprint.end() ? nullptr : &entry->second;
}

// Returns a hash of the file sizes of a camera's frames, and masks if they matter, which other
// images are unlikely to share. Reading all images would take too long.
std::uint64_t frame_sizes(const PreparedCapture& capture, const Camera& camera) {
  std::vector<std::uint64_t> sizes;
  const auto add = [&sizes](const std::string& path) {
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    sizes.push_back(error ? 0 : size);  // loading reports a missing file
  };
  for (int frame = 0; frame < capture.frames; ++frame) {
    add(capture.frame_path(camera, frame));
    if (capture.mask_background) add(capture.mask_path(camera, frame));
  }
  return XXH3_64bits(sizes.data(), sizes.size() * sizeof(std::uint64_t));
}

}  // namespace

Fingerprint fingerprint_of(const HyperParameters& parameters, const TrainSettings& settings) {
  Fingerprint out = list_hyper_parameters(parameters);
  out.emplace_back("seed", fmt::format("{}", settings.seed));
  out.emplace_back("method", settings.method);
  out.emplace_back("ablate", settings.ablate.empty() ? "nothing" : settings.ablate);
  out.emplace_back("refine_cameras", settings.refine_cameras ? "yes" : "no");
  out.emplace_back("refine_timing", settings.refine_timing ? "yes" : "no");
  out.emplace_back("foreground", settings.foreground ? "yes" : "no");
  out.emplace_back("max_seconds", fmt::format("{}", settings.max_seconds));
  out.emplace_back("target_kbps", fmt::format("{}", settings.target_kbps));
  out.emplace_back("target_size", fmt::format("{}", settings.target_size));
  out.emplace_back("target_psnr", fmt::format("{}", settings.target_psnr));
  return out;
}

Fingerprint fingerprint_of(const PreparedCapture& capture) {
  Fingerprint out = {{"frames", fmt::format("{}", capture.frames)},
                     {"first_frame", fmt::format("{}", capture.first_frame)},
                     {"time_base", fmt::format("{}/{}", capture.time_base.numerator,
                                               capture.time_base.denominator)},
                     {"layout", capture.source},
                     {"near_plane", fmt::format("{}", capture.near_plane)},
                     {"extent", fmt::format("{}", capture.extent)},
                     {"scene_radius", fmt::format("{}", capture.scene_radius)}};
  int cameras = 0;
  for (const Camera& camera : capture.cameras) {
    if (camera.test) continue;
    std::vector<double> numbers = {camera.fx, camera.fy, camera.cx, camera.cy};
    numbers.insert(numbers.end(), camera.rotation, camera.rotation + 9);
    numbers.insert(numbers.end(), camera.translation, camera.translation + 3);
    numbers.insert(numbers.end(), {camera.time_offset, camera.fps});
    const XXH64_hash_t hash = XXH3_64bits(numbers.data(), numbers.size() * sizeof(double));
    // With its number, which indexes the state.
    out.emplace_back("camera " + camera.name,
                     fmt::format("number {}, {}x{}, calibration {:016x}", ++cameras, camera.width,
                                 camera.height, hash));
  }
  out.emplace_back("training cameras", std::to_string(cameras));
  return out;
}

Fingerprint image_fingerprint(const PreparedCapture& capture) {
  Fingerprint out;
  if (capture.memory_only) return out;  // nothing resumes on them
  for (const Camera& camera : capture.cameras) {
    if (camera.test) continue;
    out.emplace_back("images of camera " + camera.name,
                     fmt::format("sizes {:016x}", frame_sizes(capture, camera)));
  }
  return out;
}

std::string fingerprint_text(const Fingerprint& fingerprint) {
  Json json = Json::object();
  for (const auto& [name, value] : fingerprint) json[name] = value;
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Result<Fingerprint> read_fingerprint(const std::string& text) {
  STGS_TRY(check_json_nesting(text, "the fingerprint"));
  std::vector<std::string> names;  // in their order, which nlohmann::json does not keep
  std::set<std::string> known;
  const auto note_names = [&](int depth, nlohmann::json::parse_event_t event,
                              const nlohmann::json& parsed) {
    if (event == nlohmann::json::parse_event_t::key && depth == 1 &&
        known.insert(parsed.get<std::string>()).second) {
      names.push_back(parsed.get<std::string>());
    }
    return true;
  };
  const nlohmann::json json = nlohmann::json::parse(text, note_names, false);
  if (!json.is_object()) return invalid_file("no fingerprint of the run that it belongs to");
  Fingerprint out;
  for (const std::string& name : names) {
    const nlohmann::json& value = json.at(name);
    out.emplace_back(name, value.is_string() ? value.get<std::string>() : short_json(value));
  }
  return out;
}

std::string value_of(const Fingerprint& fingerprint, const std::string& name) {
  const std::string* value = find(fingerprint, name);
  return value == nullptr ? "" : *value;
}

Status check_same_run(const std::string& path, const Fingerprint& found, const Fingerprint& now) {
  std::string list;
  std::size_t count = 0;
  for (const auto& [name, value] : now) {
    const std::string* before = find(found, name);
    if (name == kBackendEntry || name == kProcessesEntry) continue;
    if (before != nullptr && *before == value) continue;
    if (++count > kMaxListedDifferences) continue;
    list += fmt::format("{}{}: {}, now {}", list.empty() ? "" : "; ", name,
                        before == nullptr ? "missing" : *before, value);
  }
  if (count == 0) return {};
  if (count > kMaxListedDifferences)
    list += fmt::format("; and {} more", count - kMaxListedDifferences);
  return usage_error(
      "{}: checkpoint of another run; resume with the settings and the capture that it was made "
      "with. Differences (checkpoint, now): {}",
      path, list);
}

}  // namespace stgs::encoder
