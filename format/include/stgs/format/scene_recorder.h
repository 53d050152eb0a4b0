// SPDX-License-Identifier: Apache-2.0
// Recording live: a .stgs file that is only ever appended to, and can be played while it grows
// (spec 5.12).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "stgs/format/damage_report.h"
#include "stgs/format/scene_file.h"

namespace stgs {

struct RecordSettings {
  WriteSettings write;  // each record has its own layout, whatever `own_layouts` says
  // Each append waits until its bytes are on the disk: they survive a power cut. Without it they
  // survive the end of this process alone.
  bool sync = true;
};

// Appends stretches of time to a file. One thread at a time; encoding uses all threads
// (parallel.h). What append() has returned for can be read by anyone, and stays readable whatever
// happens to the process; a reader passes over what a killed append has left behind. Destroying it
// without close() leaves a file that readers expect to grow.
class SceneRecorder {
 public:
  // Makes the file, which must not exist; its head is there when this returns, and after an error
  // there is no file. Of the metadata,
  // frames and bounds are ignored; a window is refused (kUsage). The chunk is chosen by the first
  // stretch where the settings leave it open.
  static Result<std::unique_ptr<SceneRecorder>> create(const std::string& path,
                                                       const SceneMetadata& metadata, int sh_degree,
                                                       const RecordSettings& settings = {});
  // Goes on with a recording that was not closed, after a kill or a power cut: what follows its
  // last complete stretch is cut off, and appending goes on from frames(). Of the settings the
  // profile must be the file's; the chunk is the file's once it has a stretch. kUsage where the
  // file is finished or closed, or another recorder has it; kInvalidFile where it is damaged
  // (finalize_scene keeps the rest of it); kUnsupported where another program laid it out. After an
  // error the file is as it was.
  static Result<std::unique_ptr<SceneRecorder>> resume(const std::string& path,
                                                       const RecordSettings& settings = {});
  virtual ~SceneRecorder() = default;

  // Makes the file `end_frame` frames long, more than frames(), with these primitives, whose times
  // count from frames(), the beginning of the stretch. They are drawn up to end_frame or, where it
  // is greater, up to `last_frame`, beside what is appended later: what is known to stay is stored
  // once so. `importance`: see Scene; may be empty. What is never seen within its stretch is left
  // out, but of the lossless profile. After an error before the first byte is written nothing has
  // changed: kUsage, kUnsupported, kNoMemory and others. After one of writing (kIo) the recording
  // has ended and its file is closed, so that it can be resumed; the file ends where it did before,
  // as far as the system lets it be cut.
  virtual Status append(const Gaussians4D& stretch, std::uint32_t end_frame,
                        std::span<const float> importance = {}, std::uint32_t last_frame = 0) = 0;
  // Says in the file that nothing follows, with the whole index in one place. After an error: as
  // append().
  virtual Status close() = 0;

  virtual bool is_open() const = 0;              // neither closed, nor ended by an error
  virtual std::uint32_t frames() const = 0;      // appended so far
  virtual std::uint64_t primitives() const = 0;  // in the file
  virtual std::uint64_t dropped() const = 0;     // left out since it was made or resumed
  virtual std::uint64_t bytes() const = 0;       // of the file
  // What the file says of its scene, but for frames and bounds.
  virtual const SceneMetadata& metadata() const = 0;
  virtual int sh_degree() const = 0;
};

// Copies a recording, whole or cut off anywhere, to a file with its index in the head: every record
// but those of the index with the same bytes, also what this version does not know, and what is
// damaged: so the file goes on telling it, and readers show the rest. Left out is what no sound
// fragment lists, and the last stretch of a recording that was not closed where all its records are
// damaged, as a power cut leaves them. A finished file whose head is damaged and has a copy (spec
// 3.6) is mended: it gets the bytes that it had. `losses` receives what is damaged or left out.
// `output` appears whole or not at all. Errors: kUsage where the file is finished and sound,
// kInvalidFile where it has primitives and none can be read.
Status finalize_scene(std::unique_ptr<ByteSource> recording, const std::string& output,
                      DamageReport& losses);

}  // namespace stgs
