// SPDX-License-Identifier: Apache-2.0
// The table of formats that can be read, or written from a scene or a snapshot of it, or both.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/fourdgs.h"
#include "stgs/format/interchange.h"
#include "stgs/format/ply_sequence.h"
#include "stgs/format/splatv.h"
#include "stgs/format/timed_formats.h"

namespace stgs {

// Parameters that dynamic formats do not store.
struct ImportSettings {
  SequenceSettings sequence;
  SplatvSettings splatv;
  FourdgsSettings fourdgs;
  CurveSettings curves;
  ClipSettings clip;
};

// The report of an import.
struct ImportReport {
  ConversionNotes notes;
  // Set for a PLY sequence and for .4dgs with the temporal model keyframe-delta.
  std::optional<SequenceReport> sequence;
  std::optional<SplatvReport> splatv;  // set for .splatv
  std::optional<CurveReport> curves;   // set for .sogst
};

struct InterchangeFormat {
  // The member of ImportSettings that reading uses.
  enum SettingsKind { kNone, kSequence, kSplatv, kFourdgs, kCurves, kClip };

  const char* name;       // "SPZ"
  const char* extension;  // of file names, lower case, with its dot; "" for folders
  // Returns whether `path`, whose first bytes are `head`, holds this format. `head` is empty for a
  // folder.
  bool (*matches)(const std::string& path, std::span<const std::uint8_t> head,
                  const ReadLimits& limits);
  // Reads a static set. Null if the format is only written, or read with read_path.
  Result<Scene> (*read)(const ByteSource& source, const ReadLimits& limits, ConversionNotes* notes);
  // Reads a format that is dynamic or consists of several files; null for the others.
  Result<Scene> (*read_path)(const std::string& path, const ImportSettings& settings,
                             const ReadLimits& limits, ImportReport& report);
  // Writes a static set. Null if the format is only read. `notes`, which may be null, receives
  // changes beyond the format's precision.
  Result<std::vector<std::uint8_t>> (*write)(const Gaussians4D& set, int kernel,
                                             ConversionNotes* notes);
  SettingsKind settings_kind = kNone;
  // Writes a complete scene; null for formats without time. `order`, unless null, receives for each
  // primitive of the file its index in the scene, from which some may be omitted; only formats with
  // read_back() set it. kUnsupported if time samples could need more than limits.max_memory.
  Result<std::vector<std::uint8_t>> (*write_scene)(const Scene& scene, const ReadLimits& limits,
                                                   ConversionNotes* notes,
                                                   std::vector<std::uint32_t>* order) = nullptr;
  // Reads a file of write_scene() for a comparison: in its order, without parts.
  Result<Scene> (*read_back)(const ByteSource& source, const ReadLimits& limits) = nullptr;

  // Returns whether the format can be written.
  bool is_writable() const { return write != nullptr || write_scene != nullptr; }
};

// Returns all formats except .stgs, in the order in which readers are tried.
std::span<const InterchangeFormat> interchange_formats();
// Returns the format of a file or folder, by its content; null for .stgs and unknown formats.
// `limits`: also for reading the file later.
Result<const InterchangeFormat*> detect_format(const std::string& path,
                                               const ReadLimits& limits = {});
// Reads a file or folder of the given format. kUnsupported if the format is only written.
Result<Scene> read_interchange(const InterchangeFormat& format, const std::string& path,
                               const ImportSettings& settings, const ReadLimits& limits,
                               ImportReport& report);
// Returns the writable format of a file name, by its extension; null if there is none.
const InterchangeFormat* format_for_output(const std::string& path);
// Returns the extension in lower case with its dot: "a.SPZ" -> ".spz"; "" if there is none.
std::string file_extension(const std::string& path);

}  // namespace stgs
