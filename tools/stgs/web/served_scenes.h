// SPDX-License-Identifier: Apache-2.0
// The files that stgs serve gives away: one scene, or the scenes below a folder, and the audio
// files that they name.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "session.h"
#include "stgs/encoder/capture_folder.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// The characters of a path that a URL contains as they are, besides letters and digits.
inline constexpr std::string_view kUrlPath = "-._~/";

// Thread-safe.
class ServedScenes {
 public:
  // Of a list.
  static constexpr std::size_t kMaxListed = 1000;   // scenes
  static constexpr int kMaxDepth = 8;               // folders below the folder
  static constexpr std::size_t kMaxFolders = 2000;  // that are searched

  // Serves a file or a folder. kIo if it cannot be opened.
  static Result<std::shared_ptr<const ServedScenes>> open(const std::string& path);

  bool is_folder() const { return target_.empty(); }
  // Returns the name of the file; "" for a folder.
  const std::string& file_name() const { return file_name_; }

  // Opens a scene by its name: that of the file, or its path below the folder. Links that leave the
  // folder are not followed, and hidden files not opened. kIo if there is no such regular file.
  Result<encoder::CaptureFile> open_scene(const std::string& name) const;

  // Opens an audio file by its path below the folder. kIo unless a scene that is served names it:
  // its own scene, or one in the same folder or up to kMaxDepth folders above. Reads the heads of
  // up to kMaxListed scenes, nearest ones and those of the same name first, for a second or until a
  // signal arrives. Links that leave the folder of the scene are not followed.
  Result<encoder::CaptureFile> open_audio(const std::string& name) const;

  // Returns the scenes of a folder as JSON (SceneList of sdk/web/src/viewer/sources.ts). `prefix`
  // precedes their names in URLs.
  Json list(const std::string& prefix) const;

 private:
  // Returns the path of the audio file of a scene, relative to its folder; "" if there is none.
  // `scene`: path below the folder.
  std::string audio_of(const std::string& scene) const;
  static Result<std::string> read_audio_of(encoder::CaptureFile file, const std::string& scene);
  // Returns the paths of scenes directly in a folder, given below the served one and with "/" at
  // its end, or "".
  std::vector<std::string> scenes_in(const std::string& below) const;

  mutable std::mutex mutex_;
  mutable std::map<encoder::FileVersion, std::string> audio_;  // paths of audio files
  std::string file_name_, target_;  // of a file: its name, and that in the folder
  std::shared_ptr<const encoder::CaptureFolder> folder_;
};

}  // namespace stgs::tools
