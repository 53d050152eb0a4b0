// SPDX-License-Identifier: Apache-2.0
// The audio file that a scene names (spec 4.6): a page may only play it from the folder of the
// scene or below.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// Returns the media type of an audio file by the ending of its name; "" if the name does not end
// like an audio file that browsers play.
std::string_view audio_type(std::string_view name);

// Returns the path of the audio file at a location of a scene, relative to the folder of the scene,
// without "." and "..". kUnsupported, with the reason, if the location leads out of that folder,
// names a hidden file, or does not name an audio file (audio_type()).
Result<std::string> audio_path(const std::string& location);

struct SceneAudio {
  std::string name;  // as of audio_path()
  std::unique_ptr<ByteSource> bytes;
};

// Opens the audio file at a location of the scene `scene`, a path; links out of the folder of the
// scene are not followed. The message of an error is the reason without the name of the scene.
Result<SceneAudio> open_audio(const std::string& scene, const std::string& location);

// Returns the warning that a page has no sound. `why`: of audio_path() or open_audio().
std::string silent_warning(const std::string& scene, const Status& why);

}  // namespace stgs::tools
