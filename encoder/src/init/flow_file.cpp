// SPDX-License-Identifier: Apache-2.0
// Reads Middlebury .flo: float 202021.25, int32 width, int32 height, then floats u v, row by row.
#include <cstring>
#include <opencv2/imgproc.hpp>

#include "init/motion.h"
#include "stgs/encoder/capture_folder.h"
#include "stgs/format/camera.h"

namespace stgs::encoder::init {

Result<std::string> find_flow(const CaptureFolder& files, const std::string& folder,
                              const std::string& camera, int frame) {
  if (!files.is_folder(folder + "/" + camera)) return std::string();
  std::string path = fmt::format("{}/{}/{:06}.flo", folder, camera, frame);
  if (files.exists(path)) return path;
  return io_error(
      "{}: no flow of camera '{}' from frame {} to the next; add it, or remove the folder to have "
      "flow computed",
      path, camera, frame);
}

Result<cv::Mat> read_flow(const CaptureFolder& files, const std::string& path) {
  constexpr std::size_t kHeader = 12;
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, files.open_source(path));
  std::uint8_t header[kHeader];
  float magic = 0;
  std::int32_t width = 0, height = 0;
  if (source->size() > kCaptureLimits.file_bytes) {
    return invalid_file("{}: file too large: {} bytes (limit {})", path, source->size(),
                        kCaptureLimits.file_bytes);
  }
  if (source->size() < kHeader) return invalid_file("{}: truncated .flo header", path);
  STGS_TRY(source->read(0, header));
  std::memcpy(&magic, header, 4);
  std::memcpy(&width, header + 4, 4);
  std::memcpy(&height, header + 8, 4);
  if (magic != 202021.25f) return invalid_file("{}: not a Middlebury .flo file", path);
  if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide) {
    return invalid_file("{}: invalid flow size {}x{} (expected 1 to {} per side)", path, width,
                        height, kMaxImageSide);
  }
  const std::uint64_t bytes =
      std::uint64_t{8} * static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  if (source->size() < bytes + kHeader) {
    return invalid_file("{}: truncated (expected {} bytes for {}x{} flow)", path, bytes + kHeader,
                        width, height);
  }
  cv::Mat flow(height, width, CV_32FC2);
  STGS_TRY(source->read(kHeader, {flow.data, static_cast<std::size_t>(bytes)}));
  return flow;
}

Result<cv::Mat> given_flow(const PreparedCapture& capture, const View& view,
                           const InitSettings& settings, int frame) {
  if (settings.flow_folder.empty()) return cv::Mat();
  const CaptureFolder& files = *settings.flow_files;
  const auto own = static_cast<int>(capture.own_frame(*view.camera, frame));
  STGS_ASSIGN(const std::string path,
              find_flow(files, settings.flow_folder, view.camera->name, own));
  if (path.empty()) return cv::Mat();
  STGS_ASSIGN(cv::Mat flow, read_flow(files, path));
  const double sx = double(view.width) / flow.cols, sy = double(view.height) / flow.rows;
  cv::resize(flow, flow, view.size(), 0, 0, cv::INTER_NEAREST);
  cv::multiply(flow, cv::Scalar(sx, sy), flow);
  return flow;
}

}  // namespace stgs::encoder::init
