// SPDX-License-Identifier: Apache-2.0
// The table of formats that can be read, or written from a snapshot of a scene, or both.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/interchange.h"
#include "stgs/format/ply_sequence.h"
#include "stgs/format/splatv.h"
#include "stgs/format/timed_formats.h"

namespace stgs {

// Parameters that dynamic formats do not store.
struct ImportSettings {
  SequenceSettings sequence;
  SplatvSettings splatv;
  CurveSettings curves;
  ClipSettings clip;
};

// The report of an import.
struct ImportReport {
  ConversionNotes notes;
  std::optional<SequenceReport> sequence;  // set for a PLY sequence
  std::optional<SplatvReport> splatv;      // set for .splatv
  std::optional<CurveReport> curves;       // set for .sogst
};

struct InterchangeFormat {
  // The member of ImportSettings that reading uses.
  enum SettingsKind { kNone, kSequence, kSplatv, kCurves, kClip };

  const char* name;       // "SPZ"
  const char* extension;  // of file names, lower case, with its dot; "" for folders
  // Returns whether `path`, whose first bytes are `head`, holds this format. `head` is empty for a
  // folder.
  bool (*matches)(const std::string& path, std::span<const std::uint8_t> head);
  // Reads a static set. Null if the format is only written, or read with read_path.
  Result<Scene> (*read)(const ByteSource& source, const ReadLimits& limits, ConversionNotes* notes);
  // Reads a format that is dynamic or consists of several files; null for the others.
  Result<Scene> (*read_path)(const std::string& path, const ImportSettings& settings,
                             const ReadLimits& limits, ImportReport& report);
  // Writes a static set. Null if the format is only read. `notes`, which may be null, receives
  // changes beyond the format's precision.
  Result<std::vector<std::uint8_t>> (*write)(const Gaussians4D& set, ConversionNotes* notes);
  // Writes a complete scene with its motion and lifespans; null for the others. `notes` as above.
  Result<std::vector<std::uint8_t>> (*write_scene)(const Scene& scene,
                                                   ConversionNotes* notes) = nullptr;
  SettingsKind settings_kind = kNone;
};

// Returns all formats except .stgs, in the order in which readers are tried.
std::span<const InterchangeFormat> interchange_formats();
// Returns the format of a file or folder, by its content; null for .stgs and unknown formats.
Result<const InterchangeFormat*> detect_format(const std::string& path);
// Reads a file or folder of the given format. kUnsupported if the format is only written.
Result<Scene> read_interchange(const InterchangeFormat& format, const std::string& path,
                               const ImportSettings& settings, const ReadLimits& limits,
                               ImportReport& report);
// Returns the writable format of a file name, by its extension; null if there is none.
const InterchangeFormat* format_for_output(const std::string& path);
// Returns the extension in lower case with its dot: "a.SPZ" -> ".spz"; "" if there is none.
std::string file_extension(const std::string& path);

}  // namespace stgs
