// SPDX-License-Identifier: Apache-2.0
#include "train/initial_points.h"

#include <filesystem>

#include "stgs/encoder/frame_memory.h"
#include "stgs/encoder/windows.h"
#include "stgs/format/byte_source.h"

namespace stgs::encoder {
namespace {

// Reads a file that `stgs prepare` always writes, even without points.
Result<std::vector<InitialPoint>> read_prepared_points(const PreparedCapture& capture,
                                                       const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::status(path, ignored).type() == std::filesystem::file_type::not_found) {
    return io_error(
        "{}: no such file, so the prepared capture is incomplete; copy it again, or run 'stgs "
        "prepare' again",
        path);
  }
  STGS_ASSIGN(const std::unique_ptr<ByteSource> file, open_file_of(capture, path));
  return read_points(*file);
}

}  // namespace

Result<InitialPoints> read_initial_points(const PreparedCapture& capture, bool with_statics) {
  InitialPoints points;
  const std::string dynamic_path = capture.folder + "/points_dynamic.ply";
  const auto known = capture.memory ? capture.memory->points() : nullptr;
  if (known != nullptr) {
    if (with_statics) points.statics = known->statics;
    points.dynamics = known->dynamics;
  } else {
    if (with_statics) {
      STGS_ASSIGN(points.statics,
                  read_prepared_points(capture, capture.folder + "/points_static.ply"));
    }
    STGS_ASSIGN(points.dynamics, read_prepared_points(capture, dynamic_path));
  }
  points.is_moving = !points.dynamics.empty();
  const int frames =
      capture.window ? static_cast<int>(capture.window->capture_frames) : capture.frames;
  for (InitialPoint& point : points.dynamics) {
    if (point.frame < 0 || point.frame >= frames) {
      return invalid_file("{}: a point has an invalid frame (expected 0 to {}, got {})",
                          dynamic_path, frames - 1, point.frame);
    }
    point.frame -= capture.frame_offset();
  }
  std::erase_if(points.dynamics, [&capture](const InitialPoint& point) {
    return point.frame < 0 || point.frame >= capture.frames;
  });
  return points;
}

}  // namespace stgs::encoder
