// SPDX-License-Identifier: Apache-2.0
// Source captures of every layout. An input is a folder (packed_files.h); the first byte of its
// options is the layout that is asked for.
//
// COLMAP never runs, but before it would, OpenCV and FFmpeg decode the first frames. Otherwise
// images are decoded only if they have the header of a seed, and videos never.
#include <algorithm>
#include <climits>
#include <cstdlib>

#include "capture/frame_numbers.h"
#include "capture/write_frames.h"
#include "capture_seeds.h"
#include "captures.h"
#include "stgs/encoder/camera_json.h"

using namespace stgs;
using namespace stgs::fuzz;
using namespace stgs::encoder;

namespace {

constexpr std::size_t kHeader = 54;  // of a seed's image

std::vector<Bytes> seeds() {
  std::vector<Bytes> out;
  for (const PackedFiles& capture : capture_seeds()) out.push_back(pack_files(capture));
  return out;
}

std::vector<Unit> units(View input) {
  return file_units(input);
}

// Twice the files (as read, and as a tree of values), and a plan for each of few cameras.
std::uint64_t memory(View input) {
  return 256 * input.size() + (512 << 10);
}

// Returns whether all frames are images with the header of a seed.
bool has_only_tiny_images(const SourceCapture& capture) {
  static const std::string header = tiny_bmp(kSeedWidth, kSeedHeight, 0).substr(0, kHeader);
  return std::all_of(
      capture.cameras.begin(), capture.cameras.end(), [&](const SourceCamera& camera) {
        if (!camera.video.empty()) return false;
        const auto bytes = capture.files->read(camera.images[0], kCaptureLimits.table_bytes);
        return bytes.ok() && bytes->size() >= header.size() &&
               std::equal(header.begin(), header.end(), bytes->begin(),
                          [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
      });
}

bool is_finite(const double* numbers, int count) {
  return std::all_of(numbers, numbers + count, [](double v) { return std::isfinite(v); });
}

void check_camera(const SourceCapture& capture, const SourceCamera& camera) {
  check_source_camera(camera);
  const bool is_folder_name = !camera.name.empty() && camera.name.front() != '.' &&
                              camera.name.find('/') == std::string::npos && is_utf8(camera.name) &&
                              is_printable(camera.name);
  require(is_folder_name, "a camera's name can be a folder");
  require(is_finite(camera.rotation, 9) && is_finite(camera.translation, 3), "a pose is finite");
  require(camera.video.empty() != camera.images.empty(), "a camera has one source of frames");
  if (!camera.video.empty()) check_path(*capture.files, camera.video);
  for (const std::string& path : camera.images) check_path(*capture.files, path);
  for (const std::string& path : camera.masks) check_path(*capture.files, path);
}

void check_capture(const SourceCapture& capture) {
  require(!capture.cameras.empty() && capture.cameras.size() <= kCaptureLimits.cameras,
          "the number of cameras is within the limit");
  std::set<std::string> names;
  for (const SourceCamera& camera : capture.cameras) {
    check_camera(capture, camera);
    require(names.insert(camera.name).second, "names are unique");
  }
  if (!capture.flow_folder.empty()) check_path(*capture.files, capture.flow_folder);
}

// Plans the frames, and checks the cameras that training would get.
void plan(const SourceCapture& capture, const PrepareSettings& settings, const LogSink& log) {
  check_error(check_frame_numbers(capture, -1, log));
  if (!has_only_tiny_images(capture)) return;
  PreparedCapture prepared;
  const auto plans = plan_frames(capture, settings, prepared, log);
  if (!plans.ok()) return;
  require(prepared.frames >= 1 && prepared.frames <= kCaptureLimits.frames,
          "the number of frames is within the limit");
  require(prepared.time_base.numerator > 0 && prepared.time_base.denominator > 0,
          "the frame rate is positive");
  for (const Camera& camera : prepared.cameras) {
    require(encoder::check_camera(camera, "plan").ok(), "a planned camera is valid");
  }
}

}  // namespace

const Target stgs::fuzz::kTarget{"capture_layouts", seeds, nullptr, nullptr, units, memory};

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const InputFolder& folder = input_folder();
  static const bool is_set = ::setenv("TMPDIR", folder.beside("").c_str(), 1) == 0;
  require(is_set, "temporary files are in the folder");
  const PackedFiles input = unpack_files({data, size});
  folder.write(input.files);
  PrepareSettings settings;
  const auto layout = input.options.empty() ? 0 : static_cast<std::uint8_t>(input.options[0]);
  settings.layout = static_cast<Layout>(layout % kLayoutNames.size());
  settings.first_frame = INT_MAX;  // no capture has it, so that COLMAP does not run
  const LogSink log = [](int, const std::string& message) {
    require(!message.empty(), "a message has a text");
  };
  const auto capture = load_source(folder.path(), settings, {}, log);
  check_error(capture.status());
  if (!capture.ok()) return 0;
  check_capture(*capture);
  settings.first_frame = 0;
  plan(*capture, settings, log);
  return 0;
}
