// SPDX-License-Identifier: Apache-2.0
#include "opencv_storage.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <stdexcept>

#include "capture_files.h"
#include "storage_nesting.h"

namespace stgs::encoder {
namespace {

// Appends the finite numbers of a node. Returns false for other content.
bool flatten(const cv::FileNode& node, std::vector<double>& out) {
  if (node.isMap()) return flatten(node["data"], out);
  if (node.isReal() || node.isInt()) {
    out.push_back(node.real());
    return std::isfinite(out.back());
  }
  if (!node.isSeq()) return false;
  for (const cv::FileNode& child : node) {
    if (!flatten(child, out)) return false;
  }
  return true;
}

}  // namespace

Storage::Storage(cv::FileStorage file, std::string path)
    : path_(std::move(path)), file_(std::move(file)) {
  cv::FileNode root = file_.root();
  for (int i = 0; !root.empty(); root = file_.root(++i)) {
    if (!root.isMap()) continue;
    for (const cv::FileNode& node : root) nodes_.emplace(node.name(), node);
  }
}

Result<Storage> Storage::open(const CaptureFolder& files, const std::string& path) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, read_table(files, path));
  const std::string text(bytes.begin(), bytes.end());
  STGS_TRY(check_storage_text(text, path));
  STGS_TRY(check_storage_nesting(text, path));
  try {
    cv::FileStorage file(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    if (file.isOpened()) return Storage(std::move(file), path);
  } catch (const cv::Exception& error) {
    return invalid_file("{}: OpenCV cannot read this file: {}", path, error.err);
  } catch (const std::logic_error&) {  // of std::string, for example for a key without a name
  }
  return invalid_file("{}: OpenCV cannot read this file", path);
}

cv::FileNode Storage::operator[](const std::string& key) const {
  const auto found = nodes_.find(key);
  return found == nodes_.end() ? cv::FileNode() : found->second;
}

Result<std::vector<double>> Storage::numbers(const std::vector<std::string>& keys) const {
  std::vector<double> out;
  for (const std::string& key : keys) {
    const cv::FileNode node = (*this)[key];
    if (node.empty()) continue;
    if (flatten(node, out)) return out;
    return invalid_file("{}: {} is not a matrix of finite numbers", path_, key);
  }
  return out;
}

Status set_opencv_pose(const std::vector<double>& rotation, const std::vector<double>& translation,
                       const std::string& where, SourceCamera& camera) {
  if (translation.size() != 3 || (rotation.size() != 3 && rotation.size() != 9)) {
    return invalid_file(
        "{}: invalid pose (expected a rotation of 3 or 9 numbers and a translation of 3, got {} "
        "and {})",
        where, rotation.size(), translation.size());
  }
  cv::Matx33d matrix;
  if (rotation.size() == 3) {
    cv::Rodrigues(cv::Vec3d(rotation.data()), matrix);
  } else {
    matrix = cv::Matx33d(rotation.data());
  }
  std::copy_n(matrix.val, 9, camera.rotation);
  std::copy_n(translation.begin(), 3, camera.translation);
  return {};
}

}  // namespace stgs::encoder
