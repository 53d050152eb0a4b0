// SPDX-License-Identifier: Apache-2.0
#include "served_scenes.h"

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <filesystem>

#include "file_request.h"
#include "scene_audio.h"
#include "stgs/format/escape.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/text.h"

namespace stgs::tools {
namespace {

using encoder::CaptureFile;
using encoder::CaptureFolder;

// Other requests wait while the scene of an audio file is searched. The next request continues
// where this one ended: it knows the audio files of the scenes so far.
constexpr std::chrono::seconds kMaxSearch(1);

constexpr std::uint64_t kMaxHead = 16 << 20;  // memory for the head of such a scene, bytes

// Names of the scenes below a folder, sorted.
class SceneSearch {
 public:
  explicit SceneSearch(const CaptureFolder& folder) : folder_(folder) {}

  std::vector<std::string> names;
  bool is_complete = true;

  void search(const std::string& below, int depth) {
    is_complete = is_complete && ++folders_ <= ServedScenes::kMaxFolders;
    const auto entries = folder_.list(folder_.path() + below);
    if (!is_complete || !entries.ok()) return;  // not readable, or replaced meanwhile
    std::vector<CaptureFolder::Entry> sorted = **entries;
    std::sort(sorted.begin(), sorted.end(),
              [](const auto& a, const auto& b) { return a.name < b.name; });
    for (const auto& [name, kind] : sorted) {
      if (kind == CaptureFolder::Kind::kFile && is_scene_name(name)) {
        is_complete = is_complete && names.size() < ServedScenes::kMaxListed;
        if (is_complete) names.push_back((below + "/" + name).substr(1));
      } else if (kind == CaptureFolder::Kind::kFolder && depth < ServedScenes::kMaxDepth) {
        search(below + "/" + name, depth + 1);
      }
      if (!is_complete) return;
    }
  }

 private:
  const CaptureFolder& folder_;
  std::size_t folders_ = 0;  // searched so far
};

}  // namespace

Result<std::shared_ptr<const ServedScenes>> ServedScenes::open(const std::string& path) {
  namespace fs = std::filesystem;
  auto scenes = std::make_shared<ServedScenes>();
  std::error_code error;
  fs::path folder = path;
  if (!fs::is_directory(path, error)) {
    // The path may be a link, whose target the caller means.
    const fs::path target = fs::canonical(path, error);
    if (error) return io_error("{}: cannot open: {}", path, file_problem(error.value()));
    folder = target.parent_path();
    scenes->target_ = target.filename().string();
    scenes->file_name_ = fs::path(path).filename().string();
  }
  STGS_ASSIGN(scenes->folder_, CaptureFolder::open(folder.string(), false));
  return std::shared_ptr<const ServedScenes>(std::move(scenes));
}

Result<CaptureFile> ServedScenes::open_scene(const std::string& name) const {
  const bool is_served = is_folder() ? is_scene_name(name) : name == file_name_;
  if (!is_served) return io_error("{}: not served", name);
  return folder_->open_file(folder_->path() + "/" + (is_folder() ? name : target_));
}

std::string ServedScenes::audio_of(const std::string& scene) const {
  auto file = folder_->open_file(folder_->path() + "/" + scene);
  if (!file.ok()) return {};
  const auto version = file->version(scene);
  if (!version.ok()) return {};
  const std::lock_guard lock(mutex_);
  const auto known = audio_.find(*version);
  if (known != audio_.end()) return known->second;
  if (audio_.size() >= kMaxListed) audio_.clear();
  const Result<std::string> audio = read_audio_of(std::move(*file), scene);
  if (!audio.ok() && audio.status().code() != StatusCode::kInvalidFile) return {};
  return audio_[*version] = audio.ok() ? *audio : "";
}

Result<std::string> ServedScenes::read_audio_of(CaptureFile file, const std::string& scene) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, descriptor_source(file.release(), scene));
  ReadLimits limits;
  limits.max_opening = kMaxHead;
  STGS_ASSIGN(const std::unique_ptr<SceneReader> reader,
              SceneReader::open(std::move(source), limits, std::pmr::get_default_resource(),
                                IndexLoading::kOnDemand));
  if (reader->metadata().audio.empty()) return std::string();
  return audio_path(reader->metadata().audio);
}

std::vector<std::string> ServedScenes::scenes_in(const std::string& below) const {
  std::vector<std::string> scenes;
  // Of a new object: a folder is listed once per object.
  const auto folder = CaptureFolder::open(folder_->path(), false);
  if (!folder.ok()) return scenes;
  const std::string path = (*folder)->path() + "/" + below;
  const auto entries = (*folder)->list(path.substr(0, path.size() - 1));
  if (!entries.ok()) return scenes;
  for (const auto& [name, kind] : **entries) {
    if (kind == CaptureFolder::Kind::kFile && is_scene_name(name)) scenes.push_back(below + name);
  }
  return scenes;
}

Result<CaptureFile> ServedScenes::open_audio(const std::string& name) const {
  namespace fs = std::filesystem;
  const Status refused = io_error("{}: not served", name);
  const auto normal = audio_path(escape_url(name, kUrlPath));
  if (!normal.ok() || *normal != name) return refused;
  const auto last = std::chrono::steady_clock::now() + kMaxSearch;
  std::size_t examined = 0, end = is_folder() ? name.rfind('/') + 1 : 0;
  for (int level = 0; level <= kMaxDepth; ++level) {
    const std::string below = name.substr(0, end), path = folder_->path() + "/";
    auto scenes = is_folder() ? scenes_in(below) : std::vector<std::string>{target_};
    std::stable_partition(scenes.begin(), scenes.end(), [&](const std::string& scene) {
      return fs::path(scene).stem() == fs::path(name).stem();
    });
    for (const std::string& scene : scenes) {
      if (++examined > kMaxListed || interrupted() || std::chrono::steady_clock::now() > last) {
        return refused;
      }
      if (audio_of(scene) != name.substr(end)) continue;
      const auto own = CaptureFolder::open(path + below, false);
      if (!own.ok() ||
          (*own)->kind(path + below + "/" + name.substr(end)) != CaptureFolder::Kind::kFile) {
        continue;  // a link leaves the folder of the scene
      }
      return folder_->open_file(path + name);
    }
    if (end == 0) break;
    end = end < 2 ? 0 : name.rfind('/', end - 2) + 1;
  }
  return refused;
}

Json ServedScenes::list(const std::string& prefix) const {
  Json scenes = Json::array();
  // Of a new object: a folder is listed once per object.
  const auto folder = CaptureFolder::open(folder_->path(), false);
  if (!folder.ok()) return {{"scenes", scenes}, {"complete", true}};
  SceneSearch found(**folder);
  found.search("", 0);
  for (const std::string& name : found.names) {
    const auto file = (*folder)->open_file((*folder)->path() + "/" + name);
    struct stat info {};
    if (!file.ok() || ::fstat(file->descriptor(), &info) != 0) continue;
    scenes.push_back({{"name", name},
                      {"href", prefix + escape_url(name, kUrlPath)},
                      {"bytes", info.st_size},
                      {"modified", info.st_mtim.tv_sec}});
  }
  return {{"scenes", scenes}, {"complete", found.is_complete}};
}

}  // namespace stgs::tools
