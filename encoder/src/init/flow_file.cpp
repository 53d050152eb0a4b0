// SPDX-License-Identifier: Apache-2.0
// Reads Middlebury .flo: float 202021.25, int32 width, int32 height, then floats u v, row by row.
#include <cstring>
#include <filesystem>
#include <fstream>

#include "init/motion.h"

namespace stgs::encoder::init {

Result<std::string> find_flow(const std::string& folder, const std::string& camera, int frame) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (folder.empty() || !fs::is_directory(folder + "/" + camera, ignored)) return std::string();
  std::string path = fmt::format("{}/{}/{:06}.flo", folder, camera, frame);
  if (fs::exists(path, ignored)) return path;
  return io_error(
      "{}: no flow of camera '{}' from frame {} to the next; add it, or remove the folder to have "
      "flow computed",
      path, camera, frame);
}

Result<cv::Mat> read_flow(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) {  // a pipe would block
    return io_error("{}: the flow file is not a regular file", path);
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) return io_error("{}: cannot open the flow file", path);
  char header[12];
  float magic = 0;
  std::int32_t width = 0, height = 0;
  if (!file.read(header, sizeof header)) return invalid_file("{}: truncated .flo header", path);
  std::memcpy(&magic, header, 4);
  std::memcpy(&width, header + 4, 4);
  std::memcpy(&height, header + 8, 4);
  if (magic != 202021.25f) return invalid_file("{}: not a Middlebury .flo file", path);
  if (width < 1 || height < 1 || width > 32768 || height > 32768) {
    return invalid_file("{}: invalid flow size {}x{} (expected 1 to 32768 per side)", path, width,
                        height);
  }
  const std::uintmax_t bytes = std::uintmax_t(width) * height * 8;
  if (std::filesystem::file_size(path, error) < bytes + 12 || error) {
    return invalid_file("{}: truncated (expected {} bytes for {}x{} flow)", path, bytes + 12, width,
                        height);
  }
  cv::Mat flow(height, width, CV_32FC2);
  if (!file.read(reinterpret_cast<char*>(flow.data), std::streamsize(bytes))) {
    return io_error("{}: cannot read the flow file", path);
  }
  return flow;
}

}  // namespace stgs::encoder::init
