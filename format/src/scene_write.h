// SPDX-License-Identifier: Apache-2.0
// The steps of writing a scene that files of both forms share.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "body_write.h"

namespace stgs {

// What a reader would refuse is not written.
Status check_scene(const Scene& scene, const WriteSettings& settings);

struct EncodedScene {
  FileMetadata metadata;  // with the bounds
  Body body;
};
// The records of a scene that has been checked; a chunk of 0 ticks is chosen.
Result<EncodedScene> encode_records(const Scene& scene, const WriteSettings& settings,
                                    double chunk_ticks);

// META, LAYT where there are layouts, and WNDW where there is a window.
std::vector<std::uint8_t> write_head_records(const FileMetadata& metadata,
                                             const LayoutSet& layouts);
}  // namespace stgs
