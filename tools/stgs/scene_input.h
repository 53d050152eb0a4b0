// SPDX-License-Identifier: Apache-2.0
// Opens the FILE argument of a verb: a path, an http or https URL, or "-" for standard input.
#pragma once

#include <memory>
#include <string>

#include "location.h"
#include "session.h"
#include "stgs/format/scene_file.h"

namespace stgs::tools {

// Opens a location for reading. Standard input is held in memory, `memory` bytes at most. SIGINT
// and SIGTERM cancel reads from a URL; failed attempts that are retried are reported as warnings.
// The session must outlive the result.
Result<std::unique_ptr<ByteSource>> open_source(Session& session, const std::string& location,
                                                std::uint64_t memory);
// Opens a scene: reads its head, not its segments.
Result<std::unique_ptr<SceneReader>> open_scene(Session& session, const std::string& location,
                                                const ReadLimits& limits = {});
// Reads the entire scene. Reports damage as warnings.
Result<Scene> load_scene(Session& session, const std::string& location,
                         const ReadLimits& limits = {});
// Checks that another module can open a scene: reads its head.
Status check_is_scene(Session& session, const std::string& location, const ReadLimits& limits = {});
// Returns the error of a scene that was read from `input` and could not be written to `output`. Its
// values are no arguments: kUsage becomes kInvalidFile of `input`.
Status write_error(const Status& status, const std::string& input, const std::string& output);

}  // namespace stgs::tools
