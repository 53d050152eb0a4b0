// SPDX-License-Identifier: Apache-2.0
// Live recording: a .stgs file that is only appended to and can be played while it grows
// (spec 9).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/damage_report.h"
#include "stgs/format/scene_file.h"

namespace stgs {

struct RecordSettings {
  WriteSettings write;  // records always have their own layouts, regardless of `own_layouts`
  // Each append waits until its bytes are on disk, so that they survive a power failure. Otherwise
  // they survive only the end of this process.
  bool sync = true;
  // Primitives may end before their lifespan does: append() accepts ends, and readers that do not
  // know ends refuse the file. When a recording is resumed, its file determines this.
  bool ends = false;
};

// A primitive of a recording: the offset of its record in the file, and its index there.
struct StoredPrimitive {
  std::uint64_t record = 0;  // 0: it was dropped
  std::uint32_t index = 0;
  bool operator==(const StoredPrimitive&) const = default;
};

// A primitive that is displayed until this frame of the recording and then fades with its sigma.
struct PrimitiveEnd {
  StoredPrimitive primitive;
  std::uint32_t frame = 0;
};

// The primitives of a fragment that are displayed for the same time.
struct FragmentPart {
  const Gaussians4D& primitives;        // not owned
  std::span<const float> importance{};  // see Scene; may be empty
  // They are displayed from the beginning of the fragment to its end or, if this is greater, up to
  // this frame, together with fragments appended later: content known to stay is stored once.
  std::uint32_t last_frame = 0;
  double quality = 0;  // in place of WriteSettings::quality; 0: that one
  // The steps that the primitives were trained for, with importances; null: chosen. Not owned.
  // Ignored as WriteSettings::own_steps is.
  const Quantisation* steps = nullptr;
};

// Appends fragments of time to a file. One thread at a time; encoding uses all threads
// (parallel.h). Once append() returns, the fragment can be read by anyone and stays readable
// whatever happens to this process. Readers skip the remains of an interrupted append. Destroying
// the recorder without close() leaves a file that readers expect to grow.
class SceneRecorder {
 public:
  // Creates a file, which must not exist, and writes its head. After an error there is no file.
  // Frames and bounds of the metadata are ignored; a window is rejected (kUsage), and so is the
  // near-lossless profile: the head, which states the errors, is written before they are known. If
  // the settings leave the chunk open, the first fragment determines it.
  static Result<std::unique_ptr<SceneRecorder>> create(const std::string& path,
                                                       const SceneMetadata& metadata, int sh_degree,
                                                       const RecordSettings& settings = {});
  // Resumes a recording that was not closed, for instance after a crash or a power failure.
  // Truncates the file after its last complete fragment; appending continues at frames(). The
  // profile in the settings must be the file's. The chunk is the file's once it has a fragment.
  // After an error the file is unchanged:
  // - kUsage: the file is finished or closed, or another recorder has it open
  // - kInvalidFile: it is damaged; finalize_scene() saves the rest
  static Result<std::unique_ptr<SceneRecorder>> resume(const std::string& path,
                                                       const RecordSettings& settings = {});
  ~SceneRecorder();
  SceneRecorder(const SceneRecorder&) = delete;
  SceneRecorder& operator=(const SceneRecorder&) = delete;

  // Extends the file to `end_frame` frames, more than frames(), with the primitives of these parts.
  // Their times count from frames(), the beginning of the fragment. Primitives never visible while
  // their part is displayed are dropped, except in the lossless profile.
  //
  // An error before the first byte is written (kUsage, kUnsupported, kNoMemory and others) changes
  // nothing. A write error (kIo) ends the recording and closes the file, which can be resumed; the
  // file is truncated to its previous length as far as the system allows.
  Status append(std::span<const FragmentPart> parts, std::uint32_t end_frame);
  // The same, and ends primitives of earlier fragments, at most 2^20 of them at frames of at most
  // `end_frame`. One that ends several times ends at the earliest of them. kUsage without
  // RecordSettings::ends, or if a primitive was not recorded. `stored`, unless null, receives where
  // primitive i of part p is stored, as (*stored)[p][i]; after an error it is unchanged. The
  // locations remain valid when the recording is resumed.
  Status append(std::span<const FragmentPart> parts, std::span<const PrimitiveEnd> ends,
                std::uint32_t end_frame,
                std::vector<std::vector<StoredPrimitive>>* stored = nullptr);
  // The same for a fragment of one part.
  Status append(const Gaussians4D& primitives, std::uint32_t end_frame,
                std::span<const float> importance = {}, std::uint32_t last_frame = 0);
  // Marks the file as complete. Errors: as append().
  Status close();

  // Returns whether the recording is neither closed nor ended by an error.
  bool is_open() const;
  // Returns the number of frames appended so far.
  std::uint32_t frames() const;
  // Returns the number of primitives in the file.
  std::uint64_t primitives() const;
  // Returns the number of primitives dropped since the recorder was created or resumed.
  std::uint64_t dropped() const;
  // Returns the length of the file, bytes.
  std::uint64_t bytes() const;
  // Returns the metadata of the file; frames and bounds are meaningless.
  const SceneMetadata& metadata() const;
  // Returns the SH degree of the file.
  int sh_degree() const;

 private:
  class State;
  explicit SceneRecorder(std::unique_ptr<State> state);

  std::unique_ptr<State> state_;
};

// Converts a recording, complete or truncated, to a file with its index in the head.
//
// - Every record except those of the index is copied unchanged, including unknown and damaged ones,
//   so that the new file still reports the damage and readers show the rest. Records that the index
//   does not list follow the segments.
// - Segments that no intact fragment lists are omitted. So is the last fragment of an unclosed
//   recording if all its records are damaged, as after a power failure.
// - A finished file with a damaged head is repaired from the copy of its head (spec 10.2).
//
// `limits` apply to the head and the index. `report` receives damaged and omitted content. `output`
// is written completely or not at all. Errors: kUsage if the file is finished and intact;
// kInvalidFile if it has primitives and none can be read.
Status finalize_scene(std::unique_ptr<ByteSource> recording, const std::string& output,
                      DamageReport& report, const ReadLimits& limits = {});

}  // namespace stgs
