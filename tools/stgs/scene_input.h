// SPDX-License-Identifier: Apache-2.0
// Opens the FILE argument of a verb: a path, an http or https URL, or "-" for standard input.
#pragma once

#include <memory>
#include <string>

#include "session.h"
#include "stgs/format/scene_file.h"

namespace stgs::tools {

// Returns the name of a location for messages: the path, the URL without userinfo, or "standard
// input".
std::string display_name(const std::string& location);
// Opens a location for reading. SIGINT and SIGTERM cancel reads from a URL; failed attempts that
// are retried are reported as warnings. The session must outlive the result.
Result<std::unique_ptr<ByteSource>> open_source(Session& session, const std::string& location);
// Opens a scene: reads its head, not its segments.
Result<std::unique_ptr<SceneReader>> open_scene(Session& session, const std::string& location);
// Reads the entire scene. Reports damage as warnings.
Result<Scene> load_scene(Session& session, const std::string& location);
// Returns the error of open_scene(), for files that another module opens later.
Status check_is_scene(Session& session, const std::string& location);
// Returns kUsage if `location` is a URL or standard input, for verbs that read local files only.
Status check_is_path(const std::string& location);

}  // namespace stgs::tools
