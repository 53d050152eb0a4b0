// SPDX-License-Identifier: Apache-2.0
// Models of COLMAP, text and binary: cameras, images and points. An input is a folder
// (packed_files.h).
#include "capture/colmap_model.h"
#include "capture_seeds.h"
#include "captures.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::encoder;

namespace {

std::vector<Bytes> seeds() {
  return {pack_files({"", colmap_text_model()}), pack_files({"", colmap_binary_model()})};
}

std::vector<Unit> units(View input) {
  return file_units(input);
}

// A line of text is a string and, with its words, a stream.
std::uint64_t memory(View input) {
  return 128 * input.size() + (64 << 10);
}

}  // namespace

const Target stgs::fuzz::kTarget{"colmap_model", seeds, nullptr, nullptr, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const InputFolder& folder = input_folder();
  folder.write(unpack_files({data, size}).files);
  const auto files = CaptureFolder::open(folder.path(), false);
  require(files.ok(), "the folder can be opened");
  const std::string where = folder.path() + "/sparse/0";
  const auto model = read_colmap_model(**files, where);
  check_error(model.status());
  if (!model.ok()) return 0;
  // Counts that memory bounds: the files have at least 24, 73 and 51 bytes of each in binary.
  require(model->images.size() <= size && model->points.size() <= size,
          "each image and point has bytes in a file");
  for (const InitialPoint& point : model->points) {
    for (const float v : point.position) require(std::isfinite(v), "points are finite");
  }
  SourceCapture capture;
  std::vector<std::string> first_images;
  const Status status = cameras_from_colmap(*model, where, capture, &first_images);
  check_error(status);
  if (!status.ok()) return 0;
  require(capture.cameras.size() == first_images.size(), "each camera has a first image");
  for (const SourceCamera& camera : capture.cameras) check_source_camera(camera);
  return 0;
}
