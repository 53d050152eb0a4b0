// SPDX-License-Identifier: Apache-2.0
// Opens what a verb is given as FILE: a path, or a URL of http or https.
#pragma once

#include <memory>
#include <string>

#include "session.h"
#include "stgs/format/scene_file.h"

namespace stgs::tools {

// SIGINT and SIGTERM end reads from a URL; tries that fail are told as warnings. The session must
// outlive what is returned.
Result<std::unique_ptr<ByteSource>> open_place(Session& session, const std::string& place);
Result<std::unique_ptr<SceneReader>> open_scene(Session& session, const std::string& place);
// For verbs that read files alone: kUsage where it is a URL.
Status check_is_path(const std::string& place);
// All of its segments.
Result<Scene> read_place(Session& session, const std::string& place);

}  // namespace stgs::tools
