// SPDX-License-Identifier: Apache-2.0
// The table of the formats that can be read, or written from one moment, or both.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/interchange.h"
#include "stgs/format/ply_sequence.h"
#include "stgs/format/splatv.h"

namespace stgs {

// What formats that move do not say themselves.
struct ImportSettings {
  SequenceSettings sequence;
  SplatvSettings splatv;
};

// What reading found.
struct ImportReport {
  ConversionNotes notes;
  std::optional<SequenceReport> sequence;  // where the format is that one
  std::optional<SplatvReport> splatv;
};

struct InterchangeFormat {
  enum SettingsKind { kNone, kSequence, kSplatv };

  const char* name;       // "SPZ"
  const char* extension;  // of file names, lower case, with its dot; "" for folders
  // Whether `path`, whose first bytes are `head`, holds this format; `head` is empty for a folder.
  bool (*holds)(const std::string& path, std::span<const std::uint8_t> head);
  // From bytes; null where it is only written, or read from a path.
  Result<Scene> (*read)(const ByteSource& source, const ReadLimits& limits, ConversionNotes* notes);
  // For what is more than one file, or moves; null elsewhere.
  Result<Scene> (*read_path)(const std::string& path, const ImportSettings& settings,
                             const ReadLimits& limits, ImportReport& report);
  // Null where it is only read. Takes a static set; `notes`, which may be null, receives what was
  // changed beyond the format's precision.
  Result<std::vector<std::uint8_t>> (*write)(Gaussians4D set, ConversionNotes* notes);
  SettingsKind settings_kind = kNone;  // which of ImportSettings reading looks at
};

// All of them but .stgs, in the order in which readers are tried.
std::span<const InterchangeFormat> interchange_formats();
// The format that a file or folder holds, by its content; null for .stgs, and for none of them.
Result<const InterchangeFormat*> detect_format(const std::string& path);
// Reads a file or folder of that format; kUnsupported where it is only written.
Result<Scene> read_interchange(const InterchangeFormat& format, const std::string& path,
                               const ImportSettings& settings, const ReadLimits& limits,
                               ImportReport& report);
// The format that can be written under this name; null for none.
const InterchangeFormat* format_for_output(const std::string& path);
// "a.SPZ" -> ".spz"; "" where there is none.
std::string file_extension(const std::string& path);

}  // namespace stgs
