// SPDX-License-Identifier: Apache-2.0
// The steps of writing a scene, shared by files and recordings.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "scene/body_write.h"

namespace stgs {

// Rejects scenes and settings that a reader would reject.
Status check_scene(const Scene& scene, const WriteSettings& settings);

struct EncodedScene {
  FileMetadata metadata;  // with the bounds
  Body body;
};
// Encodes the records of a checked scene. A chunk of 0 ticks is chosen automatically. `measure`:
// set the errors of the body, unless the scene is coded without loss.
Result<EncodedScene> encode_records(const Scene& scene, const WriteSettings& settings,
                                    double chunk_ticks, bool measure);

// Returns the records META, LAYT if there are layouts, WNDW if there is a window, STEP if there are
// steps, and ERRB if there are errors.
std::vector<std::uint8_t> write_head_records(const FileMetadata& metadata, const LayoutSet& layouts,
                                             const std::optional<Quantisation>& steps = {},
                                             std::span<const ErrorBound> errors = {});
}  // namespace stgs
