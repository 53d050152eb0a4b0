// SPDX-License-Identifier: Apache-2.0
// Reading .stgs files of format version 1.0 and 1.1, for conversion.
//
// This folder depends on no other code for .stgs files. Its clause numbers are those of the text of
// format version 1.1 (spec/stgs-format.md of release 0.1.0).
#pragma once

#include "stgs/format/byte_source.h"
#include "stgs/format/interchange.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs {

// Returns whether a file that begins with these bytes is an .stgs file of major version 1. 10 bytes
// are sufficient.
bool is_stgs1(std::span<const std::uint8_t> head);

// Reads a finished or growing file of version 1.0 or 1.1; primitives in file order. A damaged head
// is read from its copy. `notes`, which may be null, receives a sentence for each omission:
// - damaged, missing or unknown tiers ("segment 3", counted over the index), with their importances
// - SH above degree 0 that cannot be read, which become 0
// - damaged fragments and incomplete bytes of a growing file
// - damaged records of the importance, the training window and private names
// - content that a Scene cannot represent: further records, private records and attributes
//
// kInvalidFile if the file is damaged beyond that, or no primitive of a non-empty file can be read;
// kUnsupported for content of later versions, and for a file that exceeds the limits; kNotBuilt for
// positions coded by Draco if this build lacks it. Stateless; may run on any thread.
Result<Scene> read_stgs1(const ByteSource& source, const ReadLimits& limits = {},
                         ConversionNotes* notes = nullptr);

}  // namespace stgs
