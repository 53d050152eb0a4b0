// SPDX-License-Identifier: Apache-2.0
#include "scene_audio.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <utility>

#include "../printable.h"
#include "file_request.h"
#include "stgs/encoder/capture_folder.h"

namespace stgs::tools {
namespace {

namespace fs = std::filesystem;
using encoder::CaptureFolder;

constexpr std::array<std::pair<std::string_view, std::string_view>, 11> kTypes = {{
    {".aac", "audio/aac"},
    {".flac", "audio/flac"},
    {".m4a", "audio/mp4"},
    {".mp3", "audio/mpeg"},
    {".mp4", "video/mp4"},
    {".oga", "audio/ogg"},
    {".ogg", "audio/ogg"},
    {".opus", "audio/ogg"},
    {".wav", "audio/wav"},
    {".weba", "audio/webm"},
    {".webm", "video/webm"},
}};

// Returns whether a URI reference begins with a scheme and a colon.
bool has_scheme(std::string_view location) {
  const std::size_t end = location.find_first_of(":/");
  return end != location.npos && location[end] == ':';
}

// Removes "." and ".." as browsers do. Nothing if the path leaves its folder, ends with a folder,
// or contains an empty or hidden name.
std::optional<std::string> normalised(const std::string& path) {
  std::vector<std::string> names;
  for (std::size_t begin = 0; begin <= path.size();) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    const std::string name = path.substr(begin, end - begin);
    begin = end + 1;
    if (name == "..") {
      if (names.empty()) return {};
      names.pop_back();
    } else if (name != ".") {
      if (name.empty() || name.front() == '.') return {};
      names.push_back(name);
    }
  }
  return fmt::format("{}", fmt::join(names, "/"));
}

}  // namespace

std::string_view audio_type(std::string_view name) {
  std::string ending(name.substr(std::min(name.rfind('.'), name.size())));
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  for (const auto& [known, type] : kTypes) {
    if (ending == known) return type;
  }
  return {};
}

Result<std::string> audio_path(const std::string& location) {
  const std::string shown = one_line(location);
  if (has_scheme(location)) {
    return unsupported(
        "the audio '{}' is a URL; name a file in the folder of the scene with 'stgs pack --audio'",
        shown);
  }
  const auto decoded = decode_url_path(location.substr(0, location.find_first_of("?#")));
  // Browsers take a backslash as a slash, and ignore some control characters.
  const bool is_plain = decoded && encoder::is_printable(location) &&
                        encoder::is_printable(*decoded) && decoded->find('\\') == std::string::npos;
  const auto path = is_plain ? normalised(*decoded) : std::nullopt;
  if (!path || path->empty()) {
    return unsupported(
        "the audio '{}' is not a file in the folder of the scene or below; put it there and name "
        "it with 'stgs pack --audio'",
        shown);
  }
  if (!audio_type(*path).empty()) return *path;
  return unsupported(
      "'{}' is not named like an audio file (expected .aac, .flac, .m4a, .mp3, .mp4, .oga, .ogg, "
      ".opus, .wav, .weba or .webm); convert it and name it with 'stgs pack --audio'",
      shown);
}

Result<SceneAudio> open_audio(const std::string& scene, const std::string& location) {
  SceneAudio audio;
  STGS_ASSIGN(audio.name, audio_path(location));
  // The path of the scene may be a link, whose target the caller means.
  std::error_code error;
  const fs::path target = fs::canonical(scene, error);
  if (error) return io_error("the folder of the scene cannot be opened: {}", error.message());
  STGS_ASSIGN(const auto folder, CaptureFolder::open(target.parent_path().string(), false));
  const std::string path = folder->path() + "/" + audio.name;
  switch (folder->kind(path)) {
    case CaptureFolder::Kind::kFile:
      break;
    case CaptureFolder::Kind::kMissing:
      return io_error("the audio file '{}' does not exist; put it there", one_line(path));
    case CaptureFolder::Kind::kOutside:
      return unsupported("'{}' leads out of the folder of the scene; copy the audio file there",
                         one_line(path));
    case CaptureFolder::Kind::kFolder:
    case CaptureFolder::Kind::kOther:
      return unsupported("'{}' is not a regular file; put the audio file there", one_line(path));
  }
  STGS_ASSIGN(audio.bytes, folder->open_source(path));
  return audio;
}

std::string silent_warning(const std::string& scene, const Status& why) {
  return fmt::format("{}: the page has no sound: {}", scene, why.message());
}

}  // namespace stgs::tools
