// SPDX-License-Identifier: Apache-2.0
// A window of a long capture after its training, before it is recorded. Processes that train the
// windows of a round pass them on in files.
#pragma once

#include <string>

#include "stgs/encoder/persistent_set.h"
#include "stgs/encoder/train.h"
#include "stgs/format/scene_file.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct TrainedWindow {
  // Two parts: content of this window alone, then the additions to the set.
  Scene scene;
  // The set after the window. Of a window that is not the last of its round, it has only ends().
  PersistentSet set;
  TrainReport training;

  int frames() const { return static_cast<int>(scene.metadata.frames); }
};

// Writes the files `path` and, if `is_last`, path.state, atomically. They lack the metadata of the
// scene, and all of the report but its numbers of steps, seconds, primitives and loss. kIo on
// failure.
Status write_trained_window(const std::string& path, const TrainedWindow& window, bool is_last);

// Reads these files. kIo, kInvalidFile if they are damaged, kUnsupported for another version.
Result<TrainedWindow> read_trained_window(const std::string& path, bool is_last);

// Removes these files if they exist.
void remove_trained_window(const std::string& path);

}  // namespace stgs::encoder
