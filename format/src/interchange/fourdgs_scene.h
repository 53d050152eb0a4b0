// SPDX-License-Identifier: Apache-2.0
// The parts of a .4dgs import that do not depend on the temporal model.
#pragma once

#include "interchange/fourdgs_file.h"
#include "stgs/format/fourdgs.h"
#include "stgs/format/math/sh.h"

namespace stgs::fourdgs {

// Converts colours to the sRGB encoding of scenes, and measures the error.
class ColourConverter {
 public:
  // kUnsupported for an unknown colour space.
  static Result<ColourConverter> create(const Contents& contents);

  // Appends the SH of one Gaussian. `sh`: its bytes without degree 0.
  void append(const std::array<double, 3>& rgb, const std::uint8_t* sh, FloatArray& out);
  void add_notes(ConversionNotes* notes) const;

 private:
  void measure(const std::array<double, 3>& rgb, const float* sh);

  bool linear_ = false;
  int degree_ = 0;
  std::size_t coefficients_ = 1;
  double error_max_ = 0;  // of view-dependent colours
};

// Returns the logit of an opacity; -infinity for 0, and kOpaqueLogit for 1.
float logit_of(double opacity);
// Appends the attributes of a Gaussian that do not depend on time. The caller appends the others.
void append_shape(const Gaussian& g, Gaussians4D& out);
// Returns whether binary32 can hold all values of a Gaussian.
bool is_representable(const Gaussian& g);

// Reads the Gaussians of a chunk, without their SH.
Status read_chunk(const ByteSource& source, const Contents& contents, const BodyRecord& record,
                  ImportMemory& memory, Population& out);
// kUnsupported if one of the Gaussians belongs to an object that moves.
Status check_objects(const Contents& contents, const Population& set, const Place& place);
// Reads the SH bands that follow record `next` - 1 of the body, and advances `next` past them. They
// belong to the rows listed, in that order.
Status read_sh(const ByteSource& source, const Contents& contents, std::size_t& next,
               const std::vector<std::uint32_t>& rows, ImportMemory& memory, Population& out);

// Returns the number of frames of the clip. kUnsupported if they are too many.
Result<std::uint32_t> count_frames(const Contents& contents, const TimeBase& base,
                                   std::uint32_t most);
// Returns the duration of a frame that write_4dgs() stored.
std::optional<TimeBase> stored_frame_time(const Contents& contents);
// Converts axes and metadata, and adds notes on omitted records.
void finish_scene(const Contents& contents, Scene& scene, ConversionNotes* notes);

// Imports the temporal model gaussian-birth. `flat`: primitives stay in the order of the file and
// fades are not cut off by windows, so that the scene needs no parts.
Result<Scene> read_birth(const ByteSource& source, const Contents& contents, const TimeBase& base,
                         ImportMemory& memory, bool flat, FourdgsReport& report,
                         ConversionNotes* notes);
// Imports the temporal model keyframe-delta.
Result<Scene> read_keyframes(const ByteSource& source, const Contents& contents,
                             const FourdgsSettings& settings, ImportMemory& memory,
                             FourdgsReport& report, ConversionNotes* notes);

}  // namespace stgs::fourdgs
